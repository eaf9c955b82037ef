"""A python-can bus on a socketcand server over TCP: `can.Bus(interface="canarm", channel="can0", host=…, port=…)`.

Owns the socket, the handshake and the detection of a lost server; `socketcand` has the text of the protocol. Besides
python-can's API it has `send_frames` and `receive_frames`, which work without `can.Message`.
"""

import contextlib
import difflib
import logging
import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, NoReturn

import can

from ..canopen.frames import Frame
from ..errors import FrameError
from ..shown import quoted
from .socketcand import DEFAULT_PORT, ClientParser, ErrorFrame, format_send

DEFAULT_HOST = "127.0.0.1"
DEFAULT_CHANNEL = "can0"

OPTIONS = ("host", "port", "connect_timeout", "send_timeout", "can_filters")
WITHOUT_MEANING = (
    "bitrate",
    "data_bitrate",
    "f_clock",
    "ignore_config",
    "local_loopback",
    "receive_own_messages",
    "sample_point",
    "single_handle",
    "tcp_tune",
    "timing",
)
"""Options of a wire or an adapter, which python-can's tools and configuration files give to any interface."""

_READ_SIZE = 1 << 16
_log = logging.getLogger(__name__)
_CLOSED = "the server closed the connection; was the emulator stopped?"
_SELECT_LIMIT = 1024  # FD_SETSIZE where file descriptors are small integers (POSIX)


