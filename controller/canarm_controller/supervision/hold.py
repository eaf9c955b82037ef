"""Brings the arm to a standstill and holds it: the reaction to a failure that leaves sensors and motors usable.

Owns the torque of a safe stop; the trusted state, and the end of the stop, are decided elsewhere.
"""

from collections.abc import Sequence

from ..dynamics import Arm
from ..laws.base import Cycle

LONGEST_S, SHORTEST_S = 0.125, 0.05
"""Bounds of the time from the first cycle to rest; within them, as fast as the amplifiers can."""
RAMP_SHARE = 0.8
"""Share of the amplifier's current that the ramp may use: the rest is for model errors."""
STIFFNESS_RAD_S, DAMPING_RATIO = 12.0, 1.5
LATENCY_CYCLES = 2
"""From a commanded torque to its effect on the speed: it acts from the next SYNC to the one after."""
SHARE = 0.98
"""Share of the amplifier's current: the stop never saturates."""


class SafeHold:
    """τ = M(q)·(q̈_r + 2ζω(q̇_r - q̇) + ω²(q_r - q)) + H + G + friction + bias, along a ramp of q̇_r to zero.

    All joints come to rest at the same time. Where they do is where they are held: the way that the arm takes to begin
    to brake is not made good. `bias_rad_s2` is what the model was known to lack before the failure, such as a payload:
    it is carried on.
    """

    def __init__(self, arm: Arm, cycle: Cycle, bias_rad_s2: Sequence[float], period_s: float) -> None:
        self._arm = arm
        self._position = tuple(cycle.position_rad)
        self._speed = tuple(cycle.velocity_rad_s)
        """That at the beginning."""
        self._bias_nm = [-bias * inertia for bias, inertia in zip(bias_rad_s2, arm.effective_inertia, strict=True)]
        per_ampere = arm.torque_per_ampere
        self._most_nm = [amperes * limit for amperes, limit in zip(per_ampere, arm.max_current_a, strict=True)]
        self._ramp_cycles = max(round(self._stopping_s() / period_s), 1)
        self._ramp_rad_s2 = [-speed / (self._ramp_cycles * period_s) for speed in self._speed]
        self._cycle = 0

    def torque_nm(self, cycle: Cycle) -> list[float]:
        """Torques for one cycle, N·m, within what the amplifiers have."""
        is_ramp = self._cycle < self._ramp_cycles
        if self._cycle < self._ramp_cycles + LATENCY_CYCLES:
            self._position = tuple(cycle.position_rad)
        planned, expected = self._left(self._cycle), self._left(self._cycle - LATENCY_CYCLES)
        rows = zip(
            self._ramp_rad_s2, self._speed, cycle.velocity_rad_s, self._position, cycle.position_rad, strict=True
        )
        aimed = [
            ramp * is_ramp
            + 2.0 * DAMPING_RATIO * STIFFNESS_RAD_S * (expected * first - speed)
            + STIFFNESS_RAD_S**2 * (aim - position)
            for ramp, first, speed, aim, position in rows
        ]
        self._cycle += 1
        model_nm = self._arm.torque_nm(cycle.position_rad, [planned * first for first in self._speed], aimed)
        rows_nm = zip(model_nm, self._bias_nm, self._most_nm, strict=True)
        return [max(-SHARE * most, min(SHARE * most, torque + bias)) for torque, bias, most in rows_nm]

    def _left(self, cycle: int) -> float:
        """What the ramp leaves of the speed in a cycle, as a share."""
        return min(max(1.0 - cycle / self._ramp_cycles, 0.0), 1.0)

    def _stopping_s(self) -> float:
        """How long the ramp takes: what it costs over that of going on at constant speed is inverse to its length."""
        position_rad, rest = self._position, [0.0] * len(self._speed)
        going_on_nm = self._arm.torque_nm(position_rad, self._speed, rest)
        standing_nm = self._arm.torque_nm(position_rad, rest, rest)
        pushed_nm = self._arm.torque_nm(position_rad, rest, [-speed for speed in self._speed])
        hardest = 1.0 / SHORTEST_S
        rows = zip(going_on_nm, standing_nm, pushed_nm, self._bias_nm, self._most_nm, strict=True)
        for going_on, standing, pushed, bias, most in rows:
            cost = pushed - standing
            room = RAMP_SHARE * most - (going_on + bias if cost > 0.0 else -going_on - bias)
            if cost:
                hardest = min(hardest, max(room, 0.0) / abs(cost))
        return min(1.0 / hardest, LONGEST_S) if hardest > 0.0 else LONGEST_S
