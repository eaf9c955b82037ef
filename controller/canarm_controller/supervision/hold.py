"""Brings the arm to a standstill and holds it: the reaction to a failure that leaves sensors and motors usable.

Owns the torque of a safe stop; the trusted state, and the end of the stop, are decided elsewhere.
"""

from collections.abc import Sequence

from ..dynamics import Arm
from ..laws.base import Cycle

STOPPING_S, TORQUE_SHARE = 0.125, 0.4
"""From the fastest speed to rest, unless that takes more than this share of the amplifier's torque: gravity may take
another half."""
STIFFNESS_RAD_S, DAMPING_RATIO = 12.0, 1.0
SHARE = 0.98
"""Of the amplifier's current: the stop never saturates."""


class SafeHold:
    """τ = G(q) + friction + bias + D_ii·(q̈_r + 2ζω(q̇_r - q̇) + ω²(q_r - q)), along a ramp of q̇_r to zero.

    `bias_rad_s2` is what the model was known to lack before the failure, such as a payload: it is carried on.
    """

    def __init__(
        self, arm: Arm, cycle: Cycle, bias_rad_s2: Sequence[float], fastest_rad_s: Sequence[float], period_s: float
    ) -> None:
        self._arm, self._period_s = arm, period_s
        self._position = list(cycle.position_rad)
        self._speed = list(cycle.velocity_rad_s)
        self._bias_nm = [-bias * inertia for bias, inertia in zip(bias_rad_s2, arm.effective_inertia, strict=True)]
        self._limit_nm = [
            SHARE * amperes * limit for amperes, limit in zip(arm.torque_per_ampere, arm.max_current_a, strict=True)
        ]

        torques = zip(arm.torque_per_ampere, arm.max_current_a, arm.effective_inertia, strict=True)
        self._deceleration = [
            min(fastest / STOPPING_S, TORQUE_SHARE * per_ampere * amperes / inertia)
            for fastest, (per_ampere, amperes, inertia) in zip(fastest_rad_s, torques, strict=True)
        ]

    def torque_nm(self, cycle: Cycle) -> list[float]:
        """Torques for one cycle, N·m, within what the amplifiers have."""
        gravity, friction = self._arm.gravity(cycle.position_rad), self._arm.friction(self._speed)
        torques = []
        for joint, inertia in enumerate(self._arm.effective_inertia):
            speed = self._speed[joint]
            fastest = self._deceleration[joint]
            change = max(-fastest, min(fastest, -speed / self._period_s))
            error = self._position[joint] - cycle.position_rad[joint]
            rate = speed - cycle.velocity_rad_s[joint]
            aimed = change + 2.0 * DAMPING_RATIO * STIFFNESS_RAD_S * rate + STIFFNESS_RAD_S**2 * error
            torque = gravity[joint] + friction[joint] + self._bias_nm[joint] + inertia * aimed
            limit = self._limit_nm[joint]
            torques.append(max(-limit, min(limit, torque)))
            self._position[joint] += self._period_s * (speed + 0.5 * self._period_s * change)
            self._speed[joint] = speed + self._period_s * change
        return torques
