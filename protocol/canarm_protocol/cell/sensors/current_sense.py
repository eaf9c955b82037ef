"""Current sense of a joint's drive: a voltage proportional to the magnitude of the motor current."""

from typing import ClassVar

from ...cards.kind import highest_code
from ..table import Positive
from .base import AnalogueSensor, Fitting, Quantity, SensorScale


class CurrentSense(AnalogueSensor):
    """0 to `full_scale_a` gives 0 to `full_scale_v`. It is before the bridge, and sees no sign."""

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
        """Amperes per code."""
        return SensorScale(0.0, self.full_scale_a / highest_code(fitting.bits))