class HubClientBus(can.BusABC):
    """One channel of a socketcand server. Sends may come from any thread, receives from one at a time.

    `fileno()` is readable exactly while something can be received, even when one read brought several frames. Filters
    act on python-can's `recv` only. `error_frames` counts the error frames that `receive_frames` has left out.
    """

    def __init__(
        self,
        channel: Any = DEFAULT_CHANNEL,
        host: str = DEFAULT_HOST,
        port: int = DEFAULT_PORT,
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        connect_timeout: float = 10.0,
        send_timeout: float = 2.0,
        fd: bool = False,
        **kwargs: Any,
    ) -> None:
        """Connect and open `channel`; both together take at most `connect_timeout` seconds.

        `send_timeout` (s) bounds every send. Options of the wire (`WITHOUT_MEANING`) are accepted and ignored. Raises
        `can.CanInitializationError` for an unknown option or `receive_own_messages`, and when nobody listens, or the
        server is no socketcand server or has no such channel.
        """
        self.channel = str(channel)
        self.flags = f"--bus-kwargs host={host} port={port} -i canarm -c {self.channel}"
        self.channel_info = f"canarm {self.channel} on {host}:{port}"
        self.error_frames = 0
        self.unsent = 0
        """Remote, error and FD frames that were not sent: socketcand has no such frames."""
        self._send_timeout_s = send_timeout
        self._send_lock = threading.Lock()
        self._parser = ClientParser()
        self._messages: deque[can.Message] = deque()
        self._byte_is_held = False
        self._lost: str | None = None
        self._check_options(kwargs)
        if fd:
            raise can.CanInitializationError(f"{self.flags}: a canarm bus is classical CAN; leave out fd")
        if not 0 < len(self.channel) <= 16 or set(self.channel) & set("<> \t\r\n"):
            raise can.CanInitializationError(f"{self.flags}: a channel is a name of 1 to 16 characters, such as can0")
        if not 0 < int(port) < 65536:
            raise can.CanInitializationError(f"{self.flags}: a port is a number from 1 to 65535")
        self._socket = self._connect(str(host), int(port), connect_timeout)
        super().__init__(channel=self.channel, can_filters=can_filters)

    def send_frames(self, frames: Sequence[Frame]) -> None:
        """Send `frames` in one piece. Raises `can.CanOperationError`, also for remote frames and over 8 bytes."""
        try:
            data = b"".join(map(format_send, frames))
        except FrameError as error:
            raise can.CanOperationError(f"{self.flags}: {error}") from None
        self._write(data, self._send_timeout_s)

    def receive_frames(self, timeout_s: float) -> list[tuple[int, Frame]]:
        """Return (time in ns, frame) of everything that has arrived; wait up to `timeout_s` for the first.

        Raises `can.CanOperationError` when the server is gone.
        """
        if self._messages:
            return self._take_messages()
        deadline_s = time.monotonic() + timeout_s
        while self._wait_readable(timeout_s):
            frames = self._parser.feed(self._read(_READ_SIZE))
            if self._parser.errors:
                self.error_frames += len(self._parser.errors)
                self._parser.errors.clear()
            # The caller does not wait for an echo or half a frame.
            timeout_s = deadline_s - time.monotonic()
            if frames or timeout_s <= 0:
                return frames
        return []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a classical data frame within `timeout` seconds (default: `send_timeout`).

        Any other frame is dropped and counted in `unsent`, so that it does not end a bridge or a player. Raises
        `can.CanOperationError`, and `can.CanTimeoutError` when the server takes nothing for that long.
        """
        if msg.is_fd or msg.is_error_frame or msg.is_remote_frame:
            kind = "FD" if msg.is_fd else "remote" if msg.is_remote_frame else "error"
            level = logging.DEBUG if self.unsent else logging.WARNING
            _log.log(level, "%s: socketcand has classical data frames only; %s frames are dropped", self.flags, kind)
            self.unsent += 1
            return
        frame = Frame(msg.arbitration_id, bytes(msg.data), msg.is_extended_id)
        self._write(format_send(frame), timeout or self._send_timeout_s)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._messages and self._wait_readable(timeout):
            self._fetch_messages()
        if not self._messages:
            return None, False
        message = self._messages.popleft()
        self._release_held_byte()
        return message, False

    def fileno(self) -> int:
        """File descriptor for `select` and event loops; -1 after `shutdown`."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Stop periodic tasks and close the connection. May be called again."""
        super().shutdown()
        self._lost = self._lost or "this end was shut down"
        # Wakes a thread that waits in `recv`; `close` would not.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _check_options(self, given: dict[str, Any]) -> None:
        for name, value in given.items():
            if name == "receive_own_messages" and value:
                reason = "leave receive_own_messages out; the server sends nobody his own frames"
            elif name in WITHOUT_MEANING:
                continue
            else:
                close = difflib.get_close_matches(name, (*OPTIONS, *WITHOUT_MEANING), n=1)
                hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(OPTIONS)}"
                reason = f"no option {quoted(name)}; {hint}"
            raise can.CanInitializationError(f"{self.flags}: {reason}")

    def _connect(self, host: str, port: int, timeout_s: float) -> socket.socket:
        """A non-blocking socket in raw mode, of which nothing after the handshake has been read."""
        deadline_s = time.monotonic() + timeout_s
        try:
            connection = socket.create_connection((host, port), timeout=timeout_s)
        except ConnectionRefusedError:
            self._fail("nobody listens there; start one with: canarm emulator")
        except TimeoutError:
            self._fail(f"no answer within {timeout_s:g} s; is the host right, and a firewall open?")
        except socket.gaierror:
            self._fail(f"unknown host {host}")
        except (OSError, OverflowError, UnicodeError) as error:
            self._fail(f"cannot connect: {error}")
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if os.name == "posix" and connection.fileno() >= _SELECT_LIMIT:
                self._fail(f"this process has more than {_SELECT_LIMIT} files open; close some")
            self._expect(connection, "< hi >", deadline_s, "what listens there is no socketcand server")
            for command in (f"< open {self.channel} >", "< rawmode >"):
                connection.sendall(command.encode("utf-8", "replace"))
                self._expect(connection, "< ok >", deadline_s, f"{command} was refused")
            # Tells the server that the handshake is over; the parser skips its answer among the frames.
            connection.sendall(b"< echo >")
        except TimeoutError:
            self._fail(f"no socketcand handshake within {timeout_s:g} s", connection)
        except OSError as error:
            self._fail(f"lost during the handshake: {error}", connection)
        except can.CanInitializationError:
            connection.close()
            raise
        connection.setblocking(False)
        return connection

    def _expect(self, connection: socket.socket, reply: str, deadline_s: float, otherwise: str) -> None:
        """Read one element and not a byte more, so that `fileno()` is right about what follows."""
        text = b""
        while b">" not in text and len(text) < 256:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0:
                raise TimeoutError
            connection.settimeout(remaining_s)
            seen = connection.recv(256, socket.MSG_PEEK)
            if not seen:
                raise ConnectionResetError("closed by the server")
            text += connection.recv(seen.find(b">") + 1 or len(seen))
        answer = " ".join(text.decode("ascii", "replace").split())
        if answer == "< error could not open bus >":
            self._fail(f"there is no channel {self.channel} there")
        if answer == "< error too many clients >":
            self._fail("it serves as many clients as it can; end one of them")
        if answer != reply:
            self._fail(f"{otherwise}: it said {answer[:60]!r} instead of {quoted(reply)}")

    def _fail(self, reason: str, connection: socket.socket | None = None) -> NoReturn:
        if connection is not None:
            connection.close()
        raise can.CanInitializationError(f"{self.flags}: {reason}") from None

    def _lose(self, reason: str) -> NoReturn:
        self._lost = self._lost or reason
        raise can.CanOperationError(f"{self.flags}: {self._lost}") from None

    def _wait_readable(self, timeout_s: float | None) -> bool:
        if self._lost is not None:
            self._lose(self._lost)
        try:
            return bool(select.select((self._socket,), (), (), timeout_s)[0])
        except (OSError, ValueError) as error:
            self._lose(_reason(error))

    def _read(self, size: int, flags: int = 0) -> bytes:
        """What has arrived, at least one byte unless another thread took it."""
        try:
            data = self._socket.recv(size, flags)
        except BlockingIOError:
            return b""
        except OSError as error:
            self._lose(_reason(error))
        if not data:
            self._lose(_CLOSED)
        return data

    def _write(self, data: bytes, timeout_s: float) -> None:
        with self._send_lock:
            if self._lost is not None:
                self._lose(self._lost)
            sent = self._write_some(data)
            if sent < len(data):
                self._write_slowly(data, sent, time.monotonic() + timeout_s, timeout_s)

    def _write_some(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            self._lose(_reason(error))

    def _write_slowly(self, data: bytes, sent: int, deadline_s: float, timeout_s: float) -> None:
        """The server does not keep up: wait for it until the deadline, but never stop within a frame."""
        while sent < len(data):
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0:
                reason = f"the server took no frames for {timeout_s:g} s"
                if sent:
                    self._lose(reason)
                raise can.CanTimeoutError(f"{self.flags}: {reason}")
            try:
                select.select((), (self._socket,), (), remaining_s)
            except (OSError, ValueError) as error:
                self._lose(_reason(error))
            sent += self._write_some(data[sent:])

    def _fetch_messages(self) -> None:
        """Read everything but, if there are several messages, the last byte, which keeps `fileno()` readable.

        Otherwise an event loop that calls `recv(0)` once per wake-up, as `can.Notifier` does, would leave frames
        unread.
        """
        data = self._read(_READ_SIZE, socket.MSG_PEEK)
        self._messages.extend(map(self._message_of_frame, self._parser.feed(data)))
        if self._parser.errors:
            self._messages.extend(map(self._message_of_error, self._parser.errors))
            self._parser.errors.clear()
            self._messages = deque(sorted(self._messages, key=lambda message: message.timestamp))
        self._byte_is_held = len(self._messages) > 1
        remaining = len(data) - self._byte_is_held
        while remaining > 0 and (skipped := len(self._read(remaining))):
            remaining -= skipped

    def _release_held_byte(self) -> None:
        if self._byte_is_held and not self._messages:
            self._byte_is_held = False
            # The next call raises a loss that is found here: the caller first gets what came before it.
            with contextlib.suppress(can.CanOperationError):
                self._read(1)

    def _take_messages(self) -> list[tuple[int, Frame]]:
        """What `recv` has fetched and not yet handed out, as frames."""
        frames = []
        for message in self._messages:
            if message.is_error_frame:
                self.error_frames += 1
            else:
                frame = Frame(message.arbitration_id, bytes(message.data), message.is_extended_id)
                frames.append((round(message.timestamp * 1e6) * 1000, frame))
        self._messages.clear()
        self._release_held_byte()
        return frames

    def _message_of_frame(self, stamped: tuple[int, Frame]) -> can.Message:
        time_ns, frame = stamped
        return can.Message(
            timestamp=time_ns * 1e-9,
            arbitration_id=frame.can_id,
            data=frame.data,
            is_extended_id=frame.is_extended,
            channel=self.channel,
        )

    def _message_of_error(self, error: ErrorFrame) -> can.Message:
        return can.Message(
            timestamp=error.time_ns * 1e-9,
            arbitration_id=error.error_class,
            is_error_frame=True,
            is_extended_id=True,
            dlc=8,
            data=bytes(8),
            channel=self.channel,
        )


def _reason(error: Exception) -> str:
    """The reason in words. A server that stops with something unread resets the connection instead of closing it."""
    return _CLOSED if isinstance(error, ConnectionError) else f"the connection broke: {error}"
