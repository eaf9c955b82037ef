"""The A/D card: an ADC0809, eight multiplexed channels of eight bits, one conversion at a time.

Registers: a write to 0-7 latches that channel and starts a conversion; a read of 8 gives EOC in bit 7; a read of 9
gives the last result. The converter has no sample-and-hold; the input is sampled at the start, which is right while it
moves less than half a step during the conversion.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Card

from ..robot.truth import AdcTruth
from .converters import NO_ERRORS, Converter
from .device import AdcDevice
from .plugged import Connections, Plugged
from .registers import OPEN_BUS

CHANNELS = 8
BITS = 8
STATUS, DATA = 8, 9
END_OF_CONVERSION = 0x80


class Adc0809Card(Converter):
    """Multiplexer and converter. `sample(channel)` gives the volts at an input pin now.

    The data sheet's total error is 0.5 to 1 LSB.
    """

    def __init__(
        self, sample: Callable[[int], float], full_scale_v: float, conversion_ns: int, errors: AdcTruth = NO_ERRORS
    ) -> None:
        super().__init__(BITS, full_scale_v, conversion_ns, errors)
        self._sample = sample

    def read(self, address: int, now_ns: int) -> int:
        """Status or data. Data read before the end of a conversion is the result of the one before."""
        if address == STATUS:
            return END_OF_CONVERSION if self.is_done(now_ns) else 0
        return self.result(now_ns) if address == DATA else OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Start a conversion of channel `address`; one that is running is abandoned."""
        if address < CHANNELS:
            self.start(self._sample(address), now_ns)


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    sample = connections.sample
    registers = Adc0809Card(sample, connections.full_scale_v, card.channel_us * 1000, connections.adc)
    device = AdcDevice(registers, sample, BITS, CHANNELS, connections.clock)
    return Plugged(registers, device, device.distort, None, AdcDevice.INPUTS, device.scan)
