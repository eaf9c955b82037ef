"""Brings the arm to a standstill and holds it: the reaction to a failure that leaves sensors and motors usable.

Owns the torque of a safe stop; the trusted state, and the end of the stop, are decided elsewhere.
"""

from collections.abc import Callable, Collection, Sequence

from ..dynamics import Arm
from ..laws.base import Cycle
from .braking import Braking
from .load import Load

STIFFNESS_RAD_S, DAMPING_RATIO = 12.0, 1.5
LATENCY_CYCLES = 2
"""From a commanded torque to its effect on the speed: it acts from the next SYNC to the one after."""
SHARE = 0.98
"""Share of the amplifier's current: the stop never saturates."""


class SafeHold:
    """τ = M(q)·(q̈_r + 2ζω(q̇_r - q̇) + ω²(q_r - q)) + H + G + friction + lacking, along a way of q̇_r to zero.

    All joints come to rest at the same time. Where they do is where they are held: the way that the arm takes to begin
    to brake is not made good. `bias_rad_s2` tells what the model lacks, such as a payload: before the failure, and as
    it turns with the arm. `compliance_rad_nm` is the drive wires', `start_rad_s2` the arm's present acceleration. On
    elastic wires what is lacking is a `load` with its inertia, and stays what it is: what swings would be learned too.
    """

    def __init__(
        self, arm: Arm, cycle: Cycle, bias_rad_s2: Callable[[], Sequence[float]], compliance_rad_nm: Sequence[float],
        start_rad_s2: Sequence[float], period_s: float, load: Load | None = None,
    ) -> None:  # fmt: skip
        self._arm, self._bias_rad_s2 = arm, bias_rad_s2
        self._position = tuple(cycle.position_rad)
        per_ampere = arm.torque_per_ampere
        self._most_nm = [SHARE * amperes * limit for amperes, limit in zip(per_ampere, arm.max_current_a, strict=True)]
        lacking_nm = self._lacking_nm(self._position)
        load_kg_m2 = [[0.0] * arm.joint_count] * arm.joint_count
        self._settled_nm: Sequence[float] | None = None
        if load is not None and any(compliance_rad_nm):
            self._settled_nm, load_kg_m2 = lacking_nm, load.inertia(self._position, lacking_nm)
        self._braking = Braking(
            arm, self._position, cycle.velocity_rad_s, start_rad_s2, compliance_rad_nm, lacking_nm, load_kg_m2,
            period_s,
        )  # fmt: skip
        self._cycle = 0
        self._frozen_rad: dict[int, float] = {}

    def torque_nm(self, cycle: Cycle, frozen: Collection[int] = ()) -> list[float]:
        """Torques for one cycle, N·m, within what the amplifiers have.

        Joints that are `frozen` get what carries their weight where they were in their first such cycle, whatever is
        measured: friction stops them.
        """
        position_rad: Sequence[float] = cycle.position_rad
        braking = self._braking
        if frozen:
            position_rad = self._where_frozen(position_rad, frozen)
        if self._cycle < braking.cycles + LATENCY_CYCLES:
            self._position = tuple(position_rad)
        planned, expected = braking.at(self._cycle), braking.at(self._cycle - LATENCY_CYCLES)
        self._cycle += 1
        ahead_rad_s = braking.ahead_rad_s(expected, position_rad)
        rows = zip(
            planned.acceleration, expected.speed, ahead_rad_s, cycle.velocity_rad_s, self._position, position_rad,
            strict=True,
        )  # fmt: skip
        aimed = [
            planned_rad_s2
            + 2.0 * DAMPING_RATIO * STIFFNESS_RAD_S * (link + ahead - speed)
            + STIFFNESS_RAD_S**2 * (aim - position)
            for planned_rad_s2, link, ahead, speed, aim, position in rows
        ]
        planned_rad_s, beyond_nm = planned.speed, braking.beyond_nm(planned, position_rad)
        if frozen:
            aimed, planned_rad_s, beyond_nm = (
                [0.0 if joint in frozen else each for joint, each in enumerate(row)]
                for row in (aimed, planned_rad_s, beyond_nm)
            )
        model_nm = self._arm.torque_nm(position_rad, planned_rad_s, aimed)
        lacking_nm = self._settled_nm or self._lacking_nm(position_rad)
        rows_nm = zip(model_nm, beyond_nm, lacking_nm, self._most_nm, strict=True)
        return [max(-most, min(most, torque + beyond + lacking)) for torque, beyond, lacking, most in rows_nm]

    def _where_frozen(self, position_rad: Sequence[float], frozen: Collection[int]) -> list[float]:
        """`position_rad` with the angles at which joints were frozen."""
        return [
            self._frozen_rad.setdefault(joint, position) if joint in frozen else position
            for joint, position in enumerate(position_rad)
        ]

    def _lacking_nm(self, position_rad: Sequence[float]) -> list[float]:
        """Torques worth the accelerations that the model lacks."""
        bias = self._bias_rad_s2()
        rows = zip(self._arm.inertia(position_rad), self._arm.rotor_inertia, bias, strict=True)
        return [
            -rotor * own - sum([part * each for part, each in zip(row, bias, strict=True)]) for row, rotor, own in rows
        ]
