"""Ending a process on request: signals, a parent that has gone, a time limit."""

import os
import signal
import time
from types import FrameType


class StopRequest:
    """Asked by a running loop whether it should end, and why. Takes over SIGINT and SIGTERM."""

    def __init__(self, seconds: float | None = None, with_parent: bool = False) -> None:
        self._reason: str | None = None
        self._deadline = None if seconds is None else time.monotonic() + seconds
        self._parent = os.getppid() if with_parent else None
        for number in (signal.SIGINT, signal.SIGTERM):
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

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._reason = signal.Signals(number).name
