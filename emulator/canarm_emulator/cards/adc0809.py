"""The A/D card: an ADC0809, eight multiplexed channels of eight bits, one conversion at a time.

Registers: a write to 0-7 latches that channel and starts a conversion; a read of 8 gives EOC in bit 7; a read of 9
gives the last result. The converter has no sample-and-hold of its own; the input is taken at the start, which is right
as long as it moves less than half a step during the conversion.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Card

from .converters import input_code
from .device import AdcDevice
from .plugged import Connections, Plugged
from .registers import OPEN_BUS

CHANNELS = 8
BITS = 8
STATUS, DATA = 8, 9
END_OF_CONVERSION = 0x80


class Adc0809Card:
    """Multiplexer and converter.

    `sample(channel)` gives the volts at an input pin. The errors are those of `input_code`; the data sheet's total is
    0.5 to 1 LSB.
    """

    def __init__(
        self,
        sample: Callable[[int], float],
        full_scale_v: float,
        conversion_ns: int,
        offset_lsb: float = 0.0,
        gain_error: float = 0.0,
        nonlinearity_lsb: float = 0.0,
    ) -> None:
        self._sample = sample
        self.conversion_ns = conversion_ns
        self.code = input_code(BITS, full_scale_v, offset_lsb, gain_error, nonlinearity_lsb)
        """The converter's characteristic: from volts to a code."""
        self._result = 0
        self._converting = 0
        self._done_ns = 0

    def read(self, address: int, now_ns: int) -> int:
        """Status or data. Data read before the end of a conversion is the result of the one before."""
        if address == DATA:
            if now_ns >= self._done_ns:
                self._result = self._converting
            return self._result
        if address == STATUS:
            return END_OF_CONVERSION if now_ns >= self._done_ns else 0
        return OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Start a conversion of channel `address`; one that is running is abandoned."""
        if address < CHANNELS:
            if now_ns >= self._done_ns:
                self._result = self._converting
            self._converting = self.code(self._sample(address))
            self._done_ns = now_ns + self.conversion_ns

    def result(self, now_ns: int) -> int:
        """Read the data register."""
        return self.read(DATA, now_ns)


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    errors = connections.adc
    device = AdcDevice(
        lambda sample: Adc0809Card(
            sample,
            connections.full_scale_v,
            card.channel_us * 1000,
            errors.offset_lsb,
            errors.gain_error,
            errors.nonlinearity_lsb,
        ),
        connections.sample,
        card.codec.bits,
        CHANNELS,
        connections.now,
    )
    return Plugged(device.card, device, device.distort, None, AdcDevice.INPUTS, device.scan)
