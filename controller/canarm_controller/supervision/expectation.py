"""The nominal arm's response to torques: accelerations, with bias forces and inertia refreshed periodically.

Owns the model's side of every residual; measurements and limits are elsewhere.
"""

from collections.abc import Sequence
from operator import mul, sub

import numpy as np
from numpy.typing import NDArray

from ..dynamics import Arm

Rows = Sequence[Sequence[float]]


class ArmExpectation:
    """One arm of any number of joints. `inertia` (rotors included) and its inverse `mobility` are rows of kg·m²."""

    def __init__(self, arm: Arm) -> None:
        count = arm.joint_count
        self._arm, self._rest = arm, (0.0,) * count
        self.still_nm: Sequence[float] = self._rest
        """Torques that keep the arm at its speed: gravity, Coriolis, friction."""
        self._inverse: NDArray[np.float64] = np.zeros((0, 0))
        self.inertia: Rows = ()
        self.mobility: Rows = ()

    def refresh(self, position_rad: Sequence[float], speed_rad_s: Sequence[float]) -> None:
        """Look up what changes slowly."""
        arm = self._arm
        self.still_nm = arm.torque_nm(position_rad, speed_rad_s, self._rest)
        rows = [list(row) for row in arm.inertia(position_rad)]
        for joint, (row, rotor) in enumerate(zip(rows, arm.rotor_inertia, strict=True)):
            row[joint] += rotor
        self.inertia = rows
        self._inverse = np.linalg.inv(np.array(rows))
        self.mobility = self._inverse.tolist()

    def matrix(self) -> NDArray[np.float64]:
        """`mobility` as an array."""
        return self._inverse

    def accelerations(self, torque_nm: Sequence[float]) -> Sequence[float]:
        """What the model makes of torques, rad/s²."""
        left_nm = list(map(sub, torque_nm, self.still_nm))
        return [sum(map(mul, row, left_nm)) for row in self.mobility]


class PairExpectation(ArmExpectation):
    """Two joints in closed form, in a third of the time."""

    def refresh(self, position_rad: Sequence[float], speed_rad_s: Sequence[float]) -> None:
        """Look up what changes slowly."""
        arm = self._arm
        self.still_nm = arm.torque_nm(position_rad, speed_rad_s, self._rest)
        (d11, d12), (_, d22) = arm.inertia(position_rad)
        rotor1, rotor2 = arm.rotor_inertia
        d11 += rotor1
        d22 += rotor2
        determinant = d11 * d22 - d12 * d12
        cross = -d12 / determinant
        self.inertia = (d11, d12), (d12, d22)
        self.mobility = (d22 / determinant, cross), (cross, d11 / determinant)

    def matrix(self) -> NDArray[np.float64]:
        """`mobility` as an array."""
        return np.array(self.mobility)

    def accelerations(self, torque_nm: Sequence[float]) -> tuple[float, float]:
        """What the model makes of torques, rad/s²."""
        (own1, cross), (_, own2) = self.mobility
        (torque1, torque2), (still1, still2) = torque_nm, self.still_nm
        left1, left2 = torque1 - still1, torque2 - still2
        return own1 * left1 + cross * left2, cross * left1 + own2 * left2


def expectation(arm: Arm) -> ArmExpectation:
    """The fastest expectation for `arm`."""
    return PairExpectation(arm) if arm.joint_count == 2 else ArmExpectation(arm)
