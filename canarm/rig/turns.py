"""One thing at a time: a rig that two threads drive at once would blame the cards for what the threads do.

What is done in a turn is not known here.
"""

import contextlib
import threading
from collections.abc import Iterator

from ..usage import UsageError


class Turns:
    """Who drives a rig."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._call, self._thread = "", 0

    @contextlib.contextmanager
    def take(self, call: str) -> Iterator[None]:
        """Drive the rig in here, alone. `call` names what the user has called; raises `UsageError` while another is."""
        __tracebackhide__ = True
        if not self._lock.acquire(blocking=False):
            raise self._refusal(call)
        self._call, self._thread = call, threading.get_ident()
        try:
            yield
        finally:
            self._lock.release()

    def check(self, call: str) -> None:
        """Raises `UsageError` while anybody drives the rig."""
        __tracebackhide__ = True
        if self._lock.locked():
            raise self._refusal(call)

    def _refusal(self, call: str) -> UsageError:
        what = "is running already" if call == self._call else f"{self._call} is running"
        is_own = self._thread == threading.get_ident()
        return UsageError(f"{call}: {what}{', and this comes from within it' if is_own else ' in another thread'}")
