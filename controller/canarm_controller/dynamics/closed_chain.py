"""Two arms that hold one object: which joint motions its grips allow, and what they make of accelerations.

Owns the constraint C·q̇ = 0 of the point that the slave holds. Drives, sensors and laws must not enter.
"""

from collections.abc import Iterator, Sequence
from math import cos, sin
from operator import mul
from typing import Any, Self

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.rigid import Triple, from_rpy_deg

from .chain import Chain, Floats, chain_of

Numbers = Sequence[float]
Rows = Sequence[Numbers]
Link = tuple[float, float, float, float, float, float]
"""a, b and d in m, cos α, sin α and the offset of the angle in rad, as in `ChainLink`."""
Axis = tuple[float, float, float, float, float, float]
"""A point on a joint's axis, m, and its direction."""
Side = tuple[tuple[Link, ...], slice, Sequence[Triple], Triple, Triple, float]
"""An arm's links, which joints they are, axes and place of its base, the held point in its last link, and its sign."""


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
        self._sides: list[Side] = []
        for name, point_m, sign in ((carried.master, (x, y, z), 1.0), (carried.slave, (0.0, 0.0, 0.0), -1.0)):
            number = [robot.name for robot in cell.robot].index(name)
            robot, own = cell.robot[number], cell.blocks[number]
            base = from_rpy_deg(robot.base_rpy_deg)
            self._sides.append((_links(chain_of(robot)), own, base, robot.base_m, point_m, sign))

        self._pose: tuple[float, ...] = ()
        self._reached: list[tuple[list[Axis], Triple]] = []
        """Of each side, axes and the held point in `_pose`: grips are looked at where their accelerations are."""

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
        x = y = z = 0.0
        for side, (_, (end_x, end_y, end_z)) in self._at(q):
            _, _, _, (base_x, base_y, base_z), _, sign = side
            x += sign * (base_x + end_x)
            y += sign * (base_y + end_y)
            z += sign * (base_z + end_z)
        return x, y, z

    def constraint(self, q: Numbers, qd: Numbers) -> tuple[Floats, Floats]:
        """C (3, joints) and Ċ·q̇ (3,) at a state: m/rad and m/s²."""
        rows, drift = self.plain(q, qd)
        return np.array(rows), np.array(drift)

    def plain(self, q: Numbers, qd: Numbers) -> tuple[list[list[float]], Triple]:
        """`constraint` as plain numbers."""
        rows = [[0.0] * self._count for _ in range(3)]
        x = y = z = 0.0
        for side, (axes, end) in self._at(q):
            _, own, _, _, _, sign = side
            for row, part in zip(rows, zip(*_columns(axes, end), strict=True), strict=True):
                row[own] = [sign * each for each in part]
            drift_x, drift_y, drift_z = _drift(axes, end, qd[own])
            x += sign * drift_x
            y += sign * drift_y
            z += sign * drift_z
        return rows, (x, y, z)

    def _at(self, q: Numbers) -> Iterator[tuple[Side, tuple[list[Axis], Triple]]]:
        pose = tuple(q)
        if pose != self._pose:
            self._pose = pose
            self._reached = [_reach(links, base, pose[own], point_m) for links, own, base, _, point_m, _ in self._sides]
        return zip(self._sides, self._reached, strict=True)


class HeldMotion:
    """What the grips make of the accelerations of free arms: q̈ = q̈_free - M⁻¹Cᵀ(C·M⁻¹·Cᵀ)⁻¹(C·q̈_free + Ċ·q̇)."""

    def __init__(self, chain: ClosedChain) -> None:
        self._chain = chain
        self._rows: Rows = ()
        self._answer: Rows = ()
        self._drift: Numbers = ()
        self._across: Floats = np.zeros((0, 0))
        self._solved: Floats = self._across

    @property
    def borne(self) -> Floats:
        """What the grips bear of M⁻¹: a torque τ makes M⁻¹·τ less this times τ."""
        return np.asarray(self._solved @ self._across.T)

    def refresh(self, q: Numbers, qd: Numbers, mobilities: Sequence[Rows | Floats]) -> None:
        """Look up what changes slowly. `mobilities` are the M⁻¹ of the cell's robots, rotors included."""
        self._rows, self._drift = plain, _ = self._chain.plain(q, qd)
        rows = np.array(plain)
        across = np.zeros((rows.shape[1], 3))
        first = 0
        for block in mobilities:
            own = slice(first, first + len(block))
            across[own] = np.asarray(block) @ rows[:, own].T
            first = own.stop
        answer: Any = np.linalg.solve(rows @ across, across.T).T
        self._across, self._solved = across, answer
        self._answer = answer.tolist()

    def accelerations(self, free_rad_s2: Numbers) -> Numbers:
        """With the grips, rad/s²."""
        a, b, c = (sum(map(mul, row, free_rad_s2)) + drift for row, drift in zip(self._rows, self._drift, strict=True))
        rows = zip(free_rad_s2, self._answer, strict=True)
        return [free - x * a - y * b - z * c for free, (x, y, z) in rows]


