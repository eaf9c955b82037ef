"""The virtual bus: a socketcand server for several clients on several channels, driven by `poll` from one thread.

Owns the listening socket, and knows who is attached to which channel; `connection` has the state of one client. It
forwards nothing by itself: clients' frames go to the runner, which decides what the bus makes of them. CANopen and
virtual time never enter; it reads only the wall clock.
"""

import contextlib
import os
import select
import socket
import time
from collections.abc import Iterable

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.transport.socketcand import DEFAULT_PORT, format_error, format_frame
from canarm_protocol.transport.socketcand_server import (
    Bad,
    ChangeMode,
    Command,
    Echo,
    Mode,
    Open,
    Send,
    Statistics,
    Subscribe,
    Unknown,
    Unsubscribe,
    format_statistics,
)

from ..errors import HubError
from .connection import MOST_SUBSCRIPTIONS, ClientInfo, Connection
from .hub_events import Attached, Detached, Event, HasFileno, Ready, Received, Unreadable
from .listening import Listener

MAX_GARBAGE = 1 << 14
"""A client that sends this many bytes without one well-formed command is disconnected."""
MAX_CLIENTS = 64
TOO_MANY = b"< error too many clients >"
"""Sent instead of `< hi >` to one client too many, or to the client that has to make room for it."""
UNKNOWN = b"< error unknown command >"

_READ_SIZE = 1 << 12  # bounds the time that one client's input can take from a cycle
_SELECT_LIMIT = 1024  # FD_SETSIZE where file descriptors are small integers (POSIX)
_QUICKACK: int | None = getattr(socket, "TCP_QUICKACK", None)


