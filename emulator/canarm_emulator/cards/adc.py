"""An A/D card of 8 to 16 bits: eight multiplexed channels, sample-and-hold, one conversion at a time.

Registers: a write to 0-7 latches that channel and starts a conversion; a read of 8 gives EOC in bit 7; reads of 9 and
10 give the low and the high byte of the last result, unused bits 0.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Card

from ..robot.truth import AdcTruth
from .converters import input_code
from .device import AdcDevice
from .plugged import Connections, Plugged
from .registers import OPEN_BUS

CHANNELS = 8
STATUS, DATA_LOW, DATA_HIGH = 8, 9, 10
END_OF_CONVERSION = 0x80


class AdcCard:
    """Multiplexer, sample-and-hold and converter of `bits` bits; `errors` count in steps of its own."""

    def __init__(
        self,
        bits: int,
        sample: Callable[[int], float],
        full_scale_v: float,
        conversion_ns: int,
        errors: AdcTruth,
    ) -> None:
        self._sample = sample
        self.conversion_ns = conversion_ns
        self.code = input_code(bits, full_scale_v, errors.offset_lsb, errors.gain_error, errors.nonlinearity_lsb)
        """The converter's characteristic: from volts to a code."""
        self._result = 0
        self._converting = 0
        self._done_ns = 0

    def read(self, address: int, now_ns: int) -> int:
        """Status or data. Data read before the end of a conversion is the result of the one before."""
        if address == STATUS:
            return END_OF_CONVERSION if now_ns >= self._done_ns else 0
        if address not in (DATA_LOW, DATA_HIGH):
            return OPEN_BUS
        if now_ns >= self._done_ns:
            self._result = self._converting
        return self._result & 0xFF if address == DATA_LOW else self._result >> 8

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Start a conversion of channel `address`; one that is running is abandoned."""
        if address < CHANNELS:
            if now_ns >= self._done_ns:
                self._result = self._converting
            self._converting = self.code(self._sample(address))
            self._done_ns = now_ns + self.conversion_ns

    def result(self, now_ns: int) -> int:
        """Read both data registers."""
        return self.read(DATA_LOW, now_ns) | self.read(DATA_HIGH, now_ns) << 8


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    bits = card.codec.bits
    device = AdcDevice(
        lambda sample: AdcCard(bits, sample, connections.full_scale_v, card.channel_us * 1000, connections.adc),
        connections.sample,
        bits,
        CHANNELS,
        connections.now,
    )
    return Plugged(device.card, device, device.distort, None, AdcDevice.INPUTS, device.scan)
