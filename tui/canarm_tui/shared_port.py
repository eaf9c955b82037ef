"""One open bus for two users: the dashboard that drains it, and a background conversation that awaits answers.

The dashboard also gets every frame that the conversation reads, so nothing is lost.
"""

import contextlib
import threading
from collections import deque
from collections.abc import Iterator, Sequence

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

LONGEST_WAIT_S = 0.1
"""How often a conversation checks whether the bus has been closed meanwhile."""


class SharedPort:
    """`port`, which is this one's from now on. One conversation at a time; `send` from either side."""

    def __init__(self, port: BusPort) -> None:
        self.description, self.discarded = port.description, port.discarded
        self.is_closed = False
        self._port = port
        self._sending, self._reading = threading.Lock(), threading.Lock()
        self._overheard: deque[tuple[int, Frame]] = deque()

    def send(self, frames: Sequence[Frame]) -> None:
        """Send `frames` in order. Raises `BusError`."""
        with self._sending:
            self._port.send(frames)

    def receive(self) -> list[tuple[int, Frame]]:
        """What has arrived, without waiting. Raises `BusError`."""
        if not self._reading.acquire(blocking=False):
            return self._take_overheard()
        try:
            return self._take_overheard() or self._port.receive(0.0)
        finally:
            self._reading.release()

    @contextlib.contextmanager
    def lend(self) -> Iterator[BusPort]:
        """The bus for a conversation, on a thread of its own. Its methods raise `BusError` once the bus is closed."""
        with self._reading:
            try:
                yield _Lent(self, self._port, self._overheard)
            finally:
                if self.is_closed:
                    _close(self._port)

    def close(self) -> None:
        """Give the bus back, at the latest when the conversation that is on notices. May be called again."""
        self.is_closed = True
        if self._reading.acquire(blocking=False):
            try:
                _close(self._port)
            finally:
                self._reading.release()

    def _take_overheard(self) -> list[tuple[int, Frame]]:
        return [self._overheard.popleft() for _ in range(len(self._overheard))]


class _Lent(BusPort):
    """The bus as a conversation sees it."""

    def __init__(self, shared: SharedPort, port: BusPort, overheard: deque[tuple[int, Frame]]) -> None:
        self.description, self.discarded = port.description, port.discarded
        self._shared, self._port, self._overheard = shared, port, overheard

    def send(self, frames: Sequence[Frame]) -> None:
        self._check()
        self._shared.send(frames)

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        self._check()
        frames = self._port.receive(min(timeout_s, LONGEST_WAIT_S))
        self._overheard.extend(frames)
        return frames

    def fileno(self) -> int | None:
        return self._port.fileno()

    def close(self) -> None:
        """The bus is only lent."""

    def _check(self) -> None:
        if self._shared.is_closed:
            raise BusError(f"{self.description}: was closed meanwhile")


def _close(port: BusPort) -> None:
    with contextlib.suppress(BusError):
        port.close()
