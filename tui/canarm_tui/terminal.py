"""Running an application on a terminal: there has to be one, and signals end it and leave the terminal as it was."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any, TextIO

from textual.app import App

from .errors import TerminalError


def check_terminal(what: str = "the dashboard") -> None:
    """Raises `TerminalError` if stdin or stderr, on which `what` is drawn, is no terminal; a browser needs none."""
    if os.environ.get("TEXTUAL_DRIVER"):
        return
    for stream, name in ((sys.__stdin__, "stdin"), (sys.__stderr__, "stderr")):
        if stream is None or not stream.isatty():
            raise TerminalError(f"{name} is no terminal, and {what} needs one")


def run_app(app: App[Any]) -> int:
    """Run `app` to its end; return its exit status. The handlers of `ending_signals` are as before then."""
    before = {number: signal.getsignal(number) for number in ending_signals()}
    try:
        with _outliving_its_terminal():
            app.run()
    finally:  # the event loop puts its own in the place of ours
        for number, handler in before.items():
            signal.signal(number, handler)
    return app.return_code or 0


class Outliving:
    """A stream to a terminal that may go: what is written to it then is dropped.

    Textual writes in a thread, which would end with the first error; the application would wait for it for ever.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """As the stream's own."""
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """As the stream's own."""
        with contextlib.suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def _outliving_its_terminal() -> Iterator[None]:
    """Textual takes its terminal from `sys.__stderr__`."""
    stream = sys.__stderr__
    if stream is not None:
        vars(sys)["__stderr__"] = Outliving(stream)
    try:
        yield
    finally:
        vars(sys)["__stderr__"] = stream


def ending_signals() -> tuple[signal.Signals, ...]:
    """Signals that end a program and are not switched off, as nohup does; none where they cannot be waited for."""
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():
        return ()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    return tuple(number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN)
