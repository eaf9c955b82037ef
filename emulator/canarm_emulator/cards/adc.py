"""An A/D card of 8 to 16 bits: eight multiplexed channels, sample-and-hold, one conversion at a time.

Registers: a write to 0-7 latches that channel and starts a conversion; a read of 8 gives EOC in bit 7; reads of 9 and
10 give the low and the high byte of the last result, unused bits 0.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Card

from ..robot.truth import AdcTruth
from .converters import Converter
from .device import AdcDevice
from .plugged import Connections, Plugged
from .registers import OPEN_BUS

CHANNELS = 8
STATUS, DATA_LOW, DATA_HIGH = 8, 9, 10
END_OF_CONVERSION = 0x80


class AdcCard(Converter):
    """Multiplexer, sample-and-hold and converter of `bits` bits. `sample(channel)` gives the volts at a pin now."""

    def __init__(
        self, bits: int, sample: Callable[[int], float], full_scale_v: float, conversion_ns: int, errors: AdcTruth
    ) -> None:
        super().__init__(bits, full_scale_v, conversion_ns, errors)
        self._sample = sample

    def read(self, address: int, now_ns: int) -> int:
        """Status or data. Data read before the end of a conversion is the result of the one before."""
        if address == STATUS:
            return END_OF_CONVERSION if self.is_done(now_ns) else 0
        if address == DATA_LOW:
            return self.result(now_ns) & 0xFF
        return self.result(now_ns) >> 8 if address == DATA_HIGH else OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Start a conversion of channel `address`; one that is running is abandoned."""
        if address < CHANNELS:
            self.start(self._sample(address), now_ns)


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    bits, sample = card.codec.bits, connections.sample
    registers = AdcCard(bits, sample, connections.full_scale_v, card.channel_us * 1000, connections.adc)
    device = AdcDevice(registers, sample, bits, CHANNELS, connections.clock)
    return Plugged(registers, device, device.distort, None, AdcDevice.INPUTS, device.scan)
