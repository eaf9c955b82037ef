"""The dashboard's connection: opens the port, announces a listener, drains, notices a loss and reconnects.

Opening may take seconds (a host that does not answer, a serial adapter), so it is done in the background, as are
conversations over the bus; everything else is called from one thread with the time passed in. What the frames mean is
known to the feed.
"""

import contextlib
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict
from enum import Enum

from canarm_protocol.canopen.frames import Frame, NmtState, heartbeat_frame
from canarm_protocol.errors import BusError
from canarm_protocol.shown import named_error
from canarm_protocol.transport.port import BusPort, Discarded

from .errors import NotConnectedError
from .shared_port import SharedPort

LISTENER_NODE_ID = 0x31
"""Node-ID of the dashboard on the bench bus."""
HEARTBEAT_NS = 500_000_000
"""A third of the time after which the bench considers a listener gone."""
RETRY_NS = 1_000_000_000
MAX_READS = 16
"""Most reads in one `poll`, so that a busy bus cannot block the keyboard."""

InBackground = Callable[[Callable[[], None]], None]


class LinkState(Enum):
    """State of the connection."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    LOST = "lost"


def in_thread(job: Callable[[], None]) -> None:
    """Run `job` in a daemon thread, which does not delay the end of the program."""
    threading.Thread(target=job, name="canarm-tui", daemon=True).start()


class Link:
    """One bus, reopened `RETRY_NS` after every loss. Without a `node_id` nothing is ever sent by itself."""

    def __init__(
        self,
        open_port: Callable[[], BusPort],
        where: str,
        node_id: int | None = LISTENER_NODE_ID,
        in_background: InBackground = in_thread,
    ) -> None:
        self.where = where
        """The bus as on the command line; once it is open, the port's own description."""
        self.is_live = True
        """Whether there is a bus at all; a recorded run has none."""
        self.state = LinkState.CONNECTING
        self.reason: str | None = None
        """Why the bus is lost, or could not be opened."""
        self.connections = 0
        """Number of times the bus was opened."""
        self._open_port = open_port
        self._in_background = in_background
        self._heartbeat = None if node_id is None else heartbeat_frame(node_id, NmtState.OPERATIONAL)
        self._lock = threading.Lock()
        self._opened: BusPort | str | None = None
        self._port: SharedPort | None = None
        self._is_opening = self._is_closed = False
        self._due_ns: int | None = None
        self._discarded_before = Discarded()

    @property
    def counted(self) -> Discarded:
        """What the ports have discarded, since the first was opened."""
        before, port = self._discarded_before, self._port
        return before if port is None else _sum(before, port.discarded)

    @property
    def discarded(self) -> int:
        """Error frames and FD frames that the ports discarded."""
        counted = self.counted
        return counted.error_frames + counted.fd_frames

    def poll(self, now_ns: int) -> list[tuple[int, Frame]]:
        """Do what is due at `now_ns`; return the arrived frames as (bus time in ns, frame). Raises nothing.

        Waits only if the bus does not accept the heartbeat, up to the port's own limit.
        """
        if self._port is None:
            self._connect(now_ns)
        if self._port is None:
            return []
        frames: list[tuple[int, Frame]] = []
        try:
            if self._heartbeat is not None and (self._due_ns is None or now_ns >= self._due_ns):
                self._due_ns = now_ns + HEARTBEAT_NS
                self._port.send([self._heartbeat])
            for _ in range(MAX_READS):
                arrived = self._port.receive()
                if not arrived:
                    break
                frames += arrived
        except BusError as error:
            self._lose(str(error), now_ns)
        return frames

    def reopen(self) -> None:
        """Close the bus, and open it again at the next `poll`: it may be elsewhere now."""
        port, self._port = self._port, None
        if port is not None:
            self._discarded_before = _sum(self._discarded_before, port.discarded)
            port.close()
        self.state, self.reason, self._due_ns = LinkState.CONNECTING, None, None

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames at once, whatever conversation goes on. Raises `BusError`, `NotConnectedError` without a bus."""
        if self._port is None:
            raise NotConnectedError(f"not connected: {self.reason or self.where}")
        self._port.send(frames)

    def lend(self) -> AbstractContextManager[BusPort]:
        """The bus for a conversation in another thread; `poll` still gets every frame. Raises `BusError` without
        one.
        """
        port = self._port
        if port is None:
            raise NotConnectedError(f"not connected: {self.reason or self.where}")
        return port.lend()

    def close(self) -> None:
        """Close the bus; one that is still being opened is closed once open. May be called again."""
        with self._lock:
            self._is_closed = True
            opened, self._opened = self._opened, None
        if isinstance(opened, BusPort):
            _close(opened)
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _connect(self, now_ns: int) -> None:
        if not self._is_opening and not self._is_closed and (self._due_ns is None or now_ns >= self._due_ns):
            self._is_opening = True
            self._in_background(self._open)
        with self._lock:
            opened, self._opened = self._opened, None
        if isinstance(opened, BusPort):
            self._is_opening = False
            self._port, self.where = SharedPort(opened), opened.description
            self.state, self.reason, self._due_ns = LinkState.CONNECTED, None, None
            self.connections += 1
        elif opened is not None:
            self._is_opening = False
            self._lose(opened, now_ns)

    def _open(self) -> None:
        result: BusPort | str
        try:
            result = self._open_port()
        except BusError as error:
            result = str(error)
        # In its own thread an unforeseen error would vanish, and the dashboard would wait for ever.
        except Exception as error:
            result = f"{self.where}: {named_error(error)}"
        with self._lock:
            if not self._is_closed:
                self._opened = result
                return
        if isinstance(result, BusPort):
            _close(result)

    def _lose(self, reason: str, now_ns: int) -> None:
        port, self._port = self._port, None
        if port is not None:
            self._discarded_before = _sum(self._discarded_before, port.discarded)
            port.close()
        self.state, self.reason, self._due_ns = LinkState.LOST, reason, now_ns + RETRY_NS


def _close(port: BusPort) -> None:
    with contextlib.suppress(BusError):
        port.close()


def _sum(one: Discarded, other: Discarded) -> Discarded:
    return Discarded(**{name: value + asdict(other)[name] for name, value in asdict(one).items()})
