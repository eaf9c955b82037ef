"""The A/D card with an ADC0809: eight multiplexed channels of eight bits."""

from .analogue import ConversionSettings, codec_of_8_bits, conversion_us, input_place_16
from .kind import CardKind, RegisterByte, Wire

DATA = 9
"""Where the last result is read; a write to 0-7 starts a conversion of that channel."""

ADC0809 = CardKind(
    model="adc0809",
    takes=Wire.VOLTAGE,
    channels=8,
    is_output=False,
    settings=ConversionSettings,
    codec=codec_of_8_bits,
    place=input_place_16,
    registers=lambda _, number, code: (RegisterByte(DATA, code),),
    channel_us=conversion_us,
    tap="{card}.channel{number}",
    tap_about="code of {signal} after the conversion",
)
