"""An encoder counter card: four quadrature decoders with counters of 16 or 32 bits, a CiA 406 multi-sensor encoder."""

from typing import Literal

from .kind import CardKind, Codec, Place, RegisterByte, Settings, Wire

PRESET_VALUES, POSITION_VALUES = 0x6010, 0x6020
"""Preset and position values for multi-sensor devices (CiA 406)."""
INDEX_VALUES, OVERFLOWS, INDEX_PULSES = 0x2100, 0x2101, 0x2102
"""The count at the last pulse of the index; how often the counter wrapped round; how often the index has come."""


class CounterSettings(Settings):
    """Width of the counters, and how many edges of a period they count: one (x1), or all (x4)."""

    counter_bits: Literal[16, 32] = 32
    decoding: Literal[1, 4] = 4


def _codec(settings: Settings) -> Codec:
    assert isinstance(settings, CounterSettings)
    return Codec(settings.counter_bits, is_signed=True)


SPACING = 4
"""Addresses per channel: the bytes of what was latched last, lowest first."""


def _latched(_: object, number: int, code: int) -> tuple[RegisterByte, ...]:
    first = SPACING * (number - 1)
    return tuple(RegisterByte(first + byte, code >> 8 * byte & 0xFF) for byte in range(SPACING))


ENCODER_COUNTER = CardKind(
    model="encoder_counter",
    takes=Wire.PULSES,
    channels=4,
    is_output=False,
    settings=CounterSettings,
    codec=_codec,
    place=lambda _, number: Place(POSITION_VALUES, number),
    registers=_latched,
    tap="{joint}.encoder",
    tap_about="count of {signal}",
)
