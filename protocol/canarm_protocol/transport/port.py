"""Opening a CAN bus by python-can's flags, for every program of the project: frames and integer times, one error class.

`canarm` buses take the short way through `HubClientBus`; any other python-can interface goes through `can.Message`.
What python-can and its drivers raise becomes `BusError` here and nowhere else.
"""

import errno
import select
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import can
from can.util import cast_from_string

from ..canopen.frames import Frame
from ..errors import BusError
from .hub_client import DEFAULT_CHANNEL, HubClientBus

MAX_FRAMES_PER_RECEIVE = 4096
"""Bound on one `receive`, so that a bus that never falls silent cannot hold its reader."""

SEND_TIMEOUT_S = 1.0


@dataclass(slots=True)
class Discarded:
    """What a port received and did not pass on, counted."""

    error_frames: int = 0
    fd_frames: int = 0


class BusPort(ABC):
    """An open bus. `description` spells it as the command line does; `discarded` counts what `receive` left out."""

    description: str
    discarded: Discarded

    @abstractmethod
    def send(self, frames: Sequence[Frame]) -> None:
        """Send `frames` in order. Never waits for ever. Raises `BusError`."""

    def send_stamped(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """As `send`, for (time in ns, frame); the times go along where the other side can be told. Raises
        `BusError`.
        """
        self.send([frame for _, frame in frames])

    @abstractmethod
    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        """Return (time in ns, frame) of what has arrived, in order; wait up to `timeout_s` for the first.

        The times are those of the bus's own clock. Raises `BusError` when the bus is lost.
        """

    @abstractmethod
    def fileno(self) -> int | None:
        """File descriptor that is readable when `receive` has something, or `None` where there is none."""

    @abstractmethod
    def close(self) -> None:
        """Give the bus back. May be called again."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def open_port(interface: str, channel: str | None = None, **options: Any) -> BusPort:
    """Open a bus as `-i interface -c channel key=value …` says; without a channel, the interface's default.

    Raises `BusError`: unknown interface, driver library missing, no such channel, nobody there, wrong options.
    """
    if interface == "canarm":
        return _HubPort(channel, options)
    special = {"slcan": _SlcanPort, "udp_multicast": _MulticastPort}
    return special.get(interface, _PythonCanPort)(interface, channel, options)


def parse_bus_options(words: Iterable[str]) -> dict[str, str | int | float | bool]:
    """Read `key=value` words as python-can's `--bus-kwargs` does: numbers and true/false get their types.

    Raises `BusError` for a word without `=`, a key given twice, and `interface` and `channel`, which have flags.
    """
    options: dict[str, str | int | float | bool] = {}
    for word in words:
        key, equals, text = word.partition("=")
        name = key.replace("-", "_")
        if not equals or not name.isidentifier():
            raise BusError(f"bus option {word!r}: write KEY=VALUE, such as port=29536")
        if name in ("interface", "channel"):
            raise BusError(f"bus option {word!r}: write -{name[0]} {text}")
        if name in options:
            raise BusError(f"bus option {word!r}: {name} is given twice")
        try:
            options[name] = cast_from_string(text)
        except ValueError:
            raise BusError(f"bus option {name}: a number of {len(text)} digits; no option takes that") from None
    return options


class _HubPort(BusPort):
    """The short way: frames without `can.Message`."""

    def __init__(self, channel: str | None, options: dict[str, Any]) -> None:
        self.discarded = Discarded()
        try:
            self._bus = HubClientBus(DEFAULT_CHANNEL if channel is None else channel, **options)
        except can.CanError as error:
            raise BusError(str(error)) from error
        except (TypeError, ValueError) as error:
            raise BusError(f"{_flags('canarm', channel, options)}: {error}") from error
        self.description = self._bus.flags

    def send(self, frames: Sequence[Frame]) -> None:
        try:
            self._bus.send_frames(frames)
        except can.CanError as error:
            raise BusError(str(error)) from error

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        try:
            frames = self._bus.receive_frames(timeout_s)
        except can.CanError as error:
            raise BusError(str(error)) from error
        self.discarded.error_frames = self._bus.error_frames
        return frames

    def fileno(self) -> int | None:
        return self._bus.fileno()

    def close(self) -> None:
        self._bus.shutdown()


class _PythonCanPort(BusPort):
    """The long way: any bus that python-can knows, its own configuration files and environment included."""

    def __init__(self, interface: str, channel: str | None, options: dict[str, Any]) -> None:
        self.discarded = Discarded()
        self.description = _flags(interface, channel, options)
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise BusError(f"{self.description}: python-can knows no such interface; it knows {known}")
        # Own frames cannot be told from others': SocketCAN marks whatever this host sent as not received.
        if options.get("receive_own_messages"):
            raise BusError(f"{self.description}: leave receive_own_messages out; own frames must not come back")
        try:
            self._bus = can.Bus(interface=interface, channel=channel, **options)
        # Drivers raise whatever they like, from ImportError to ctypes' own.
        except Exception as error:
            raise BusError(f"{self.description}: {_explain(error, interface, channel)}") from error

    def send(self, frames: Sequence[Frame]) -> None:
        try:
            for frame in frames:
                self._bus.send(self._message(frame), timeout=SEND_TIMEOUT_S)
        except Exception as error:
            raise BusError(f"{self.description}: cannot send: {_one_line(error)}") from error

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        deadline_s = time.monotonic() + timeout_s
        frames: list[tuple[int, Frame]] = []
        try:
            while not frames and (message := self._bus.recv(timeout_s)) is not None:
                self._drain(message, frames)
                timeout_s = deadline_s - time.monotonic()
                if timeout_s <= 0:
                    break
        except Exception as error:
            raise BusError(f"{self.description}: lost: {_one_line(error)}") from error
        return frames

    def _drain(self, first: can.Message, frames: list[tuple[int, Frame]]) -> None:
        message: can.Message | None = first
        remaining = MAX_FRAMES_PER_RECEIVE
        while message is not None:
            remaining -= 1
            if self._is_own(message):
                pass
            elif message.is_error_frame:
                self.discarded.error_frames += 1
            elif message.is_fd:
                self.discarded.fd_frames += 1
            else:
                frames.append(_stamped_frame(message))
            message = self._receive_at_once() if remaining else None

    def _receive_at_once(self) -> can.Message | None:
        return self._bus.recv(0)

    def _message(self, frame: Frame) -> can.Message:
        return _message(frame)

    def _is_own(self, message: can.Message) -> bool:
        """Whether `message` was sent through this port and came back. Drivers keep such to themselves, as a rule."""
        return False

    def fileno(self) -> int | None:
        try:
            descriptor = self._bus.fileno()
        except (NotImplementedError, OSError):
            return None
        return descriptor if descriptor >= 0 else None

    def close(self) -> None:
        try:
            self._bus.shutdown()
        except Exception as error:
            raise BusError(f"{self.description}: cannot close: {_one_line(error)}") from error


class _SlcanPort(_PythonCanPort):
    """python-can's slcan driver keeps nothing back, so the serial line itself tells whether there is more.

    Its `recv(0)` waits 1 ms where there is nothing, and returns `None` for an acknowledgement with frames behind it.
    """

    def _receive_at_once(self) -> can.Message | None:
        descriptor = self.fileno()
        if descriptor is None:  # Windows
            return self._bus.recv(0)
        for _ in range(MAX_FRAMES_PER_RECEIVE):
            if not select.select((descriptor,), (), (), 0)[0]:
                break
            if (message := self._bus.recv(0)) is not None:
                return message
        return None


class _MulticastPort(_PythonCanPort):
    """python-can's udp_multicast returns what it has sent, and carries the channel's name with every frame.

    A name of its own tells this port's frames from those of others; nobody else looks at it.
    """

    def __init__(self, interface: str, channel: str | None, options: dict[str, Any]) -> None:
        super().__init__(interface, channel, options)
        self._name = uuid.uuid4().hex[:12]

    def _message(self, frame: Frame) -> can.Message:
        message = _message(frame)
        message.channel = self._name
        return message

    def _is_own(self, message: can.Message) -> bool:
        return message.channel == self._name


def _message(frame: Frame) -> can.Message:
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_remote_frame=frame.is_remote,
        is_rx=False,
    )


def _stamped_frame(message: can.Message) -> tuple[int, Frame]:
    # A float has no more than microseconds of a time since 1970; rounding gives back the driver's number.
    time_ns = round(message.timestamp * 1e6) * 1000
    data = b"" if message.is_remote_frame else bytes(message.data)
    return time_ns, Frame(message.arbitration_id, data, message.is_extended_id, message.is_remote_frame)


def _flags(interface: str, channel: str | None, options: dict[str, Any]) -> str:
    named_channel = [] if channel is None else [f"-c {channel}"]
    words = [f"{key}={value}" for key, value in options.items()]
    return " ".join([f"-i {interface}", *named_channel, *(["--bus-kwargs", *words] if words else [])])


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _explain(error: BaseException, interface: str, channel: str | None) -> str:
    """What went wrong at opening, and what to do where that is known."""
    text = _one_line(error)
    if isinstance(error, ImportError | can.CanInterfaceNotImplementedError):
        return f"its driver cannot be loaded: {text}; install that, or take another interface, such as canarm"
    if interface == "socketcan" and isinstance(error, OSError):
        name = channel or "vcan0"
        if error.errno == errno.ENODEV:
            return f"there is no such network interface; as root: ip link add {name} type vcan; ip link set {name} up"
        if error.errno == errno.EAFNOSUPPORT:
            return "this kernel has no SocketCAN; take another interface, such as canarm"
    if isinstance(error, TypeError | ValueError | KeyError):
        return f"wrong or missing options: {text}"
    return text
