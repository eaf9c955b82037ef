"""What there is to know of a kind of card without emulating it: channels, objects, codes, settings, taps.

A descriptor is data that controller, recorder, dashboard and emulator share; a card's registers and its analogue side
are the emulator's, in a module of the same name. Nothing here knows a particular kind.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from pydantic import BaseModel, ConfigDict

from ..canopen.dictionary import Dictionary

ObjectValue = tuple[int, int, int]
"""Index, sub-index and value of an object that a master sets."""


class Wire(StrEnum):
    """What a card's channel is made for: the kind of signal at the far end of its wire."""

    CURRENT_COMMAND = "current_command"
    DIRECTION = "direction"
    VOLTAGE = "voltage"
    PULSES = "pulses"
    """The two tracks of a quadrature encoder, and its index."""


class Settings(BaseModel):
    """What a cell may set in a card of one kind; most kinds add a few keys."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


@dataclass(frozen=True, slots=True)
class Codec:
    """How a channel's code of `bits` bits stands in its object: `shift` bits further up, the rest is 0.

    A code without sign that is received negative is no code at all: no such converter gives or takes one.
    """

    bits: int
    shift: int = 0
    is_signed: bool = False

    @property
    def full_scale(self) -> int:
        """The highest code."""
        return (1 << self.bits - self.is_signed) - 1

    @property
    def lowest(self) -> int:
        """The lowest code."""
        return -(1 << self.bits - 1) if self.is_signed else 0

    @property
    def lowest_value(self) -> int:
        """The least value of the object that is a code."""
        return self.lowest << self.shift

    def value(self, code: int) -> int:
        """The object's value for a code."""
        return code << self.shift

    def code(self, value: int) -> int:
        """The code in an object's value, as a converter takes it: without sign, 0 is the least."""
        return value >> self.shift if value > self.lowest_value else self.lowest


@dataclass(frozen=True, slots=True)
class Place:
    """Where a channel's code stands in the object dictionary: an object, and its lowest bit there."""

    index: int
    subindex: int
    start_bit: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class CardKind:
    """One kind of card. Its name is that of its EDS file, of `[[card]] model`, and of the emulator's module."""

    model: str
    takes: Wire
    channels: int
    is_output: bool
    settings: type[Settings] = Settings
    codec: Callable[[Settings], Codec]
    place: Callable[[Settings, int], Place]
    """Where channel `number` (from 1) stands."""
    channel_us: Callable[[Settings], int] = lambda _: 0
    """How long a channel takes to convert after the one before; 0 where all are taken at SYNC."""
    highest_error_value: Callable[[Settings], int] = lambda _: 0
    """Of an output that a lost controller leaves behind; an input has none."""
    application_values: Callable[[Settings, Dictionary, Mapping[int, int]], Iterator[ObjectValue]] = (
        lambda settings, dictionary, error_values: iter(())
    )
    """Application objects that a master sets before a run, from the error value of each wired channel."""
    tap: str
    """Where faults reach a channel's code, by `joint`, `card` and `number`."""
    tap_about: str
    """What flows there, by `signal`."""
