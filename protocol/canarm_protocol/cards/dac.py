"""A D/A card of any resolution from 8 to 16 bits: four channels, each of which latches its two bytes together.

It is no particular part; its parameters are those that data sheets of such converters have in common.
"""

from .analogue import ResolutionSettings, codec_of_bits, error_values, output_place
from .kind import CardKind, RegisterByte, Wire

SPACING = 4
"""Addresses per channel."""


def _latches(_: object, number: int, code: int) -> tuple[RegisterByte, ...]:
    """The low byte, and the high byte that loads the converter with both."""
    first = SPACING * (number - 1)
    return RegisterByte(first, code & 0xFF), RegisterByte(first + 1, code >> 8)


DAC = CardKind(
    model="dac",
    takes=Wire.CURRENT_COMMAND,
    channels=4,
    is_output=True,
    settings=ResolutionSettings,
    codec=codec_of_bits,
    place=output_place,
    registers=_latches,
    highest_error_value=lambda settings: codec_of_bits(settings).full_scale,
    application_values=lambda settings, dictionary, values: error_values(
        codec_of_bits(settings).bits, dictionary, values
    ),
    tap="{joint}.dac.code",
    tap_about="code behind the DAC's latches",
)
