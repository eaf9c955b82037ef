"""An A/D card of any resolution from 8 to 16 bits: eight multiplexed channels, one conversion at a time.

It is no particular part; its parameters are those that data sheets of such converters have in common.
"""

from .analogue import AdcSettings, codec_of_bits, conversion_us, input_place
from .kind import CardKind, RegisterByte, Wire

DATA_LOW, DATA_HIGH = 9, 10
"""Where the two bytes of the last result are read; a write to 0-7 starts a conversion of that channel."""

ADC = CardKind(
    model="adc",
    takes=Wire.VOLTAGE,
    channels=8,
    is_output=False,
    settings=AdcSettings,
    codec=codec_of_bits,
    place=input_place,
    registers=lambda _, number, code: (RegisterByte(DATA_LOW, code & 0xFF), RegisterByte(DATA_HIGH, code >> 8)),
    channel_us=conversion_us,
    tap="{card}.channel{number}",
    tap_about="code of {signal} after the conversion",
)
