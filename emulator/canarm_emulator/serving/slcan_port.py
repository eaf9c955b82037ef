"""slcan adapters as attachments of a bus: what they have in common, and the one on a TCP port for pyserial's `socket://`.

Owns sockets and one bounded output queue; `slcan_terminal` has the adapter on a pseudo-terminal. CANopen never enters,
and it reads the clock only for the arrival of frames. A misbehaving client harms nobody but itself.
"""

import contextlib
import selectors
import socket
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Protocol

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.errors import ExitStatus
from canarm_protocol.transport.port import BusPort, Discarded

from ..errors import EmulatorError
from .edges import EdgeSelector
from .listening import Listener
from .slcan import SlcanAdapter

SOCKET_URL = "socket://"
"""pyserial's scheme for a serial line over TCP."""
QUEUE_BYTES = 1 << 18
READ_SIZE = 1 << 12
"""Bytes per read: bounds the time that a client's input can take from a cycle."""

_QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)


class SlcanError(EmulatorError):
    """An slcan adapter cannot be offered where it was asked for."""

    exit_status = ExitStatus.WRONG_INPUT


class SlcanRefusedError(SlcanError):
    """The machine refuses it, for example because a name is taken."""

    exit_status = ExitStatus.FAILED


class Line(Protocol):
    """A stream of bytes that never blocks."""

    def fileno(self) -> int:
        """File descriptor to wait for."""
        ...

    def read(self, size: int) -> bytes:
        """At most `size` bytes; nothing at the end. Raises `OSError`."""
        ...

    def write(self, data: bytearray) -> int:
        """How many bytes were taken. Raises `OSError`."""
        ...


class SlcanPort(BusPort):
    """An slcan adapter, used by one client at a time and by many one after the other.

    `dropped` counts the frames that slow clients have lost: the queue holds `queue_bytes`.
    """

    def __init__(
        self, queue_bytes: int = QUEUE_BYTES, selector: EdgeSelector | selectors.BaseSelector | None = None
    ) -> None:
        self.description = "-i slcan"
        self.discarded = Discarded()
        self.dropped = 0
        self._adapter = SlcanAdapter()
        self._queue_bytes = queue_bytes
        self._output = bytearray()
        self._selector = selectors.DefaultSelector() if selector is None else selector
        self._line: Line | None = None
        self._awaited = 0

    @property
    def is_open(self) -> bool:
        """A client has its channel open."""
        return self._adapter.is_open

    @property
    def refused(self) -> int:
        """Lines so far that were invalid, or invalid in the adapter's state."""
        return self._adapter.refused

    def send(self, frames: Sequence[Frame]) -> None:
        """Queue `frames` for the client, stamped with time 0. Never waits, never raises."""
        self.send_stamped([(0, frame) for frame in frames])

    def send_stamped(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """Queue (time in ns, frame) for the client; those that do not fit are dropped whole. Never waits or raises."""
        if not self.is_open:
            return
        for time_ns, frame in frames:
            line = self._adapter.line(frame, time_ns)
            if len(self._output) + len(line) > self._queue_bytes:
                self.dropped += 1
            else:
                self._output += line
        self._flush()

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        """Return what the client has sent; admit, answer and lose clients on the way. Never raises."""
        frames: list[Frame] = []
        for key, events in self._selector.select(timeout_s):
            if key.fileobj is not self._line:
                self._admit()
                continue
            if events & selectors.EVENT_READ:
                frames += self._read()
            self._flush()
        now_ns = time.time_ns()
        return [(now_ns, frame) for frame in frames]

    def fileno(self) -> int | None:
        """One descriptor for all input, if the system has such a thing (epoll, kqueue)."""
        fileno: Callable[[], int] | None = getattr(self._selector, "fileno", None)
        return None if fileno is None else fileno()

    def close(self) -> None:
        """Give everything back. May be called again."""
        self._line = None
        self._adapter.reset()
        self._output.clear()
        self._selector.close()

    def _admit(self) -> None:
        """Something other than the line is readable."""

    @abstractmethod
    def _release(self) -> None:
        """The client is gone: be ready for the next one."""

    def _hear(self) -> None:
        """The client has said something."""

    def _attach(self, line: Line) -> None:
        self._line, self._awaited = line, selectors.EVENT_READ
        self._selector.register(line, self._awaited)

    def _detach(self) -> None:
        if self._line is not None:
            self._selector.unregister(self._line)
            self._line = None
            self._adapter.reset()
            self._output.clear()
            self._release()

    def _read(self) -> list[Frame]:
        assert self._line is not None
        data: bytes | None
        try:
            data = self._line.read(READ_SIZE)
        except BlockingIOError:
            data = None
        except OSError:
            data = b""
        if data == b"":
            self._detach()
            return []
        self._selector.modify(self._line, self._awaited)  # there may be more, which edges do not tell
        if data is None:
            return []
        self._hear()
        frames, answers = self._adapter.feed(data)
        # A client that asks a lot and reads nothing gets no further answers.
        if len(self._output) + len(answers) <= self._queue_bytes:
            self._output += answers
        return frames

    def _flush(self) -> None:
        """One write; the rest stays queued until there is room again."""
        if self._line is None:
            return
        if self._output:
            try:
                del self._output[: self._line.write(self._output)]
            except BlockingIOError:
                pass
            except OSError:
                self._detach()
                return
        awaited = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._output else 0)
        if awaited != self._awaited or self._output:
            self._awaited = awaited
            self._selector.modify(self._line, awaited)


class SlcanSocket(SlcanPort):
    """An slcan adapter behind a TCP port. `address` is the (host, port) it listens on.

    A second client is refused while the first has its channel open; a client that has not opened it makes room.
    """

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, *, allow_remote: bool = False, queue_bytes: int = QUEUE_BYTES
    ) -> None:
        """Listen on `host` and `port` (0 = any free one).

        Raises `HubError`: address in use or not of this machine, or not loopback without `allow_remote`.
        """
        self._listener = Listener(host, port, allow_remote, f"--slcan {SOCKET_URL}HOST:PORT")
        super().__init__(queue_bytes)
        self._connection: _SocketLine | None = None
        bound_host, bound_port = self._listener.address
        self.address: tuple[str, int] = (bound_host, bound_port)
        shown_host = f"[{bound_host}]" if ":" in bound_host else bound_host
        self.description = f"-i slcan -c {SOCKET_URL}{shown_host}:{bound_port}"
        self._selector.register(self._listener, selectors.EVENT_READ)

    def close(self) -> None:
        """Close every socket. May be called again."""
        super().close()
        self._listener.close()
        self._hang_up()

    def _admit(self) -> None:
        for connection, _ in self._listener.accept():
            if self.is_open:
                connection.close()
                continue
            self._detach()
            connection.setblocking(False)
            # The first read finds a client that has gone meanwhile.
            with contextlib.suppress(OSError):
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._connection = _SocketLine(connection)
            self._attach(self._connection)

    def _release(self) -> None:
        self._hang_up()

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.socket.close()
            self._connection = None


class _SocketLine:
    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection

    def fileno(self) -> int:
        return self.socket.fileno()

    def read(self, size: int) -> bytes:
        if _QUICKACK is not None:
            # Linux forgets it again. A client with Nagle's algorithm waits 40 ms for each delayed ACK.
            self.socket.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
        return self.socket.recv(size)

    def write(self, data: bytearray) -> int:
        return self.socket.send(data)
