"""Opens a CAN bus by python-can's flags, for every program of the project: frames, integer times, one error class.

`canarm` buses go through `HubClientBus` directly, any other python-can interface through `python_can_port`. Only these
two modules turn the exceptions of python-can and its drivers into `BusError`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import can
from can.util import cast_from_string

from ..canopen.frames import Frame
from ..errors import BusError, BusOptionsError
from ..shown import printable, quoted
from .hub_client import DEFAULT_CHANNEL, HubClientBus


@dataclass(slots=True)
class Discarded:
    """What a port received and did not pass on, counted."""

    error_frames: int = 0
    fd_frames: int = 0
    malformed: int = 0
    """Input that is no CAN frame."""
    foreign: int = 0
    """Datagrams from other machines, if those may not use the bus."""
    unsent: int = 0
    """Frames that this kind of bus cannot carry."""


class BusPort(ABC):
    """An open bus. `description` spells it as the command line does; `discarded` counts what `receive` left out."""

    description: str
    discarded: Discarded

    @abstractmethod
    def send(self, frames: Sequence[Frame]) -> None:
        """Send `frames` in order, within a bounded time. Raises `BusError`."""

    def send_stamped(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """As `send`, for (time in ns, frame); the times are sent where the bus can carry them. Raises `BusError`."""
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
    from .python_can_port import open_python_can_port

    return open_python_can_port(interface, channel, options)


def parse_bus_options(words: Iterable[str]) -> dict[str, str | int | float | bool]:
    """Read `key=value` words as python-can's `--bus-kwargs` does: numbers and true/false get their types.

    Raises `BusOptionsError` for a word without `=`, a key given twice, and `interface` and `channel`, which have flags.
    """
    options: dict[str, str | int | float | bool] = {}
    for word in words:
        key, equals, text = word.partition("=")
        name = key.replace("-", "_")
        if not equals or not name.isidentifier():
            raise BusOptionsError(f"bus option {quoted(word)}: write KEY=VALUE, such as port=29536")
        if name in ("interface", "channel"):
            raise BusOptionsError(f"bus option {quoted(word)}: write -{name[0]} {text}")
        if name in options:
            raise BusOptionsError(f"bus option {quoted(word)}: {printable(name)} is given twice")
        try:
            options[name] = cast_from_string(text)
        except ValueError:
            raise BusOptionsError(f"bus option {name}: a number of {len(text)} digits; no option takes that") from None
    return options


class _HubPort(BusPort):
    """A `canarm` bus: frames without `can.Message`."""

    def __init__(self, channel: str | None, options: dict[str, Any]) -> None:
        self.discarded = Discarded()
        try:
            self._bus = HubClientBus(DEFAULT_CHANNEL if channel is None else channel, **options)
        except can.CanError as error:
            raise BusError(str(error)) from error
        except (TypeError, ValueError) as error:
            raise BusOptionsError(f"{bus_flags('canarm', channel, options)}: {error}") from error
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


def bus_flags(interface: str, channel: str | None, options: dict[str, Any]) -> str:
    """The flags that open a bus, as python-can's tools and ours take them.

    `--bus-kwargs` takes all words up to the next flag, so it comes first: `can_player` has a file name at the end.
    """
    named_channel = [] if channel is None else [f"-c {channel}"]
    words = [f"{key}={value}" for key, value in options.items()]
    return " ".join([*(["--bus-kwargs", *words] if words else []), f"-i {interface}", *named_channel])
