"""Faults of converters: what happens to a code. Offset, gain and noise of a code are faults of any signal."""

from dataclasses import dataclass

from ..declaration import Context, Family, SignalFault, TapKind
from ..parameters import bit_of_code, code_of_tap, count_of_codes, parameter

CODES = frozenset({TapKind.DAC_CODE, TapKind.ADC_CODE})


@dataclass
class StuckBit(SignalFault, name="stuck-bit", family=Family.CONVERTER, acts_on=CODES, is_dangerous=True):
    """One bit of the code is always 0, or always 1."""

    bit: int = bit_of_code("the bit, 0 is the lowest")
    value: int = parameter("what it always is", "", 1, 0, 1, is_whole=True)

    def begin(self, context: Context) -> None:
        """A code with a sign is stuck as its two's complement is."""
        low, high = round(context.tap.low), round(context.tap.high)
        self._range, self._half = high - low + 1, -low

    def apply(self, value: float, now_ns: int) -> float:
        """The code with that bit set or cleared."""
        mask = 1 << self.bit
        stuck = int(value) | mask if self.value else int(value) & ~mask
        return (stuck + self._half) % self._range - self._half


@dataclass
class MissingCode(SignalFault, name="missing-code", family=Family.CONVERTER, acts_on=CODES):
    """Codes that the converter never gives: the one below takes their place.

    That is what a differential nonlinearity of -1 LSB looks like: the code has no width, and its neighbour is wider.
    The codes further up stay where they are, as they do in a converter whose end points are trimmed. The middle is
    where converters miss codes first, since all bits change there.
    """

    code: int = code_of_tap("the lowest code that is missing")
    count: int = count_of_codes("how many are missing")

    def apply(self, value: float, now_ns: int) -> float:
        """The code, or the one below the gap."""
        return self.code - 1 if self.code <= value < self.code + self.count else value
