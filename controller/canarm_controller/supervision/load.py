"""How heavy the payload is, as far as the torques tell that the model lacks: it has inertia as well as weight.

Owns the guess and the inertia that follows; what is learned of the torques, and how the arm brakes, are elsewhere.
"""

import math
from collections.abc import Sequence

from canarm_protocol.cell.model import Cell

from ..dynamics import Arm
from .nominal import heavier_arm
from .uncertainty import COULOMB, PAYLOAD

FRICTION_SIGMA = (COULOMB[1] - COULOMB[0]) / math.sqrt(12.0)
"""Deviation of the box's Coulomb friction, over the nominal one: any is as likely as another."""
PAYLOAD_SIGMA = (PAYLOAD[1] - PAYLOAD[0]) / math.sqrt(12.0)
"""The same of its payload, over the last link."""


class Load:
    """The payload of one arm. `heavier` is the same arm with the most that the box has, `coulomb_nm` its friction."""

    def __init__(self, arm: Arm, heavier: Arm, coulomb_nm: Sequence[float]) -> None:
        self._arm, self._heavier = arm, heavier
        self._per_nm2 = [1.0 / max(FRICTION_SIGMA * each, 1e-9) ** 2 for each in coulomb_nm]

    @classmethod
    def of(cls, cell: Cell, arm: Arm) -> "Load | None":
        """That of the only robot of `cell`; None of several, which may share one."""
        if len(cell.robot) > 1:
            return None
        return cls(arm, heavier_arm(cell.laden[0]), [joint.motor.coulomb_friction_nm for joint in cell.joints])

    def share(self, position_rad: Sequence[float], lacking_nm: Sequence[float]) -> float:
        """The likeliest payload, over that of `heavier`: what is lacking is its weight, and friction."""
        rows = zip(self._heavier.gravity(position_rad), self._arm.gravity(position_rad), strict=True)
        most_nm = [more - own for more, own in rows]
        known = sum([nm * nm * per for nm, per in zip(most_nm, self._per_nm2, strict=True)])
        found = sum([nm * lacking * per for nm, lacking, per in zip(most_nm, lacking_nm, self._per_nm2, strict=True)])
        share = found / (known + (PAYLOAD[1] / PAYLOAD_SIGMA) ** 2)
        return max(PAYLOAD[0] / PAYLOAD[1], min(1.0, share))

    def inertia(self, position_rad: Sequence[float], lacking_nm: Sequence[float]) -> list[list[float]]:
        """What it adds to the arm's inertia, kg·m² (joints, joints)."""
        share = self.share(position_rad, lacking_nm)
        rows = zip(self._heavier.inertia(position_rad), self._arm.inertia(position_rad), strict=True)
        return [[share * (more - own) for more, own in zip(*row, strict=True)] for row in rows]
