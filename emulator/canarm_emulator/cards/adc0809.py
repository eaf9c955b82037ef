"""The A/D card: an ADC0809, eight multiplexed channels of eight bits, one conversion at a time.

Registers: a write to 0-7 latches that channel and starts a conversion; a read of 8 gives EOC in bit 7; a read of 9
gives the last result. The converter has no sample-and-hold of its own; the input is taken at the start, which is right
as long as it moves less than half a step during the conversion.
"""

from collections.abc import Callable

from .registers import OPEN_BUS

CHANNELS = 8
FULL_SCALE_CODE = 255
STATUS, DATA = 8, 9
END_OF_CONVERSION = 0x80


class Adc0809Card:
    """Multiplexer and converter.

    `sample(channel)` gives the volts at an input pin. The errors: `offset_lsb`, `gain_error` (a fraction of the
    reading) and `nonlinearity_lsb` (a bow between the end points); the data sheet's total is 0.5 to 1 LSB. The
    reference is trimmed so that `full_scale_v` reads 255.
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
        self._conversion_ns = conversion_ns
        self._gain = FULL_SCALE_CODE / full_scale_v * (1.0 + gain_error)
        self._offset = 0.5 + offset_lsb
        self._bow = 4.0 * nonlinearity_lsb / FULL_SCALE_CODE**2
        self._result = 0
        self._converting = 0
        self._done_ns = 0

    def read(self, address: int, now_ns: int) -> int:
        """Status or data. Data read before the end of a conversion is the result of the one before."""
        if address == STATUS:
            return END_OF_CONVERSION if now_ns >= self._done_ns else 0
        if address == DATA:
            if now_ns >= self._done_ns:
                self._result = self._converting
            return self._result
        return OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Start a conversion of channel `address`; one that is running is abandoned."""
        if address < CHANNELS:
            if now_ns >= self._done_ns:
                self._result = self._converting
            self._converting = self.code(self._sample(address))
            self._done_ns = now_ns + self._conversion_ns

    def code(self, volts: float) -> int:
        """The converter's transfer function."""
        step = volts * self._gain if volts > 0.0 else 0.0
        code = int(step + self._offset + self._bow * step * (FULL_SCALE_CODE - step))
        return 0 if code < 0 else FULL_SCALE_CODE if code > FULL_SCALE_CODE else code
