"""Faults of converters: what happens to an 8-bit code. Offset, gain and noise of a code are faults of any signal."""

from dataclasses import dataclass

from ..declaration import Family, SignalFault, TapKind
from ..parameters import parameter

CODES = frozenset({TapKind.DAC_CODE, TapKind.ADC_CODE})
BITS = 8


@dataclass
class StuckBit(SignalFault, name="stuck-bit", family=Family.CONVERTER, acts_on=CODES, is_dangerous=True):
    """One bit of the code is always 0, or always 1."""

    bit: int = parameter("the bit, 0 is the lowest", "", 4, 0, BITS - 1, is_whole=True)
    value: int = parameter("what it always is", "", 1, 0, 1, is_whole=True)

    def apply(self, value: float, now_ns: int) -> float:
        """The code with that bit set or cleared."""
        mask = 1 << self.bit
        return int(value) | mask if self.value else int(value) & ~mask


@dataclass
class MissingCode(SignalFault, name="missing-code", family=Family.CONVERTER, acts_on=CODES):
    """Codes that the converter never gives: the one below them stands in their place.

    That is what a differential nonlinearity of -1 LSB looks like: the code has no width, and its neighbour is wider.
    The codes further up stay where they are, as they do in a converter whose end points are trimmed. The middle is
    where converters miss codes first, since all bits change there.
    """

    code: int = parameter("the lowest code that is missing", "LSB", 128, 1, (1 << BITS) - 1, is_whole=True)
    count: int = parameter("how many are missing", "LSB", 1, 1, (1 << BITS) - 1, is_whole=True)

    def apply(self, value: float, now_ns: int) -> float:
        """The code, or the one below the gap."""
        return self.code - 1 if self.code <= value < self.code + self.count else value
