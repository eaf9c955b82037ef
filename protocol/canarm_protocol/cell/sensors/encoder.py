"""Incremental encoder on a joint's or a motor's shaft, read by a counter card: nominal values only."""

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from ...cards.kind import Wire
from ..table import Sign
from .base import Fitting, Quantity, Sensor, SensorScale

ON_EDGE = 1e-6
"""Of a count: a shaft that stands on an edge up to rounding is beyond it, for encoder and controller alike."""


class Encoder(Sensor):
    """Two tracks with `lines` periods per turn of its shaft, and an index at angle 0, where a period begins.

    The counter is 0 where the joint is parked.

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
        """Radians of the joint per count: a count stands for the middle between its edges.

        The joint is parked at home, so that the edges around the count of 0 are known.
        """
        turns = fitting.gear_ratio if self.shaft == "motor" else 1.0
        step = self.sign * math.tau / (self.lines * fitting.edges_per_period * turns)
        return SensorScale(-(math.floor(fitting.home_rad / step + ON_EDGE) + 0.5), step)

    def counts_per_index(self, edges_per_period: int) -> int:
        """Counts from one pulse of the index to the next."""
        return self.lines * edges_per_period

    @property
    def is_reversed(self) -> bool:
        """Whether it counts down as its shaft turns counter-clockwise."""
        return self.sign < 0

    def seen(self) -> tuple[float, float]:
        """Any angle: a counter wraps round."""
        return -math.inf, math.inf
