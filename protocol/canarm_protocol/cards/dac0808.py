"""The D/A card of four DAC0808s, eight bits each behind two 4-bit latches."""

from .analogue import codec_of_8_bits, error_values, output_place_16
from .kind import CardKind, Wire

BITS = 8

DAC0808 = CardKind(
    model="dac0808",
    takes=Wire.CURRENT_COMMAND,
    channels=4,
    is_output=True,
    codec=codec_of_8_bits,
    place=output_place_16,
    highest_error_value=lambda _: (1 << BITS) - 1,
    application_values=lambda _, dictionary, values: error_values(BITS, dictionary, values),
    tap="{joint}.dac.code",
    tap_about="code behind the DAC's latches",
)