class _Traffic:
    """Traffic of a bus so far: all frames, and those that clients of this hub have sent."""

    __slots__ = ("frame_bytes", "frames", "sent", "sent_bytes")

    def __init__(self) -> None:
        self.frames = self.frame_bytes = self.sent = self.sent_bytes = 0


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
        self._receivers: dict[str, list[Connection]] = {channel: [] for channel in channels}
        self._subscribers: dict[str, list[Connection]] = {channel: [] for channel in self._receivers}
        self._traffic = {channel: _Traffic() for channel in self._receivers}
        self._queue_bytes = queue_bytes
        self._listener = Listener(host, port, allow_remote)
        self.address: tuple[str, int] = self._listener.address
        self._clients: dict[int, Connection] = {}
        self._watched: dict[int, HasFileno] = {}
        self._read_fds: list[int] = []
        self._events: list[Event] = []
        self._last_client_id = 0
        self._dropped_before: dict[int, int] = {}
        self._dropped_on = dict.fromkeys(self._receivers, 0)
        self._malformed_before = 0
        self._update_read_fds()

    def poll(self, timeout_s: float) -> list[Event]:
        """Wait up to `timeout_s` for events, and return them. May return early with none."""
        if self._events:
            timeout_s = 0.0
        write_fds = []
        for client in self._clients.values():
            if client.waits_for_time:
                timeout_s, is_due = client.wait(time.monotonic(), timeout_s)
                if is_due:
                    self._send_statistics(client)
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
        """Queue `frame` with time stamp `time_ns` (>= 0) for the receiving clients of `channel`, except `exclude`.

        Remote frames are left out, as socketcand does. Raises `HubError` for a channel that is not served.
        """
        receivers, subscribers, traffic = (
            self._receivers_of(channel),
            self._subscribers[channel],
            self._traffic[channel],
        )
        traffic.frames += 1
        traffic.frame_bytes += len(frame.data)
        if frame.is_remote:
            return
        wanting = [client for client in receivers if client.client_id != exclude]
        if subscribers:
            key = frame.can_id, frame.is_extended
            wanting += [client for client in subscribers if key in client.subscribed and client.client_id != exclude]
        if wanting:
            self._queue(wanting, format_frame(frame, time_ns))

    def send_error(self, channel: str, time_ns: int, error_class: int) -> None:
        """Queue an error frame with SocketCAN's class bits for the receiving clients of `channel`."""
        if receivers := self._receivers_of(channel):
            self._queue(receivers, format_error(error_class, time_ns))

    def flush(self) -> None:
        """One non-blocking send per client; the rest stays queued for the next `poll` or `flush`."""
        for client in tuple(self._clients.values()):
            if client.output:
                self._flush_client(client)

    @property
    def dropped(self) -> dict[int, int]:
        """Frames dropped for slow clients, by client, including those that are gone."""
        counts = {client.client_id: client.dropped for client in self._clients.values() if client.dropped}
        return self._dropped_before | counts

    def dropped_on(self, channel: str) -> int:
        """Frames dropped on `channel` so far. Raises `HubError` for a channel that is not served."""
        self._receivers_of(channel)
        return self._dropped_on[channel]

    @property
    def malformed(self) -> int:
        """Elements and stretches of text of all clients so far that could not be read, and were dropped."""
        return self._malformed_before + sum(client.parser.malformed for client in self._clients.values())

    @property
    def refused(self) -> int:
        """Connections that were closed at once since this process has as many files open as it may."""
        return self._listener.refused

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
        for listening in (*self._receivers.values(), *self._subscribers.values()):
            listening.clear()
        self._listener.close()
        self._read_fds = []

    def _receivers_of(self, channel: str) -> list[Connection]:
        try:
            return self._receivers[channel]
        except KeyError:
            raise HubError(f"channel {channel!r} is not served; served are {', '.join(self._receivers)}") from None

    def _queue(self, clients: Iterable[Connection], element: bytes) -> None:
        for client in clients:
            if not client.queue(element):
                assert client.channel is not None
                self._dropped_on[client.channel] += 1

    def _update_read_fds(self) -> None:
        self._read_fds = [self._listener.fileno(), *self._clients, *self._watched]

    def _unwatch_broken(self) -> None:
        """Find the file objects that were closed while watched: `select` only says that there are some."""
        for fd, fileobj in tuple(self._watched.items()):
            try:
                select.select((fd,), (), (), 0)
            except (OSError, ValueError):
                del self._watched[fd]
                self._events.append(Ready(fileobj))
        self._update_read_fds()

    def _accept(self) -> None:
        for connection, address in self._listener.accept(TOO_MANY):
            self._admit(connection, address)

    def _admit(self, connection: socket.socket, address: str) -> None:
        if os.name == "posix" and connection.fileno() >= _SELECT_LIMIT:
            connection.close()
            return
        if len(self._clients) >= MAX_CLIENTS:
            # A client that has connected and sent nothing makes room.
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
        with contextlib.suppress(OSError):  # the first read finds a client that has gone meanwhile
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._last_client_id += 1
        client = Connection(connection, self._last_client_id, address, self._queue_bytes)
        self._clients[client.fd] = client
        self._update_read_fds()
        client.reply(b"< hi >")
        self._flush_client(client)

    def _drop(self, client: Connection) -> None:
        if self._clients.get(client.fd) is not client:
            return
        del self._clients[client.fd]
        self._update_read_fds()
        client.socket.close()
        self._malformed_before += client.parser.malformed
        if client.dropped:
            self._dropped_before[client.client_id] = client.dropped
            if len(self._dropped_before) > MAX_CLIENTS:
                del self._dropped_before[next(iter(self._dropped_before))]
        if client.channel is not None:
            self._forget(client, client.channel)
            self._events.append(Detached(client.channel, client.client_id))

    def _read(self, client: Connection) -> None:
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
        client.release()
        for command in client.parser.feed(data):
            if type(command) is Send and client.channel is not None:
                traffic = self._traffic[client.channel]
                traffic.sent += 1
                traffic.sent_bytes += len(command.frame.data)
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

    def _obey(self, client: Connection, command: Command) -> bool:
        """Answer a command that puts no frame on a bus. False when the connection is to be closed."""
        match command:
            case Open(channel) if client.channel is None:
                if channel not in self._receivers:
                    client.reply(b"< error could not open bus >")
                    return False
                client.channel = channel
                self._events.append(Attached(channel, client.client_id))
                client.reply(b"< ok >")
            case ChangeMode(mode) if client.channel is not None:
                if mode is not client.mode:
                    self._forget(client, client.channel)
                    client.change_mode(mode, time.monotonic())
                    if mode is Mode.RAW:
                        self._receivers[client.channel].append(client)
                client.reply(b"< ok >")
            case Subscribe(can_id, is_extended) if client.channel is not None and client.mode is Mode.BCM:
                if not client.subscribed:
                    self._subscribers[client.channel].append(client)
                if len(client.subscribed) < MOST_SUBSCRIPTIONS:
                    client.subscribed.add((can_id, is_extended))
            case Unsubscribe(can_id, is_extended) if client.channel is not None and client.mode is Mode.BCM:
                client.subscribed.discard((can_id, is_extended))
                if not client.subscribed:
                    self._forget(client, client.channel)
            case Statistics(interval_ms) if client.mode is Mode.CONTROL:
                client.ask_statistics(interval_ms / 1000, time.monotonic())
            case Echo():
                client.release()
                client.reply(b"< echo >")
            case Bad(text):
                # As in state_raw.c, the sender of a syntax error is not told.
                if not client.is_told:
                    client.is_told = True
                    self._events.append(Unreadable(client.channel, client.client_id, text))
            case _:
                client.reply(UNKNOWN)
        return True

    def _forget(self, client: Connection, channel: str) -> None:
        """The client gets no frames any more."""
        for clients in (self._receivers[channel], self._subscribers[channel]):
            if client in clients:
                clients.remove(client)

    def _send_statistics(self, client: Connection) -> None:
        assert client.channel is not None
        traffic = self._traffic[client.channel]
        client.reply(format_statistics(traffic.frame_bytes, traffic.frames, traffic.sent_bytes, traffic.sent))

    def _flush_client(self, client: Connection) -> None:
        if not client.flush():
            self._drop(client)
