"""Running an application on a terminal: there has to be one, and signals end it and leave the terminal as it was."""

import contextlib
import gc
import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any, TextIO

from canarm_protocol.transport.one_core import on_one_core
from canarm_protocol.transport.time_slice import PATIENT_NS, set_time_slice

from .crash import broken, terminal_as_before
from .errors import TerminalError
from .steady import SteadyApp

END_S = 5.0
"""How long an application may take to end once its page is gone."""


def check_terminal(what: str = "the dashboard") -> None:
    """Raises `TerminalError` if stdin or stderr, on which `what` is drawn, is no terminal; a browser needs none."""
    if os.environ.get("TEXTUAL_DRIVER"):
        return
    for stream, name in ((sys.__stdin__, "stdin"), (sys.__stderr__, "stderr")):
        if stream is None or not stream.isatty():
            raise TerminalError(f"{name} is no terminal, and {what} needs one")


def run_app(app: SteadyApp) -> int:
    """Run `app` to its end, giving way to the loop that it watches; return its exit status.

    The handlers of `ending_signals` are as before then.

    Raises `BrokenError` if an error has ended it that nobody has foreseen.
    """
    before = {number: signal.getsignal(number) for number in ending_signals()}
    app.has_process, thresholds = True, gc.get_threshold()
    slice_ns = set_time_slice(PATIENT_NS)
    try:
        with on_one_core(), terminal_as_before(), _outliving_its_terminal(), _ending_with_its_page():
            app.run()
            if app.escaped is not None:
                raise broken(app.TITLE or "the screen", app.escaped)
    finally:
        if app.has_settled:
            gc.unfreeze()
            gc.set_threshold(*thresholds)
        if slice_ns:
            set_time_slice(slice_ns)
        # The event loop has put its own in the place of ours.
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


@contextlib.contextmanager
def _ending_with_its_page() -> Iterator[None]:
    """In a browser, stdin comes from the server, and hangs up when that is gone, however it has ended.

    The parent's process ID would not tell: it may have gone before this process has asked for it.
    """
    is_over = threading.Event()

    def watch(stdin: int) -> None:
        poll = select.poll()
        poll.register(stdin, 0)  # a hang-up is told unasked; what is there to read is not ours
        while not any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll()):
            pass
        if is_over.is_set():
            return
        os.kill(os.getpid(), signal.SIGTERM)
        # It may be writing to a pipe that nobody reads, which no signal interrupts.
        if not is_over.wait(END_S):
            os._exit(1)

    if os.environ.get("TEXTUAL_DRIVER") and hasattr(select, "poll") and sys.__stdin__ is not None:
        threading.Thread(target=watch, args=(sys.__stdin__.fileno(),), daemon=True).start()
    try:
        yield
    finally:
        is_over.set()


def ending_signals() -> tuple[signal.Signals, ...]:
    """Signals that end a program and are not switched off, as nohup does; none where they cannot be waited for."""
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():
        return ()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    return tuple(number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN)
