"""Potentiometer on a joint's shaft, a voltage that grows or falls with the angle: nominal values only."""

from collections.abc import Iterator
from typing import ClassVar

from ...cards.kind import highest_code
from ..table import DEGREE, Finite, NonZero, Sign
from .base import AnalogueSensor, Fitting, Quantity, SensorScale, said_twice


class Potentiometer(AnalogueSensor):
    """`range_deg` of the joint's angle gives 0 to `full_scale_v`, and 0 degrees gives `zero_v`.

    With `range_deg` below 0, or `sign` = -1, the voltage falls as the angle grows. Where 0 degrees lie outside the
    joint's limits, that voltage lies outside 0 to `full_scale_v` and never occurs.
    """

    kind: ClassVar[str] = "potentiometer"
    title: ClassVar[str] = "potentiometer"
    quantity: ClassVar[Quantity] = Quantity.POSITION

    range_deg: NonZero
    zero_v: Finite
    sign: Sign = 1

    @property
    def nominal_zero_v(self) -> float:
        """Volts at 0 degrees."""
        return self.zero_v

    @property
    def volts_per_unit(self) -> float:
        """V/rad, signed."""
        return self.sign * (self.full_scale_v / (self.range_deg * DEGREE))

    def scale(self, fitting: Fitting) -> SensorScale:
        """Radians per code."""
        highest = highest_code(fitting.bits)
        return SensorScale(self.zero_v / (self.full_scale_v / highest), self.sign * (self.range_deg * DEGREE / highest))

    def problems(self) -> Iterator[str]:
        """A range that is turned round twice."""
        yield from said_twice("range_deg", self.range_deg, self.sign)
