"""Tachometer on a joint's motor, a voltage on either side of a middle one: nominal values only."""

from collections.abc import Iterator
from typing import ClassVar

from ...cards.kind import highest_code
from ..table import NonNegative, NonZero, Sign
from .base import AnalogueSensor, Fitting, Quantity, SensorScale, said_twice


class Tachometer(AnalogueSensor):
    """0 to `full_scale_rad_s` of joint speed gives `zero_v` to `full_scale_v`.

    With `full_scale_rad_s` below 0, or `sign` = -1, the voltage falls as the speed grows. It is that of the joint: what
    the gear does to the direction is in it.
    """

    kind: ClassVar[str] = "tachometer"
    title: ClassVar[str] = "tachometer"
    quantity: ClassVar[Quantity] = Quantity.VELOCITY
    is_on_motor: ClassVar[bool] = True

    full_scale_rad_s: NonZero
    zero_v: NonNegative
    sign: Sign = 1

    @property
    def nominal_zero_v(self) -> float:
        """Volts at standstill."""
        return self.zero_v

    @property
    def volts_per_unit(self) -> float:
        """V·s/rad of joint speed, signed."""
        return self.sign * ((self.full_scale_v - self.zero_v) / self.full_scale_rad_s)

    def scale(self, fitting: Fitting) -> SensorScale:
        """Radians per second per code."""
        volts = self.full_scale_v / highest_code(fitting.bits)
        span_v = self.full_scale_v - self.zero_v
        return SensorScale(self.zero_v / volts, self.sign * (self.full_scale_rad_s / span_v * volts))

    def problems(self) -> Iterator[str]:
        """A zero that leaves no voltage for one direction, a range that is turned round twice."""
        yield from said_twice("full_scale_rad_s", self.full_scale_rad_s, self.sign)
        if not 0.0 < self.zero_v < self.full_scale_v:
            yield f"zero_v = {self.zero_v:g}: must lie between 0 and full_scale_v = {self.full_scale_v:g}"
