"""How the hands truly hold the object: where robots were parked a little off, it is held a little elsewhere.

Owns the average of what is measured of it, and the slave's joint angles that keep to it.
"""

from collections.abc import Sequence

import numpy as np

from ..dynamics import ClosedChain
from .limits import Floats

EVERY = 4
"""Of the cycles of a search, one in so many is looked at."""
CORRECTIONS = 4


class Grasp:
    """What one hand's distance from its point of the object is on average, over a motion through many counts."""

    def __init__(self, chain: ClosedChain) -> None:
        self._chain = chain
        self._cycles, self._weight = 0, 0.0
        self._gap_m, self._pose_rad = np.zeros(3), np.zeros(1)

    def see(self, position_rad: Sequence[float], reference_rad_s: Sequence[float]) -> None:
        """Take the measured angles of one cycle.

        With its speed as its weight, every count on the way would weigh the same. The speed cubed lets the first and
        the last fade in and out, so that no part of a count is left over at either end.
        """
        self._cycles += 1
        weight = sum(map(abs, reference_rad_s)) ** 3
        if self._cycles % EVERY or not weight:
            return
        self._weight += weight
        self._gap_m = self._gap_m + weight * np.array(self._chain.gap(position_rad))
        self._pose_rad = self._pose_rad + weight * np.array(position_rad)

    def slave_offset(self, shift_rad: Sequence[float], pose_rad: Floats) -> Floats:
        """What to add to the joints (joints,) of a plan that begins at `pose_rad`, so that no hand has to give way.

        The angles that were seen were too small by `shift_rad`. The master keeps to the plan.
        """
        chain, joints = self._chain, len(pose_rad)
        offset = np.zeros(joints)
        if not self._weight:
            return offset
        still = [0.0] * joints
        rows, _ = chain.constraint((self._pose_rad / self._weight).tolist(), still)
        apart_m = self._gap_m / self._weight + rows @ np.array(shift_rad)
        own = chain.slave
        for _ in range(CORRECTIONS):
            pose = (pose_rad + offset).tolist()
            rows, _ = chain.constraint(pose, still)
            offset[own] -= np.linalg.pinv(rows[:, own]) @ (np.array(chain.gap(pose)) - apart_m)
        return offset
