"""Any bus that python-can knows, as a `BusPort`: frames go through `can.Message`.

Copes with python-can's drivers: exceptions of every kind, frames that classical CAN does not have, own frames that come
back. Unreadable input is counted, and does not mean that the bus is lost.
"""

import errno
import ipaddress
import logging
import select
import socket
import struct
import time
import uuid
from collections.abc import Callable, Sequence
from typing import Any

import can

from ..canopen.frames import Frame
from ..errors import BusError, BusOptionsError
from ..shown import first_line
from .port import BusPort, Discarded, bus_flags

MAX_FRAMES_PER_RECEIVE = 4096
"""Bound on one `receive`, so that a bus that never falls silent cannot hold its reader."""
UNREADABLE = (ValueError, TypeError, LookupError, ArithmeticError, struct.error)
"""What drivers raise for input that they cannot read."""
MOST_SENDERS = 256
MOST_UNREADABLE = 1000
"""Bound on consecutive unreadable input, on a bus that cannot tell whether it is still there."""
SEND_TIMEOUT_S = 1.0
ALLOW_REMOTE = "allow_remote"
"""Our own option for udp_multicast."""
_HIGHEST_ID, _HIGHEST_EXTENDED_ID, _MOST_BYTES = 0x7FF, 0x1FFF_FFFF, 8
Receive = Callable[[float], can.Message | None]
_log = logging.getLogger(__name__)

WRONG_OPTIONS = (TypeError, ValueError, KeyError)
"""What every driver raises for options that it does not take."""


def open_python_can_port(interface: str, channel: str | None, options: dict[str, Any]) -> BusPort:
    """Open a bus of python-can's. Raises `BusError`."""
    special = {"slcan": SlcanPort, "udp_multicast": MulticastPort}
    return special.get(interface, PythonCanPort)(interface, channel, options)


class PythonCanPort(BusPort):
    """Any bus that python-can knows, with its own configuration files and environment."""

    def __init__(self, interface: str, channel: str | None, options: dict[str, Any]) -> None:
        self.discarded = Discarded()
        self._unreadable = 0
        """Unreadable input since the last readable message."""
        self.description = bus_flags(interface, channel, options)
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise BusError(f"{self.description}: python-can knows no such interface; it knows {known}")
        # Own frames could not be told from others: SocketCAN marks all that this host has sent as not received.
        if options.get("receive_own_messages"):
            raise BusError(f"{self.description}: leave receive_own_messages out; own frames must not come back")
        try:
            self._bus: can.BusABC = self._open(interface, channel, options)
        # Drivers raise whatever they like, from ImportError to ctypes' own.
        except Exception as error:
            kind = BusOptionsError if isinstance(error, WRONG_OPTIONS) else BusError
            raise kind(f"{self.description}: {_explain(error, interface, channel)}") from error

    def _open(self, interface: str, channel: str | None, options: dict[str, Any]) -> can.BusABC:
        return can.Bus(interface=interface, channel=channel, **options)

    def send(self, frames: Sequence[Frame]) -> None:
        """Send `frames` in order. Raises `BusError`."""
        try:
            for frame in frames:
                self._bus.send(self._message(frame), timeout=SEND_TIMEOUT_S)
        except Exception as error:
            raise self._lost("cannot send", error) from error

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        """As `BusPort.receive`; unreadable input is counted and left out. Raises `BusError` when the bus is lost."""
        deadline_s = time.monotonic() + timeout_s
        frames: list[tuple[int, Frame]] = []
        while not frames and self._take(self._receive_one, timeout_s, frames):
            remaining = MAX_FRAMES_PER_RECEIVE
            while remaining and self._take(self._receive_at_once, 0.0, frames):
                remaining -= 1
            timeout_s = deadline_s - time.monotonic()
            if timeout_s <= 0:
                break
        return frames

    def _take(self, receive: Receive, timeout_s: float, frames: list[tuple[int, Frame]]) -> bool:
        """Receive one message; a frame for this port goes to `frames`. Returns whether there was anything at all."""
        try:
            message = receive(timeout_s)
        # Drivers raise whatever they like.
        except Exception as error:
            if not self._goes_on(error):
                raise self._lost("lost", error) from error
            return True
        if message is None:
            return False
        self._unreadable = 0
        if self._is_own(message):
            pass
        elif message.is_error_frame:
            self.discarded.error_frames += 1
        elif message.is_fd:
            self.discarded.fd_frames += 1
        elif (stamped := _stamped_frame(message)) is None:
            self.discarded.malformed += 1
        else:
            frames.append(stamped)
        return True

    def _goes_on(self, error: Exception) -> bool:
        """Whether the bus is still there, and only its input could not be read."""
        cause = error.__cause__ if isinstance(error, can.CanError) else error
        if not isinstance(cause, UNREADABLE) and not (isinstance(error, can.CanOperationError) and _is_decoding(cause)):
            return False
        self._unreadable += 1
        if self.fileno() is None and self._unreadable > MOST_UNREADABLE:
            return False
        self.discarded.malformed += 1
        self._forget_unreadable()
        return True

    def _forget_unreadable(self) -> None:
        """Clear what a driver keeps of unreadable input."""

    def _lost(self, what: str, error: Exception) -> BusError:
        _log.debug("%s: %s", self.description, what, exc_info=error)
        return BusError(f"{self.description}: {what}: {first_line(error)}")

    def _receive_one(self, timeout_s: float) -> can.Message | None:
        return self._bus.recv(timeout_s)

    def _receive_at_once(self, timeout_s: float) -> can.Message | None:
        return self._bus.recv(0)

    def _message(self, frame: Frame) -> can.Message:
        return _message(frame)

    def _is_own(self, message: can.Message) -> bool:
        """Whether `message` was sent through this port and came back; most drivers filter such messages."""
        return False

    def fileno(self) -> int | None:
        """File descriptor, where the driver has one and is open."""
        try:
            descriptor = self._bus.fileno()
        except (NotImplementedError, OSError, ValueError):
            return None
        return descriptor if descriptor >= 0 else None

    def close(self) -> None:
        """Give the bus back. Raises `BusError`."""
        try:
            self._bus.shutdown()
        except Exception as error:
            raise self._lost("cannot close", error) from error


