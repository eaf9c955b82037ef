"""How the joints' speeds go to zero in a safe stop, and what elastic drive wires make of it.

Owns the planned motion and its length; feedback, and what the model lacks, are elsewhere.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ..dynamics import Arm

LONGEST_S, SHORTEST_S = 0.125, 0.05
"""Bounds of the time from the first cycle to rest; within them, as fast as the amplifiers can."""
SMOOTH_S, LONGEST_SMOOTH_S = 0.08, 0.11
"""The same of a smooth way: the longer, the less it swings, but the arm is to stand within 100 ms, and its torque is
two cycles late. After 81 % of its way it has 5 % of its speed. Where the amplifiers need longer, a ramp is shorter."""
RAMP_SHARE = 0.8
"""Share of the amplifier's current that braking may use: the rest is for model errors."""
SMOOTH_PEAK = 1.875
"""Highest deceleration of the smooth way over that of a ramp: 30·s²(1 - s)² at s = 1/2."""


@dataclass(frozen=True, slots=True)
class Moment:
    """One cycle of the plan for links: speed in rad/s and its derivatives, one per joint."""

    speed: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]
    snap: Sequence[float]


class Braking:
    """From `speed_rad_s` to rest, all joints at the same time.

    A ramp is the shortest way. On elastic wires it sets the links swinging on motors that stand. There the speed is a
    polynomial of the fifth degree that begins with the present acceleration and ends without any, and the motor leads
    its link by what the wire is twisted by: the link's motion is a flat output of an elastic joint (Spong 1987).
    `compliance_rad_nm` is the wires', 0 of a rigid one; `lacking_nm` what the model's torque is short of; `load_kg_m2`
    (joints, joints) what a payload adds to the arm's inertia.
    """

    def __init__(
        self, arm: Arm, position_rad: Sequence[float], speed_rad_s: Sequence[float], start_rad_s2: Sequence[float],
        compliance_rad_nm: Sequence[float], lacking_nm: Sequence[float],
        load_kg_m2: Sequence[Sequence[float]], period_s: float,
    ) -> None:  # fmt: skip
        self._arm, self._compliance, self._load = arm, compliance_rad_nm, load_kg_m2
        self._speed, self._start = tuple(speed_rad_s), tuple(start_rad_s2)
        self._rest = Moment(*[(0.0,) * len(self._speed)] * 4)
        ramp_per_s, smooth_per_s = self._rates_per_s(position_rad, lacking_nm)
        self._is_smooth = any(compliance_rad_nm) and smooth_per_s * LONGEST_SMOOTH_S >= 1.0
        per_s = min(smooth_per_s, 1.0 / SMOOTH_S) if self._is_smooth else min(ramp_per_s, 1.0 / SHORTEST_S)
        length_s = min(1.0 / per_s, LONGEST_S) if per_s > 0.0 else LONGEST_S
        self.cycles = max(round(length_s / period_s), 1)
        """Length of the way."""
        self._length_s = self.cycles * period_s

    def at(self, cycle: int) -> Moment:
        """The plan for a cycle; before the first it is at its beginning."""
        if cycle >= self.cycles:
            return self._rest
        share = max(cycle, 0) / self.cycles
        if self._is_smooth:
            return self._smooth(share, self._length_s)
        zero = self._rest.speed
        slope = [-speed / self._length_s for speed in self._speed]
        return Moment([speed * (1.0 - share) for speed in self._speed], slope, zero, zero)

    def ahead_rad_s(self, moment: Moment, position_rad: Sequence[float]) -> list[float]:
        """By how much motors are faster than their links: as fast as their wires are twisted."""
        return self._twisted(self._compliance, moment.jerk, position_rad)

    def beyond_nm(self, moment: Moment, position_rad: Sequence[float]) -> list[float]:
        """Torques that accelerate rotors accordingly, beyond their links, and the payload."""
        twisted = self._twisted(self._compliance, moment.snap, position_rad)
        load_nm = self._loaded(moment.acceleration)
        rows = zip(self._arm.rotor_inertia, twisted, load_nm, strict=True)
        return [rotor * change + load for rotor, change, load in rows]

    def _loaded(self, acceleration: Sequence[float]) -> list[float]:
        return [sum([part * each for part, each in zip(row, acceleration, strict=True)]) for row in self._load]

    def _twisted(self, compliance: Sequence[float], of: Sequence[float], position_rad: Sequence[float]) -> list[float]:
        """Compliance times the links' inertia times a derivative of their speeds."""
        if not self._is_smooth:
            return [0.0] * len(of)
        rows = zip(compliance, self._arm.inertia(position_rad), self._loaded(of), strict=True)
        return [
            each * (sum([part * value for part, value in zip(row, of, strict=True)]) + load) for each, row, load in rows
        ]

    def _smooth(self, s: float, length_s: float) -> Moment:
        speed, acceleration, jerk, snap = [], [], [], []
        for v, start in zip(self._speed, self._start, strict=True):
            a = start * length_s
            speed.append(
                v * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) + a * s * (1.0 - s**2 * (6.0 - 8.0 * s + 3.0 * s**2))
            )
            acceleration.append(
                (-30.0 * v * (s - s**2) ** 2 + a * (1.0 - s**2 * (18.0 - 32.0 * s + 15.0 * s**2))) / length_s
            )
            jerk.append(
                -s * (v * (60.0 - 180.0 * s + 120.0 * s**2) + a * (36.0 - 96.0 * s + 60.0 * s**2)) / length_s**2
            )
            snap.append(-(v * (60.0 - 360.0 * s + 360.0 * s**2) + a * (36.0 - 192.0 * s + 180.0 * s**2)) / length_s**3)
        return Moment(speed, acceleration, jerk, snap)

    def _rates_per_s(self, position_rad: Sequence[float], lacking_nm: Sequence[float]) -> tuple[float, float]:
        """The inverse of the time that the amplifiers need, by a ramp and by the smooth way.

        What a ramp costs over going on at constant speed is inverse to its length.
        """
        arm, rest = self._arm, self._rest.speed
        going_on_nm = arm.torque_nm(position_rad, self._speed, rest)
        standing_nm = arm.torque_nm(position_rad, rest, rest)
        pushed_nm = arm.torque_nm(position_rad, rest, [-speed for speed in self._speed])
        load_nm = self._loaded([-speed for speed in self._speed])
        hardest = SMOOTH_PEAK / SHORTEST_S
        rows = zip(
            going_on_nm, standing_nm, pushed_nm, load_nm, lacking_nm, arm.torque_per_ampere, arm.max_current_a,
            strict=True,
        )  # fmt: skip
        for going_on, standing, pushed, load, lacking, per_ampere, highest_a in rows:
            cost = pushed - standing + load
            room = RAMP_SHARE * per_ampere * highest_a - (going_on + lacking if cost > 0.0 else -going_on - lacking)
            if cost:
                hardest = min(hardest, max(room, 0.0) / abs(cost))
        return hardest, hardest / SMOOTH_PEAK
