"""Two arms that hold one object: which joint motions its grips allow, and what they make of accelerations.

Owns the constraint C·q̇ = 0 of the point that the slave holds. Drives, sensors and laws must not enter.
"""

import math
from collections.abc import Sequence
from typing import Self

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.rigid import Triple, from_rpy_deg

from .chain import Chain, Floats, chain_of

Numbers = Sequence[float]
Rows = Sequence[Numbers]


class ClosedChain:
    """The grips of a cell's object. Joints are all those of the cell, in its order; vectors are along the world's axes.

    The object does not move in the master's hand; the slave's holds one point of it, so that three of the hands'
    relative speeds vanish: C(q)·q̇ = J_m(q)·q̇ - J_s(q)·q̇ = 0, (3, joints).
    """

    def __init__(self, cell: Cell) -> None:
        """Raises `ValueError` for a cell without an object."""
        carried = cell.object
        if carried is None:
            raise ValueError(f"cell {cell.name!r} has no object")
        self._count = len(cell.joints)
        x, y, z = (each * carried.grasp_distance_m for each in carried.direction)
        self._sides: list[tuple[Chain, slice, tuple[Triple, ...], Triple, Triple, float]] = []
        for name, point_m, sign in ((carried.master, (x, y, z), 1.0), (carried.slave, (0.0, 0.0, 0.0), -1.0)):
            number = [robot.name for robot in cell.robot].index(name)
            robot, own = cell.robot[number], cell.blocks[number]
            base = from_rpy_deg(robot.base_rpy_deg)
            self._sides.append((chain_of(robot), own, base, robot.base_m, point_m, sign))

    @classmethod
    def of(cls, cell: Cell) -> Self | None:
        """The closed chain of a cell; None without an object."""
        return None if cell.object is None else cls(cell)

    @property
    def slave(self) -> slice:
        """Which of the joints are the slave's."""
        return self._sides[1][1]

    def gap(self, q: Numbers) -> Triple:
        """How far the point that the slave holds is from its hand, (3,), m: all 0 where the hands fit the object."""
        gap: Triple = (0.0, 0.0, 0.0)
        for chain, own, base, base_m, point_m, sign in self._sides:
            still = (0.0,) * (own.stop - own.start)
            *_, end = _point_motion(chain, base, q[own], still, point_m)
            gap = _plus(gap, _plus(base_m, end, 1.0), sign)
        return gap

    def constraint(self, q: Numbers, qd: Numbers) -> tuple[Floats, Floats]:
        """C (3, joints) and Ċ·q̇ (3,) at a state: m/rad and m/s²."""
        rows, drift = np.zeros((3, self._count)), np.zeros(3)
        for chain, own, base, _, point_m, sign in self._sides:
            columns, bias, _ = _point_motion(chain, base, q[own], qd[own], point_m)
            rows[:, own] = sign * np.array(columns).T
            drift += sign * np.array(bias)
        return rows, drift


class HeldMotion:
    """What the grips make of the accelerations of free arms: q̈ = q̈_free - M⁻¹Cᵀ(C·M⁻¹·Cᵀ)⁻¹(C·q̈_free + Ċ·q̇)."""

    def __init__(self, chain: ClosedChain) -> None:
        self._chain = chain
        self._rows: Rows = ()
        self._answer: Rows = ()
        self._drift: Numbers = ()
        self.borne: Floats = np.zeros((0, 0))
        """What the grips bear of M⁻¹: a torque τ makes M⁻¹·τ less this times τ."""

    def refresh(self, q: Numbers, qd: Numbers, mobilities: Sequence[Rows]) -> None:
        """Look up what changes slowly. `mobilities` are the M⁻¹ of the cell's robots, rotors included."""
        rows, drift = self._chain.constraint(q, qd)
        across = np.zeros((rows.shape[1], 3))
        first = 0
        for block in mobilities:
            own = slice(first, first + len(block))
            across[own] = np.array(block) @ rows[:, own].T
            first = own.stop
        answer = np.linalg.solve(rows @ across, across.T).T
        self.borne = answer @ across.T
        self._rows, self._answer, self._drift = rows.tolist(), answer.tolist(), drift.tolist()

    def accelerations(self, free_rad_s2: Numbers) -> Numbers:
        """With the grips, rad/s²."""
        a, b, c = (
            sum([share * free for share, free in zip(row, free_rad_s2, strict=True)]) + drift
            for row, drift in zip(self._rows, self._drift, strict=True)
        )
        rows = zip(free_rad_s2, self._answer, strict=True)
        return [free - x * a - y * b - z * c for free, (x, y, z) in rows]


def _point_motion(
    chain: Chain, base: Sequence[Triple], q: Numbers, qd: Numbers, point_m: Triple
) -> tuple[list[Triple], Triple, Triple]:
    """Of a point of the last link, along the world's axes: columns of its Jacobian, acceleration at q̈ = 0, place."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = base
    x, y, z = (xx, yx, zx), (xy, yy, zy), (xz, yz, zz)  # the frame's axes in the world
    at: Triple = (0.0, 0.0, 0.0)
    spin, spin_up = at, at
    axes, origins, turns = [], [], []
    for link, angle, rate in zip(chain.links, q, qd, strict=True):
        axes.append(z)
        origins.append(at)
        spin_up = _plus(spin_up, _cross(spin, z), rate)
        spin = _plus(spin, z, rate)
        turns.append((spin, spin_up))
        c, s = math.cos(angle + link.theta_offset_rad), math.sin(angle + link.theta_offset_rad)
        x, y = _mixed(x, c, y, s), _mixed(y, c, x, -s)
        at = _plus(_plus(_plus(at, x, link.a_m), y, link.b_m), z, link.d_m)
        y, z = _mixed(y, link.cos_alpha, z, link.sin_alpha), _mixed(z, link.cos_alpha, y, -link.sin_alpha)
    end = _plus(_plus(_plus(at, x, point_m[0]), y, point_m[1]), z, point_m[2])
    bias: Triple = (0.0, 0.0, 0.0)
    for (spin, spin_up), begin, stop in zip(turns, origins, (*origins[1:], end), strict=True):
        reach = _plus(stop, begin, -1.0)
        bias = _plus(_plus(bias, _cross(spin_up, reach), 1.0), _cross(spin, _cross(spin, reach)), 1.0)
    columns = [_cross(axis, _plus(end, origin, -1.0)) for axis, origin in zip(axes, origins, strict=True)]
    return columns, bias, end


def _plus(vector: Triple, other: Triple, factor: float) -> Triple:
    return vector[0] + factor * other[0], vector[1] + factor * other[1], vector[2] + factor * other[2]


def _mixed(vector: Triple, factor: float, other: Triple, other_factor: float) -> Triple:
    a, b, c = vector
    d, e, f = other
    return factor * a + other_factor * d, factor * b + other_factor * e, factor * c + other_factor * f


def _cross(left: Triple, right: Triple) -> Triple:
    a, b, c = left
    d, e, f = right
    return b * f - c * e, c * d - a * f, a * e - b * d
