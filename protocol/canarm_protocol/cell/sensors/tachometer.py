"""Tachometer on a joint's motor: a voltage either side of a middle one. Nothing of the true one's errors."""

from collections.abc import Iterator
from typing import ClassVar

from ..table import NonNegative, Positive
from .base import AnalogueSensor, Fitting, Quantity, SensorScale, Sign, highest_code


class Tachometer(AnalogueSensor):
    """`full_scale_rad_s` of joint speed span `zero_v`, where the joint stands, to `full_scale_v`."""

    kind: ClassVar[str] = "tachometer"
    title: ClassVar[str] = "tachometer"
    quantity: ClassVar[Quantity] = Quantity.VELOCITY
    is_on_motor: ClassVar[bool] = True

    full_scale_rad_s: Positive
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
        """Radians per second a code."""
        volts = self.full_scale_v / highest_code(fitting.bits)
        span_v = self.full_scale_v - self.zero_v
        return SensorScale(self.zero_v / volts, self.sign * (self.full_scale_rad_s / span_v * volts))

    def problems(self) -> Iterator[str]:
        """A zero that leaves one way of turning without voltage."""
        if not 0.0 < self.zero_v < self.full_scale_v:
            yield f"zero_v = {self.zero_v:g}: must lie between 0 and full_scale_v = {self.full_scale_v:g}"
