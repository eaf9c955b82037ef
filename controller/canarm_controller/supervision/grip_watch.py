"""Whether two hands still hold one object: then what encoders say of the way from one hand to the other is constant.

Owns that residual and its limit, both from the grips' kinematics. Reactions to a lost object never enter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from canarm_protocol.cell.model import Cell

from ..dynamics import ClosedChain
from .nominal import ROUNDING_LSB, JointNominal, SensorNominal
from .supervisor import Verdict
from .thresholds import twist_rad

OBJECT_LOST = "object-lost"
EVERY_S, TAKEN_UP_S, FIRST_S, MEAN_S = 0.01, 0.5, 2.0, 2.0
"""How often the hands are looked at; when the wires have taken up the arms; until when the mean of what is measured of
the hands is poorly known; and its length."""
SIGMAS = 3.0
"""Deviations of a converter's noise, beyond what rounding does."""
SURE, UNSURE = 1.5, 2.0
"""Limits, as multiples of the worst that readings do to the distance at once. Off its mean a distance can be twice that
at most; in runs without a fault it was 0.9."""
TIMES = 2
"""So many looks in a row."""


@dataclass(frozen=True, slots=True)
class GripLimits:
    """Limits of what the hands may seem to move against each other, m, and what they come from."""

    reading: float
    """The worst that all readings together are off by."""
    twist: float
    """What the softest wires of the box are twisted by once the arms have left their supports."""

    @property
    def sure(self) -> float:
        """The limit once the mean is known."""
        return SURE * self.reading

    @property
    def unsure(self) -> float:
        """The limit while it is poorly known."""
        return UNSURE * self.reading

    @property
    def taking_up(self) -> float:
        """The limit while the arms leave their supports."""
        return self.unsure + self.twist


def grip_limits(cell: Cell, chain: ClosedChain, joints: Sequence[JointNominal]) -> GripLimits:
    """The limits for a cell, at home."""
    home = [math.radians(joint.home_deg) for joint in cell.joints]
    rows, _ = chain.constraint(home, [0.0] * len(home))
    readings, twists = np.array([(_most_off(each.position), twist_rad(each)) for each in joints]).T
    across = np.abs(rows)
    return GripLimits(float(np.linalg.norm(across @ readings)), float(np.linalg.norm(across @ twists)))


class GripWatch:
    """The hands of one run."""

    def __init__(self, chain: ClosedChain, limits: GripLimits, period_s: float) -> None:
        """Looks at the point that the slave holds, as `chain` has it."""
        self._chain, self._limits = chain, limits
        self._every = max(round(EVERY_S / period_s), 1)
        look_s = self._every * period_s
        self._taken_up, self._first, self._mean_looks = (round(each / look_s) for each in (TAKEN_UP_S, FIRST_S, MEAN_S))
        self.start()

    def start(self) -> None:
        """The hands hold it as they are at the first look."""
        self._cycles = self._looks = self._apart = 0
        self._mean_m = (0.0, 0.0, 0.0)

    def step(self, position_rad: Sequence[float]) -> Verdict | None:
        """Judge one cycle."""
        self._cycles += 1
        if self._cycles % self._every:
            return None
        gap_m = self._chain.gap(position_rad)
        looks, limits = self._looks, self._limits
        self._looks += 1
        if not looks:
            self._mean_m = gap_m
        off_m = math.dist(gap_m, self._mean_m)
        limit_m = limits.taking_up if looks < self._taken_up else limits.unsure if looks < self._first else limits.sure
        if off_m <= limit_m:
            self._apart = 0
            since = looks if looks < self._taken_up else looks - self._taken_up
            share = 1.0 / min(since + 1, self._mean_looks)
            x, y, z = (mean + share * (now - mean) for now, mean in zip(gap_m, self._mean_m, strict=True))
            self._mean_m = x, y, z
            return None
        self._apart += 1
        if self._apart < TIMES:
            return None
        return Verdict(
            OBJECT_LOST,
            f"the hands have moved by {1e3 * off_m:.1f} mm against each other, of which sensors explain "
            f"{1e3 * limit_m:.1f} mm: one has lost the object",
        )


def _most_off(sensor: SensorNominal) -> float:
    """The most that one reading is off by, rad."""
    rounding = ROUNDING_LSB * sensor.step
    return 0.5 * sensor.step + SIGMAS * math.sqrt(max(sensor.noise**2 - rounding**2, 0.0))