def _links(chain: Chain) -> tuple[Link, ...]:
    return tuple(
        (link.a_m, link.b_m, link.d_m, link.cos_alpha, link.sin_alpha, link.theta_offset_rad) for link in chain.links
    )


def _reach(links: Sequence[Link], base: Sequence[Triple], q: Numbers, point_m: Triple) -> tuple[list[Axis], Triple]:
    """Where each joint's axis is and points to, and the place of a point of the last link: along the world's axes.

    Plain numbers throughout: vectors as tuples take three times as long.
    """
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = base  # the frame's axes in the world: x, y and z are columns of it
    px = py = pz = 0.0
    axes = []
    for (a_m, b_m, d_m, cos_alpha, sin_alpha, offset_rad), angle in zip(links, q, strict=True):
        axes.append((px, py, pz, zx, zy, zz))
        c, s = cos(angle + offset_rad), sin(angle + offset_rad)
        xx, yx = c * xx + s * yx, c * yx - s * xx
        xy, yy = c * xy + s * yy, c * yy - s * xy
        xz, yz = c * xz + s * yz, c * yz - s * xz
        px = px + a_m * xx + b_m * yx + d_m * zx
        py = py + a_m * xy + b_m * yy + d_m * zy
        pz = pz + a_m * xz + b_m * yz + d_m * zz
        yx, zx = cos_alpha * yx + sin_alpha * zx, cos_alpha * zx - sin_alpha * yx
        yy, zy = cos_alpha * yy + sin_alpha * zy, cos_alpha * zy - sin_alpha * yy
        yz, zz = cos_alpha * yz + sin_alpha * zz, cos_alpha * zz - sin_alpha * yz
    along, across, up = point_m
    px = px + along * xx + across * yx + up * zx
    py = py + along * xy + across * yy + up * zy
    pz = pz + along * xz + across * yz + up * zz
    return axes, (px, py, pz)


def _columns(axes: Sequence[Axis], end: Triple) -> list[Triple]:
    """The Jacobian of the point `end`: for each joint its speed per rad/s."""
    ex, ey, ez = end
    return [
        (zy * (ez - oz) - zz * (ey - oy), zz * (ex - ox) - zx * (ez - oz), zx * (ey - oy) - zy * (ex - ox))
        for ox, oy, oz, zx, zy, zz in axes
    ]


def _drift(axes: Sequence[Axis], end: Triple, qd: Numbers) -> Triple:
    """The acceleration of the point `end` at q̈ = 0."""
    wx = wy = wz = ux = uy = uz = bx = by = bz = 0.0  # the links' angular speed, its change, and the sum
    stops = [axis[:3] for axis in axes[1:]]
    stops.append(end)
    for (ox, oy, oz, zx, zy, zz), (sx, sy, sz), rate in zip(axes, stops, qd, strict=True):
        ux += rate * (wy * zz - wz * zy)
        uy += rate * (wz * zx - wx * zz)
        uz += rate * (wx * zy - wy * zx)
        wx += rate * zx
        wy += rate * zy
        wz += rate * zz
        rx, ry, rz = sx - ox, sy - oy, sz - oz
        vx, vy, vz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
        bx = bx + (uy * rz - uz * ry) + (wy * vz - wz * vy)
        by = by + (uz * rx - ux * rz) + (wz * vx - wx * vz)
        bz = bz + (ux * ry - uy * rx) + (wx * vy - wy * vx)
    return bx, by, bz
