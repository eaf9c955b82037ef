"""The two-link arm written linearly in its base parameters: τ = Y(q, q̇, q̇_r, q̈_r)·a.

Owns the regressor Y, the nominal parameters and the accelerations that given parameters predict. A law finds the true
parameters.
"""

from collections.abc import Sequence
from math import cos, sin, tanh

from ..dynamics import COULOMB_SMOOTHING_RAD_S, NominalArm

Pair = Sequence[float]
Row = tuple[float, float, float, float, float, float, float, float, float]

SMALLEST_DETERMINANT = 0.1
"""Smallest determinant of D, as a fraction of D11·D22; konkuk1 has 0.9. Adapted parameters can be impossible for an
arm."""

PARAMETERS = (
    "inertia_kg_m2",
    "outer_inertia_kg_m2",
    "coupling_kg_m2",
    "outer_rotor_kg_m2",
    "gravity_nm",
    "viscous1_nm_s",
    "viscous2_nm_s",
    "coulomb1_nm",
    "coulomb2_nm",
)
"""a: I1 + m1|c1|² + I2 + m2(|c2|² + l²) + rotor 1; I2 + m2|c2|²; m2·l·|c2|; rotor 2; g·|m1·c1 + m2·l|; friction.

Joints are numbered 1 and 2 here, l is the distance between their axes. These are base parameters: each can be
identified from the arm's motion. The weight of the second link is g/l times the coupling, and so no parameter of its
own.
"""


class Regressor:
    """Y and what belongs to it for one arm; angles in rad, torques in N·m."""

    __slots__ = ("_coupling_phase", "_gravity_phase", "_outer_gravity_phase", "_weight_per_coupling", "nominal")

    def __init__(self, arm: NominalArm) -> None:
        own = arm.inertia_constants_kg_m2
        self._coupling_phase = arm.coupling_phase_rad
        self._gravity_phase, self._outer_gravity_phase = arm.gravity_phase_rad
        self._weight_per_coupling = arm.gravity_nm[1] / arm.coupling_kg_m2 if arm.coupling_kg_m2 else 0.0
        self.nominal: tuple[float, ...] = (
            own[0] + arm.rotor_inertia[0],
            own[1],
            arm.coupling_kg_m2,
            arm.rotor_inertia[1],
            arm.gravity_nm[0],
            *arm.viscous_nm_s,
            *arm.coulomb_nm,
        )

    def rows(self, q: Pair, qd: Pair, qd_r: Pair, qdd_r: Pair, sliding: Pair) -> tuple[Row, Row]:
        """Y of joint 1 and joint 2.

        `qd_r` and `qdd_r` are the reference speed and acceleration of Slotine and Li; with q̇ and q̈ in their place Y·a
        is the inverse dynamics. The Coriolis matrix is the one of the Christoffel symbols, with which Ḋ - 2C is
        skew-symmetric. Coulomb friction takes its sign from the speeds `sliding`.
        """
        q1, q2 = q
        v1, v2 = qd
        r1, r2 = qd_r
        a1, a2 = qdd_r
        angle = q2 + self._coupling_phase
        along, across = cos(angle), sin(angle)
        outer = self._weight_per_coupling * sin(q1 + q2 + self._outer_gravity_phase)
        return (
            (
                a1,
                a2,
                along * (2.0 * a1 + a2) - across * (v2 * r1 + (v1 + v2) * r2) + outer,
                0.0,
                sin(q1 + self._gravity_phase),
                r1,
                0.0,
                tanh(sliding[0] / COULOMB_SMOOTHING_RAD_S),
                0.0,
            ),
            (
                0.0,
                a1 + a2,
                along * a1 + across * v1 * r1 + outer,
                a2,
                0.0,
                0.0,
                r2,
                0.0,
                tanh(sliding[1] / COULOMB_SMOOTHING_RAD_S),
            ),
        )

    def at(self, q: Pair, qd: Pair, qd_r: Pair, qdd_r: Pair, sliding: Pair) -> "PairState":
        """Y at one state; see `rows`."""
        return PairState(*self.rows(q, qd, qd_r, qdd_r, sliding))

    def by_joint(self, factors: Sequence[float]) -> dict[str, list[float]]:
        """Parameters as multiples of nominal: total inertia and outer link's, weight on the first link and coupling
        (the outer link's mass), Coulomb friction.
        """
        of = dict(zip(PARAMETERS, factors, strict=True))
        return {
            "inertia_factor": [of["inertia_kg_m2"], of["outer_inertia_kg_m2"]],
            "weight_factor": [of["gravity_nm"], of["coupling_kg_m2"]],
            "coulomb_factor": [of["coulomb1_nm"], of["coulomb2_nm"]],
        }

    def acceleration(self, parameters: Sequence[float], q: Pair, qd: Pair, torque_nm: Pair) -> tuple[float, float]:
        """q̈ in rad/s² under `torque_nm`: D⁻¹(τ - H - G - friction); D is the nominal one if theirs is near singular."""
        still1, still2 = self.rows(q, qd, qd, (0.0, 0.0), qd)
        left1 = torque_nm[0] - dot(still1, parameters)
        left2 = torque_nm[1] - dot(still2, parameters)
        d11, d12, d22 = self._inertia(parameters, q)
        determinant = d11 * d22 - d12 * d12
        if determinant <= SMALLEST_DETERMINANT * d11 * d22:
            d11, d12, d22 = self._inertia(self.nominal, q)
            determinant = d11 * d22 - d12 * d12
        return (d22 * left1 - d12 * left2) / determinant, (d11 * left2 - d12 * left1) / determinant

    def _inertia(self, parameters: Sequence[float], q: Pair) -> tuple[float, float, float]:
        along = parameters[2] * cos(q[1] + self._coupling_phase)
        return parameters[0] + 2.0 * along, parameters[1] + along, parameters[1] + parameters[3]


class PairState:
    """Y of one state, by its two rows."""

    __slots__ = ("_row1", "_row2")

    def __init__(self, row1: Row, row2: Row) -> None:
        self._row1, self._row2 = row1, row2

    def torque_nm(self, parameters: Sequence[float]) -> tuple[float, float]:
        """Y·a, N·m."""
        return dot(self._row1, parameters), dot(self._row2, parameters)

    def gradient(self, s: Pair) -> list[float]:
        """Yᵀs, one number per parameter."""
        s1, s2 = s
        a, b = self._row1, self._row2
        return [
            a[0] * s1 + b[0] * s2, a[1] * s1 + b[1] * s2, a[2] * s1 + b[2] * s2, a[3] * s1 + b[3] * s2,
            a[4] * s1 + b[4] * s2, a[5] * s1 + b[5] * s2, a[6] * s1 + b[6] * s2, a[7] * s1 + b[7] * s2,
            a[8] * s1 + b[8] * s2,
        ]  # fmt: skip


def dot(row: Row, a: Sequence[float]) -> float:
    """One row of Y times the parameters, N·m."""
    return (
        row[0] * a[0] + row[1] * a[1] + row[2] * a[2] + row[3] * a[3] + row[4] * a[4]
        + row[5] * a[5] + row[6] * a[6] + row[7] * a[7] + row[8] * a[8]
    )  # fmt: skip
