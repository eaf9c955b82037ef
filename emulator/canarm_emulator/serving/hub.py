"""The virtual bus: a socketcand server for several clients on several channels, driven by `poll` from one thread.

Owns the listening socket, the clients and their bounded output queues. It orders nothing and forwards nothing by
itself: what a client sends is handed to the runner, which decides what the bus makes of it. No CANopen and no virtual
clock here; the one clock it reads is the wall clock, for the pause after a client's handshake.
"""

import contextlib
import os
import select
import socket
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.socketcand import (
    DEFAULT_PORT,
    Bad,
    Command,
    Echo,
    Open,
    RawMode,
    Send,
    ServerParser,
    Unknown,
    format_error,
    format_frame,
)

from ..errors import HubError
from .listening import listen

HOLD_S = 0.05
"""Pause between `< rawmode >` and the first frame, ended early by anything the client says.

python-can's client breaks when a frame shares a TCP segment with the `< ok >` of its handshake.
"""
MAX_GARBAGE = 1 << 14
"""Bytes in a row without one well-formed command, after which a client is no client."""
MAX_CLIENTS = 64
TOO_MANY = b"< error too many clients >"
"""What one more is told instead of `< hi >`, or the one that has to go for it."""

_READ_SIZE = 1 << 12  # bounds the time that one client's input can take from a cycle
_SELECT_LIMIT = 1024  # FD_SETSIZE where file descriptors are small integers (POSIX)
_QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)


class HasFileno(Protocol):
    """What `select` can watch."""

    def fileno(self) -> int:
        """File descriptor."""
        ...


class Received(NamedTuple):
    """A client sent a frame."""

    channel: str
    client_id: int
    frame: Frame


class Attached(NamedTuple):
    """A client opened a channel."""

    channel: str
    client_id: int


class Detached(NamedTuple):
    """A client that had opened a channel is gone."""

    channel: str
    client_id: int


class Ready(NamedTuple):
    """A file object given to `watch` is readable, or broken, in which case it is watched no longer."""

    fileobj: HasFileno


Event = Received | Attached | Detached | Ready


@dataclass(frozen=True, slots=True)
class ClientInfo:
    """A connection as it stands. `channel` is `None` before `< open >`; `dropped` and `malformed` are counts."""

    client_id: int
    address: str
    channel: str | None
    is_receiving: bool
    dropped: int
    malformed: int


