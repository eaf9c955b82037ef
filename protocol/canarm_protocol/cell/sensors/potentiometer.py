"""Potentiometer on a joint's shaft, a voltage that grows with the angle: nominal values only."""

from typing import ClassVar

from ...cards.kind import highest_code
from ..table import DEGREE, Finite, Positive
from .base import AnalogueSensor, Fitting, Quantity, SensorScale, Sign


class Potentiometer(AnalogueSensor):
    """`range_deg` of the joint's angle gives 0 to `full_scale_v`, and 0 degrees gives `zero_v`.

    Where 0 degrees lie outside the joint's limits, that voltage lies outside 0 to `full_scale_v` and never occurs.
    """

    kind: ClassVar[str] = "potentiometer"
    title: ClassVar[str] = "potentiometer"
    quantity: ClassVar[Quantity] = Quantity.POSITION

    range_deg: Positive
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
