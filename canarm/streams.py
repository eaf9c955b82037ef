"""stdout and stderr that cannot end a run: unread text is dropped, unprintable characters are replaced.

`stdout` keeps the summary apart from what a law prints.
"""

import contextlib
import os
import sys
from typing import Any, TextIO

LAST_STANDARD_FD = 2


def make_streams_safe() -> None:
    """Call once, before anything is printed.

    A closed standard descriptor is opened on the null device: the next file opened would get its number, and
    with it all output. Afterwards a reader that has left, or a full disk behind stderr, no longer raises.
    """
    for fd in range(LAST_STANDARD_FD + 1):
        try:
            os.fstat(fd)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number is `fd`
    sys.stdout = _safe(sys.stdout, 1, BrokenPipeError)
    sys.stderr = _safe(sys.stderr, LAST_STANDARD_FD, OSError)


def _safe(stream: TextIO | None, fd: int, lost: type[OSError]) -> Any:
    if stream is None:  # it was closed when Python began
        stream = open(fd, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    reconfigure = getattr(stream, "reconfigure", None)
    if reconfigure is not None and stream.errors == "strict":
        reconfigure(errors="replace")
    return _Dropping(stream, lost)


class _Dropping:
    """A text stream whose reader may leave: from then on output is dropped."""

    def __init__(self, stream: TextIO, lost: type[OSError]) -> None:
        self._stream, self._lost = stream, lost
        self.has_lost_its_reader = False

    def write(self, text: str) -> int:
        """As the stream's own."""
        try:
            return self._stream.write(text)
        except self._lost:
            self._drop()
            return len(text)

    def flush(self) -> None:
        """As the stream's own."""
        try:
            self._stream.flush()
        except self._lost:
            self._drop()

    def _drop(self) -> None:
        """Drop the output, and the stream's buffer, which would be flushed again at the latest at exit."""
        self.has_lost_its_reader = True
        with contextlib.suppress(OSError, ValueError):
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self._stream.fileno())
            os.close(nothing)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
