"""The D/A card of four DAC0808s, eight bits each behind two 4-bit latches."""

from .analogue import codec_of_8_bits, error_values, output_place_16
from .kind import CardKind, RegisterByte, Wire

BITS, NIBBLE = 8, 0x0F


def _latches(_: object, number: int, code: int) -> tuple[RegisterByte, ...]:
    """Two 4-bit latches a channel: the lower nibble, the upper one."""
    first = 2 * (number - 1)
    return RegisterByte(first, code & NIBBLE, NIBBLE), RegisterByte(first + 1, code >> 4, NIBBLE)


DAC0808 = CardKind(
    model="dac0808",
    takes=Wire.CURRENT_COMMAND,
    channels=4,
    is_output=True,
    codec=codec_of_8_bits,
    place=output_place_16,
    registers=_latches,
    highest_error_value=lambda _: (1 << BITS) - 1,
    application_values=lambda _, dictionary, values: error_values(BITS, dictionary, values),
    tap="{joint}.dac.code",
    tap_about="code behind the DAC's latches",
)
