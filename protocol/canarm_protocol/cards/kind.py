"""What is known of a kind of card without emulating it: channels, objects, codes, settings, taps.

Controller, recorder, dashboard and emulator share these descriptors. A card's registers and analogue side are in the
emulator's module of the same name. Nothing here knows a particular kind.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict

from ..canopen.dictionary import Dictionary

ObjectValue = tuple[int, int, int]
"""Index, sub-index and value of an object that a master sets."""
ErrorValues = Mapping[int, int | None]
"""What each wired channel takes when the controller is lost; None: it keeps what it has."""


def highest_code(bits: int) -> int:
    """The full-scale code of `bits` bits."""
    return (1 << bits) - 1


class Wire(StrEnum):
    """The kind of signal that a card's channel takes."""

    CURRENT_COMMAND = "current_command"
    DIRECTION = "direction"
    VOLTAGE = "voltage"
    PULSES = "pulses"
    """The two tracks and the index of a quadrature encoder."""


class Settings(BaseModel):
    """What a cell may set in a card of this kind; most kinds add a few keys."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


@dataclass(frozen=True, slots=True)
class Codec:
    """How a channel's code of `bits` bits sits in its object: shifted left by `shift` bits, the others 0.

    Where codes are unsigned, a negative value is no code: no such converter gives or takes one.
    """

    bits: int
    shift: int = 0
    is_signed: bool = False

    @property
    def full_scale(self) -> int:
        """The highest code."""
        return highest_code(self.bits - self.is_signed)

    @property
    def lowest(self) -> int:
        """The lowest code."""
        return -(1 << self.bits - 1) if self.is_signed else 0

    @property
    def lowest_value(self) -> int:
        """The object's value at the lowest code."""
        return self.lowest << self.shift

    def value(self, code: int) -> int:
        """The object's value for a code."""
        return code << self.shift

    def code(self, value: int) -> int:
        """The code in an object's value, as a converter takes it: an unsigned one is at least 0."""
        return value >> self.shift if value > self.lowest_value else self.lowest


@dataclass(frozen=True, slots=True)
class Place:
    """Where a channel's code is in the object dictionary: an object, and the code's lowest bit in it."""

    index: int
    subindex: int
    start_bit: int = 0


class RegisterByte(NamedTuple):
    """The bits of `mask` of the byte at an address (0 to 15) of the card's slot."""

    address: int
    value: int
    mask: int = 0xFF


@dataclass(frozen=True, slots=True, kw_only=True)
class CardKind:
    """One kind of card. Its EDS file, `[[card]] model` and the emulator's module have its name."""

    model: str
    takes: Wire
    channels: int
    is_output: bool
    settings: type[Settings] = Settings
    codec: Callable[[Settings], Codec]
    place: Callable[[Settings, int], Place]
    """The place of channel `number` (from 1)."""
    registers: Callable[[Settings, int, int], tuple[RegisterByte, ...]]
    """What the computer writes for, or reads of, a code of channel `number` (from 1)."""
    channel_us: Callable[[Settings], int] = lambda _: 0
    """Conversion time per channel, one channel after the other; 0 where all are sampled at SYNC."""
    highest_error_value: Callable[[Settings], int] = lambda _: 0
    """The highest value that an output may take when the controller is lost; 0 for inputs."""
    application_values: Callable[[Settings, Dictionary, ErrorValues], Iterator[ObjectValue]] = (
        lambda settings, dictionary, error_values: iter(())
    )
    """Application objects that a master sets before a run, from the error values of the wired channels."""
    tap: str
    """Pattern of the tap at a channel's code, with `joint`, `card` and `number`."""
    tap_about: str
    """What that tap carries, with `signal`."""
