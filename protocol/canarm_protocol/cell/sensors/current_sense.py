"""Current sense of a joint's drive: a voltage for the magnitude of the motor's current."""

from typing import ClassVar

from ..table import Positive
from .base import AnalogueSensor, Fitting, Quantity, SensorScale, highest_code


class CurrentSense(AnalogueSensor):
    """`full_scale_a` span 0 to `full_scale_v`. It sits at the one-way stage before the bridge and sees no sign."""

    kind: ClassVar[str] = "current_sense"
    title: ClassVar[str] = "current sense"
    quantity: ClassVar[Quantity] = Quantity.CURRENT
    is_on_motor: ClassVar[bool] = True
    takes_magnitude: ClassVar[bool] = True

    full_scale_a: Positive

    @property
    def nominal_zero_v(self) -> float:
        """Volts without current."""
        return 0.0

    @property
    def volts_per_unit(self) -> float:
        """V/A."""
        return self.full_scale_v / self.full_scale_a

    def scale(self, fitting: Fitting) -> SensorScale:
        """Amperes a code."""
        return SensorScale(0.0, self.full_scale_a / highest_code(fitting.bits))
