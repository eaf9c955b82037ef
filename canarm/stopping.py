"""Ending a process on request: signals, a parent that has gone, a time limit."""

import os
import signal
import time
from types import FrameType


class StopRequest:
    """Asked by a running loop whether it should end, and why. Takes over SIGINT, SIGTERM and SIGHUP."""

    def __init__(self, seconds: float | None = None, with_parent: bool = False) -> None:
        self._reason: str | None = None
        self._deadline = None if seconds is None else time.monotonic() + seconds
        self._parent = os.getppid() if with_parent else None
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            # What nohup has switched off stays off.
            if number is not None and not (name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN):
                signal.signal(number, self._on_signal)

    def reason(self) -> str | None:
        """Why to stop, or None."""
        if self._reason is None:
            if self._parent is not None and os.getppid() != self._parent:
                self._reason = "the process that started this one is gone"
            elif self._deadline is not None and time.monotonic() > self._deadline:
                self._reason = "time is up"
        return self._reason

    def is_due(self) -> bool:
        """Whether to stop."""
        return self.reason() is not None

    def ask(self, reason: str) -> None:
        """Ask for the end from inside the process; an earlier reason stays."""
        self._reason = self._reason or reason

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.ask(signal.Signals(number).name)


def interrupt_on_terminate() -> None:
    """Let SIGTERM end the program as Ctrl-C does, until a `StopRequest` takes over."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