class Hub:
    """A socketcand server. `address` is the (host, port) it listens on.

    `queue_bytes` bounds each client's output queue: frames that do not fit are dropped whole and counted in `dropped`.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        channels: Iterable[str] = ("can0", "bench"),
        *,
        allow_remote: bool = False,
        queue_bytes: int = 1 << 18,
    ) -> None:
        """Listen on `host` and `port` (0 = any free one).

        Raises `HubError`: address in use or not of this machine, or not loopback without `allow_remote`.
        """
        self._receivers: dict[str, list[_Client]] = {channel: [] for channel in channels}
        self._queue_bytes = queue_bytes
        self._listener = listen(host, port, allow_remote)
        bound_host, bound_port = self._listener.getsockname()[:2]
        self.address: tuple[str, int] = (bound_host, bound_port)
        self._clients: dict[int, _Client] = {}
        self._watched: dict[int, HasFileno] = {}
        self._read_fds: list[int] = []
        self._events: list[Event] = []
        self._last_client_id = 0
        self._dropped_before: dict[int, int] = {}
        self._dropped_on = dict.fromkeys(self._receivers, 0)
        self._update_read_fds()

    def poll(self, timeout_s: float) -> list[Event]:
        """Wait up to `timeout_s` for something to happen, return what did. May return early with nothing."""
        if self._events:
            timeout_s = 0.0
        write_fds = []
        for client in self._clients.values():
            if client.held is not None:
                timeout_s = self._release_when_due(client, timeout_s)
            if client.output:
                write_fds.append(client.fd)
        try:
            readable, writable, _ = select.select(self._read_fds, write_fds, (), timeout_s)
        except (OSError, ValueError):
            self._unwatch_broken()
            readable, writable = [], []
        for fd in writable:
            if client_to_flush := self._clients.get(fd):
                self._flush_client(client_to_flush)
        for fd in readable:
            if reading := self._clients.get(fd):
                self._read(reading)
            elif fd in self._watched:
                self._events.append(Ready(self._watched[fd]))
            else:
                self._accept()
        events, self._events = self._events, []
        return events

    def watch(self, fileobj: HasFileno) -> None:
        """Report `Ready(fileobj)` from `poll` as long as it is readable."""
        self._watched[fileobj.fileno()] = fileobj
        self._update_read_fds()

    def unwatch(self, fileobj: HasFileno) -> None:
        """Undo `watch`; also after `fileobj` was closed, and when it is not watched."""
        self._watched = {fd: watched for fd, watched in self._watched.items() if watched is not fileobj}
        self._update_read_fds()

    def send(self, channel: str, time_ns: int, frame: Frame, exclude: int | None = None) -> None:
        """Queue `frame`, stamped `time_ns` (>= 0), for the receiving clients of `channel` but for client `exclude`.

        Remote frames are left out, as socketcand does. Raises `HubError` for a channel that is not served.
        """
        if self._receivers_of(channel) and not frame.is_remote:
            self._queue(channel, format_frame(frame, time_ns), exclude)

    def send_error(self, channel: str, time_ns: int, error_class: int) -> None:
        """Queue an error frame with SocketCAN's class bits for the receiving clients of `channel`."""
        if self._receivers_of(channel):
            self._queue(channel, format_error(error_class, time_ns), None)

    def flush(self) -> None:
        """One non-blocking send a client; what does not go stays queued and goes in the next `poll` or `flush`."""
        for client in tuple(self._clients.values()):
            if client.output:
                self._flush_client(client)

    @property
    def dropped(self) -> dict[int, int]:
        """Frames dropped by client, among them clients that are gone, since they were too slow."""
        counts = {client.client_id: client.dropped for client in self._clients.values() if client.dropped}
        return self._dropped_before | counts

    def dropped_on(self, channel: str) -> int:
        """Frames dropped on `channel` so far. Raises `HubError` for a channel that is not served."""
        self._receivers_of(channel)
        return self._dropped_on[channel]

    def attached_to(self, channel: str) -> int:
        """Clients that have opened `channel`. Raises `HubError` for a channel that is not served."""
        self._receivers_of(channel)
        return sum(client.channel == channel for client in self._clients.values())

    @property
    def clients(self) -> tuple[ClientInfo, ...]:
        """Every connection, in order of arrival."""
        return tuple(client.info() for client in self._clients.values())

    def close(self) -> None:
        """Close every socket. May be called again."""
        for client in self._clients.values():
            client.socket.close()
        self._clients.clear()
        self._watched.clear()
        for receivers in self._receivers.values():
            receivers.clear()
        self._listener.close()
        self._read_fds = []

    def _receivers_of(self, channel: str) -> "list[_Client]":
        try:
            return self._receivers[channel]
        except KeyError:
            raise HubError(f"channel {channel!r} is not served; served are {', '.join(self._receivers)}") from None

    def _queue(self, channel: str, element: bytes, exclude: int | None) -> None:
        for client in self._receivers[channel]:
            if client.client_id == exclude:
                continue
            queue = client.output if client.held is None else client.held
            if len(queue) + len(element) > self._queue_bytes:
                client.dropped += 1
                self._dropped_on[channel] += 1
            else:
                queue += element

    def _update_read_fds(self) -> None:
        self._read_fds = [self._listener.fileno(), *self._clients, *self._watched]

    def _unwatch_broken(self) -> None:
        """Find the file objects that were closed while watched, which `select` answers for all together."""
        for fd, fileobj in tuple(self._watched.items()):
            try:
                select.select((fd,), (), (), 0)
            except (OSError, ValueError):
                del self._watched[fd]
                self._events.append(Ready(fileobj))
        self._update_read_fds()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # also a client that is gone before it is accepted
            while True:
                connection, address = self._listener.accept()
                self._admit(connection, f"{address[0]}:{address[1]}")

    def _admit(self, connection: socket.socket, address: str) -> None:
        if os.name == "posix" and connection.fileno() >= _SELECT_LIMIT:
            connection.close()
            return
        if len(self._clients) >= MAX_CLIENTS:
            # Room is made by one that connected and never said what it wants.
            silent = next((client for client in self._clients.values() if client.channel is None), None)
            refused = connection if silent is None else silent.socket
            with contextlib.suppress(OSError):
                refused.setblocking(False)
                refused.send(TOO_MANY)
            if silent is None:
                connection.close()
                return
            self._drop(silent)
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._last_client_id += 1
        client = _Client(connection, self._last_client_id, address)
        self._clients[client.fd] = client
        self._update_read_fds()
        self._reply(client, b"< hi >")
        self._flush_client(client)

    def _drop(self, client: "_Client") -> None:
        if self._clients.get(client.fd) is not client:
            return
        del self._clients[client.fd]
        self._update_read_fds()
        client.socket.close()
        if client.dropped:
            self._dropped_before[client.client_id] = client.dropped
            if len(self._dropped_before) > MAX_CLIENTS:
                del self._dropped_before[next(iter(self._dropped_before))]
        if client.channel is not None:
            if client.is_receiving:
                self._receivers[client.channel].remove(client)
            self._events.append(Detached(client.channel, client.client_id))

    def _read(self, client: "_Client") -> None:
        try:
            if _QUICKACK is not None:
                # Linux forgets it again. A client with Nagle's algorithm waits 40 ms for each delayed ACK.
                client.socket.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
            data = client.socket.recv(_READ_SIZE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        self._release(client)
        for command in client.parser.feed(data):
            if type(command) is Send:
                if client.channel is not None:
                    self._events.append(Received(client.channel, client.client_id, command.frame))
            elif not self._obey(client, command):
                self._flush_client(client)
                self._drop(client)
                return
            if type(command) is not Bad and type(command) is not Unknown:
                client.garbage_before = client.parser.garbage_bytes
        if client.parser.garbage_bytes - client.garbage_before > MAX_GARBAGE:
            self._drop(client)
        elif client.output:
            self._flush_client(client)

    def _obey(self, client: "_Client", command: Command) -> bool:
        """Answer a command that is not `Send`. False when the connection is to be closed."""
        match command:
            case Open(channel) if client.channel is None:
                if channel not in self._receivers:
                    self._reply(client, b"< error could not open bus >")
                    return False
                client.channel = channel
                self._events.append(Attached(channel, client.client_id))
                self._reply(client, b"< ok >")
            case RawMode() if client.channel is not None:
                if not client.is_receiving:
                    client.is_receiving = True
                    client.held = bytearray()
                    client.held_until_s = time.monotonic() + HOLD_S
                    self._receivers[client.channel].append(client)
                self._reply(client, b"< ok >")
            case Echo():
                self._release(client)
                self._reply(client, b"< echo >")
            case Bad():
                pass  # as state_raw.c does: a syntax error is no news to its sender
            case _:
                self._reply(client, b"< error unknown command >")
        return True

    def _reply(self, client: "_Client", element: bytes) -> None:
        """Queue an answer. A client that asks much and reads nothing gets no further ones."""
        if len(client.output) + len(element) <= self._queue_bytes:
            client.output += element

    def _release(self, client: "_Client") -> None:
        if client.held is not None:
            client.output += client.held
            client.held = None

    def _release_when_due(self, client: "_Client", timeout_s: float) -> float:
        """`timeout_s`, shortened to the end of the client's pause."""
        remaining_s = client.held_until_s - time.monotonic()
        if remaining_s > 0:
            return min(timeout_s, remaining_s)
        self._release(client)
        return timeout_s

    def _flush_client(self, client: "_Client") -> None:
        try:
            sent = client.socket.send(client.output)
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)
            return
        del client.output[:sent]


class _Client:
    """One connection: its parser, its place in the handshake, its output queue."""

    __slots__ = (
        "address",
        "channel",
        "client_id",
        "dropped",
        "fd",
        "garbage_before",
        "held",
        "held_until_s",
        "is_receiving",
        "output",
        "parser",
        "socket",
    )

    def __init__(self, connection: socket.socket, client_id: int, address: str) -> None:
        self.socket = connection
        self.fd = connection.fileno()
        self.client_id = client_id
        self.address = address
        self.parser = ServerParser()
        self.channel: str | None = None
        self.output = bytearray()
        self.is_receiving = False
        self.held: bytearray | None = None
        """Frames queued during the pause after `< rawmode >`; `None` outside it."""
        self.held_until_s = 0.0
        self.dropped = 0
        self.garbage_before = 0

    def info(self) -> ClientInfo:
        return ClientInfo(
            client_id=self.client_id,
            address=self.address,
            channel=self.channel,
            is_receiving=self.is_receiving,
            dropped=self.dropped,
            malformed=self.parser.malformed,
        )
