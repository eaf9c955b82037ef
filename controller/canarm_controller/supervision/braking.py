"""How the joints' speeds go to zero in a safe stop, and what elastic drive wires make of it.

Owns the planned motion and its length; feedback, and what the model lacks, are elsewhere.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..dynamics import Arm

LONGEST_S, SHORTEST_S = 0.125, 0.05
"""Bounds of the time from the first cycle to rest; within them, as fast as the amplifiers can."""
SMOOTH_S, LONGEST_SMOOTH_S = 0.08, 0.1
"""The same of a smooth way: the longer, the less it swings, but the arm is to stand within 100 ms, and its torque is
two cycles late. After 84 % of its way it has 5 % of its speed. Where the amplifiers need longer, a ramp is shorter."""
RAMP_SHARE, FULL_SHARE, WANTED_S = 0.8, 0.92, 0.085
"""Share of the amplifier's current that braking may use: the rest is for model errors. Where a ramp would take longer
than it should then, more, as far as it helps: a heavy arm that holds itself has little to brake with."""
EASE, LEAST_EASE = 0.47, 0.1
"""Share of the smooth way in which the deceleration comes, and again in which it goes; between, it is constant. Less
where the amplifiers need the time; with least it is a ramp."""


@dataclass(frozen=True, slots=True)
class Moment:
    """One cycle of the plan for links: speed in rad/s and its derivatives, one per joint."""

    speed: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]
    snap: Sequence[float]


class Braking:
    """From `speed_rad_s` to rest, all joints at the same time.

    A ramp is the shortest way. On elastic wires it sets the links swinging on motors that stand. There the deceleration
    comes and goes as half a swing of a cosine, from the present acceleration to none, and the motor leads
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
        ramp_per_s = self._ramp_per_s(position_rad, lacking_nm)
        self._is_smooth = any(compliance_rad_nm) and ramp_per_s * LONGEST_SMOOTH_S * (1.0 - LEAST_EASE) > 1.0
        length_s = min(1.0 / ramp_per_s, LONGEST_S) if ramp_per_s > 0.0 else LONGEST_S
        self._ease = EASE
        if self._is_smooth:
            ramp_s = length_s
            length_s = min(max(ramp_s / (1.0 - EASE), SMOOTH_S), LONGEST_SMOOTH_S)
            self._ease = min(1.0 - ramp_s / length_s, EASE)
        else:
            length_s = max(length_s, SHORTEST_S)
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
        gone, rate, change, curve = _eased(s, self._ease)
        for v, start in zip(self._speed, self._start, strict=True):
            a = start * length_s
            speed.append(v * (1.0 - gone) + a * s * (1.0 - s**2 * (6.0 - 8.0 * s + 3.0 * s**2)))
            acceleration.append((a * (1.0 - s**2 * (18.0 - 32.0 * s + 15.0 * s**2)) - v * rate) / length_s)
            jerk.append(-(v * change + a * s * (36.0 - 96.0 * s + 60.0 * s**2)) / length_s**2)
            snap.append(-(v * curve + a * (36.0 - 192.0 * s + 180.0 * s**2)) / length_s**3)
        return Moment(speed, acceleration, jerk, snap)

    def _ramp_per_s(self, position_rad: Sequence[float], lacking_nm: Sequence[float]) -> float:
        """The inverse of the time that a ramp takes.

        What a ramp costs over going on at constant speed is inverse to its length.
        """
        arm, rest = self._arm, self._rest.speed
        going_on_nm = arm.torque_nm(position_rad, self._speed, rest)
        standing_nm = arm.torque_nm(position_rad, rest, rest)
        pushed_nm = arm.torque_nm(position_rad, rest, [-speed for speed in self._speed])
        load_nm = self._loaded([-speed for speed in self._speed])
        rows = list(
            zip(
                going_on_nm, standing_nm, pushed_nm, load_nm, lacking_nm, arm.torque_per_ampere, arm.max_current_a,
                strict=True,
            )
        )  # fmt: skip

        def hardest(share: float) -> float:
            found = 1.0 / ((1.0 - EASE) * SHORTEST_S)
            for going_on, standing, pushed, load, lacking, per_ampere, highest_a in rows:
                cost = pushed - standing + load
                room = share * per_ampere * highest_a - (going_on + lacking if cost > 0.0 else -going_on - lacking)
                if cost:
                    found = min(found, max(room, 0.0) / abs(cost))
            return found

        usual = hardest(RAMP_SHARE)
        return usual if usual * WANTED_S >= 1.0 else min(hardest(FULL_SHARE), 1.0 / WANTED_S)


def _eased(s: float, ease: float) -> tuple[float, float, float, float]:
    """Share of the speed that is gone at the share `s` of the way, and its three derivatives by `s`."""
    if s > 0.5:
        gone, rate, change, curve = _eased(1.0 - s, ease)
        return 1.0 - gone, rate, -change, curve
    peak = 1.0 / (1.0 - ease)
    if s >= ease:
        return peak * (s - 0.5 * ease), peak, 0.0, 0.0
    omega = math.pi / ease
    swing, lag = math.sin(omega * s), math.cos(omega * s)
    return (
        0.5 * peak * (s - swing / omega), 0.5 * peak * (1.0 - lag),
        0.5 * peak * omega * swing, 0.5 * peak * omega**2 * lag,
    )  # fmt: skip
