"""An A/D card of any resolution from 8 to 16 bits: eight multiplexed channels, one conversion at a time.

It is no particular part; its parameters are those that data sheets of such converters have in common.
"""

from .analogue import AdcSettings, codec_of_bits, conversion_us, input_place
from .kind import CardKind, Wire

ADC = CardKind(
    model="adc",
    takes=Wire.VOLTAGE,
    channels=8,
    is_output=False,
    settings=AdcSettings,
    codec=codec_of_bits,
    place=input_place,
    channel_us=conversion_us,
    tap="{card}.channel{number}",
    tap_about="code of {signal} after the conversion",
)
