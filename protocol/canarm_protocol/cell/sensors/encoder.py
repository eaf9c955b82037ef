"""Incremental encoder on a joint's or a motor's shaft, read by a counter card: nominal values only."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ...cards.kind import Wire
from ..table import Sign
from .base import Fitting, Quantity, Sensor, SensorScale


class Encoder(Sensor):
    """Two tracks with `lines` periods per turn of its shaft, and an index. The counter is 0 where the joint is parked.

    It is on the joint's shaft (`shaft = "joint"`) or on the motor's, before the gear: a gear that turns the direction
    round then turns the counts round. `sign` = -1: it counts down as its shaft turns counter-clockwise.
    """

    kind: ClassVar[str] = "encoder"
    title: ClassVar[str] = "encoder"
    quantity: ClassVar[Quantity] = Quantity.POSITION
    wire: ClassVar[Wire] = Wire.PULSES

    lines: Annotated[int, Field(ge=1, le=1_000_000)]
    shaft: Literal["joint", "motor"] = "joint"
    sign: Sign = 1

    def scale(self, fitting: Fitting) -> SensorScale:
        """Radians of the joint per count; the joint is at home where the count is 0."""
        turns = fitting.gear_ratio if self.shaft == "motor" else 1.0
        step = self.sign * math.tau / (self.lines * fitting.edges_per_period * turns)
        return SensorScale(-fitting.home_rad / step, step)

    @property
    def is_reversed(self) -> bool:
        """Whether it counts down as its shaft turns counter-clockwise."""
        return self.sign < 0

    def seen(self) -> tuple[float, float]:
        """Any angle: a counter wraps round."""
        return -math.inf, math.inf
