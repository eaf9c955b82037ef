"""The direction latch SC300: eight bits, two per joint or hand, and what the two do to its bridge."""

from collections.abc import Iterator
from enum import IntEnum

from ..canopen.dictionary import (
    DIGITAL_ERROR_MODE,
    DIGITAL_ERROR_VALUE,
    DIGITAL_FILTER_MASK,
    DIGITAL_OUTPUT,
    Dictionary,
)
from .kind import CardKind, Codec, ErrorValues, ObjectValue, Place, RegisterByte, Wire

BITS_PER_JOINT = 2
"""Channel n has bits 2n-2 and 2n-1."""
JOINT_BITS = 0b11
ALL_BITS = 0xFF


class DirectionBits(IntEnum):
    """What two bits of the latch do to a joint's bridge (table 1 of the paper).

    Counter-clockwise is towards positive angles, unless the cell's motor or gear is reversed. `ILLEGAL` asks for both
    sides of the bridge, and its interlock opens.
    """

    OFF = 0b00
    CLOCKWISE = 0b01
    COUNTER_CLOCKWISE = 0b10
    ILLEGAL = 0b11


class HandBits(IntEnum):
    """What two bits of the latch do to the motor of a hand. Its screw keeps what it has without current."""

    KEEP = 0b00
    CLOSE = 0b01
    OPEN = 0b10
    ILLEGAL = 0b11


def _application_values(dictionary: Dictionary, error_values: ErrorValues) -> Iterator[ObjectValue]:
    """Bits of 0x6206 are 0 where an output keeps what it has."""
    shifts = {number: BITS_PER_JOINT * (number - 1) for number in error_values}
    bits = sum((value or 0) << shifts[number] for number, value in error_values.items())
    kept = sum(JOINT_BITS << shifts[number] for number, value in error_values.items() if value is None)
    yield DIGITAL_ERROR_MODE, 1, ALL_BITS & ~kept
    yield DIGITAL_ERROR_VALUE, 1, bits
    if DIGITAL_FILTER_MASK in dictionary:
        yield DIGITAL_FILTER_MASK, 1, ALL_BITS


def _latch(_: object, number: int, code: int) -> tuple[RegisterByte, ...]:
    """Two bits of the one latch, which every address of the slot selects."""
    shift = BITS_PER_JOINT * (number - 1)
    return (RegisterByte(0, code << shift, JOINT_BITS << shift),)


SC300 = CardKind(
    model="sc300",
    takes=Wire.DIRECTION,
    channels=4,
    is_output=True,
    codec=lambda _: Codec(BITS_PER_JOINT),
    place=lambda _, number: Place(DIGITAL_OUTPUT, 1, BITS_PER_JOINT * (number - 1)),
    registers=_latch,
    highest_error_value=lambda _: DirectionBits.COUNTER_CLOCKWISE,
    application_values=lambda _, dictionary, values: _application_values(dictionary, values),
    tap="{joint}.latch",
    tap_about="direction bits behind the latch: 1 clockwise, 2 counter-clockwise",
)