class SlcanPort(PythonCanPort):
    """python-can's slcan driver buffers nothing, so the serial line itself tells whether there is more.

    Its `recv(0)` waits 1 ms if there is nothing, and returns `None` for an acknowledgement even with frames behind it.
    """

    def _receive_at_once(self, timeout_s: float) -> can.Message | None:
        descriptor = self.fileno()
        if descriptor is None:  # Windows
            return self._bus.recv(0)
        for _ in range(MAX_FRAMES_PER_RECEIVE):
            if not select.select((descriptor,), (), (), 0)[0]:
                break
            if (message := self._bus.recv(0)) is not None:
                return message
        return None

    def _forget_unreadable(self) -> None:
        # The driver keeps a line that is not ASCII, and would fail on it for ever.
        if isinstance(buffer := getattr(self._bus, "_buffer", None), bytearray):
            buffer.clear()


class MulticastPort(PythonCanPort):
    """python-can's udp_multicast returns what it has sent, and carries the channel's name with every frame.

    A unique name tells this port's own frames from others; nobody else looks at it. python-can listens on all
    addresses: without `allow_remote`, frames stay on this machine, and datagrams from others are counted and dropped.
    """

    def __init__(self, interface: str, channel: str | None, options: dict[str, Any]) -> None:
        self._allows_remote = bool(options.get(ALLOW_REMOTE, False))
        self._local: dict[str, bool] = {}
        super().__init__(interface, channel, options)
        self._name = uuid.uuid4().hex[:12]

    def _open(self, interface: str, channel: str | None, options: dict[str, Any]) -> can.BusABC:
        options = {key: value for key, value in options.items() if key != ALLOW_REMOTE}
        if self._allows_remote:
            return super()._open(interface, channel, options)
        bus = super()._open(interface, channel, {**options, "hop_limit": 0})
        multicast = bus._multicast  # type: ignore[attr-defined]
        receive = multicast.recv

        def receive_local(timeout: float | None = None) -> Any:
            got = receive(timeout)
            if got is None or self._is_local(got[1]):
                return got
            self.discarded.foreign += 1
            return None

        multicast.recv = receive_local
        return bus

    def _is_local(self, sender: Sequence[Any]) -> bool:
        """Whether a datagram came from this machine: from an address to which a socket can be bound."""
        host = str(sender[0])
        if host not in self._local:
            if len(self._local) >= MOST_SENDERS:
                self._local.clear()
            self._local[host] = _is_own_address(host, sender)
        return self._local[host]

    def _message(self, frame: Frame) -> can.Message:
        message = _message(frame)
        message.channel = self._name
        return message

    def _is_own(self, message: can.Message) -> bool:
        return message.channel == self._name


def _is_own_address(host: str, sender: Sequence[Any]) -> bool:
    address = ipaddress.ip_address(host.partition("%")[0])
    if address.is_loopback:
        return True
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0, *sender[2:]))
    except OSError:
        return False
    return True


def _message(frame: Frame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=None if frame.is_remote else frame.data,
        dlc=len(frame.data),
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_rx=False,
    )


def _stamped_frame(message: can.Message) -> tuple[int, Frame] | None:
    """Time and frame; None for what classical CAN does not have: drivers pass on whatever an adapter sends."""
    can_id, is_extended, length = message.arbitration_id, message.is_extended_id, message.dlc
    data = bytes(length) if message.is_remote_frame and 0 <= length <= _MOST_BYTES else bytes(message.data)
    if not 0 <= can_id <= (_HIGHEST_EXTENDED_ID if is_extended else _HIGHEST_ID):
        return None
    if len(data) != length or length > _MOST_BYTES:
        return None
    # A float holds a time since 1970 to microseconds only; rounding recovers the driver's number.
    time_ns = round(message.timestamp * 1e6) * 1000
    return time_ns, Frame(can_id, data, is_extended, message.is_remote_frame)


def _is_decoding(cause: BaseException | None) -> bool:
    """Whether a driver's error has a cause that is not a system error."""
    return cause is not None and not isinstance(cause, OSError | can.CanError)


def _explain(error: BaseException, interface: str, channel: str | None) -> str:
    """Why the bus could not be opened and, if known, what to do."""
    text = first_line(error)
    if isinstance(error, ImportError | can.CanInterfaceNotImplementedError):
        return f"its driver cannot be loaded: {text}; install that, or take another interface, such as canarm"
    if interface == "socketcan" and isinstance(error, OSError):
        name = channel or "vcan0"
        if error.errno == errno.ENODEV:
            return f"there is no such network interface; as root: ip link add {name} type vcan; ip link set {name} up"
        if error.errno == errno.EAFNOSUPPORT:
            return "this kernel has no SocketCAN; take another interface, such as canarm"
    if isinstance(error, WRONG_OPTIONS):
        return f"wrong or missing options: {text}"
    return text
