"""Frames of joint axes: from any placement of revolute joints to rotations about z and x only.

Owns rotations of frames. Masses enter as numbers to be carried into another frame; equations of motion must not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, sin
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.rigid import from_rpy_deg

Matrix: TypeAlias = NDArray[np.float64]
Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float]

ROUNDING = 1e-14
"""Entries of a rotation this close to 0 or ±1 are set to it, so that the fast forms can leave such products out."""


@dataclass(frozen=True, slots=True)
class Placement:
    """A joint turns by Rz(q + offset) between two fixed steps, 4 × 4: from the link before, and to its own frame."""

    before: Matrix
    offset_rad: float
    after: Matrix

    @classmethod
    def of_body(cls, origin_m: Vector, rpy_deg: Vector, axis: Vector) -> Self:
        """A joint as URDF places it: the link's frame is the joint's, turned about `axis`."""
        along = _axis_frame(axis)
        before, after = np.eye(4), np.eye(4)
        before[:3, :3] = _clean(rpy_rotation(rpy_deg) @ along)
        before[:3, 3] = origin_m
        after[:3, :3] = along.T
        return cls(before, 0.0, after)


@dataclass(frozen=True, slots=True)
class Unwound:
    """A joint as Rz(q + offset)·T(reach)·Rx(α), and the step from that far frame to the frame of its link, 4 × 4."""

    offset_rad: float
    reach_m: Vector
    cos_alpha: float
    sin_alpha: float
    link: Matrix

    def moved(self, mass_kg: float, centre_m: Vector, inertia_kg_m2: Tensor) -> tuple[float, Vector, Tensor]:
        """Mass, centre of mass and central tensor, given in the frame of the link, in the far frame."""
        turn = self.link[:3, :3]
        x, y, z = (turn @ np.array(centre_m) + self.link[:3, 3]).tolist()
        xx, yy, zz, xy, xz, yz = inertia_kg_m2
        tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        a, b, c, d, e, f = (float(tensor[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return mass_kg, (x, y, z), (a, b, c, d, e, f)


def unwound(placements: Sequence[Placement]) -> tuple[Matrix, list[Unwound]]:
    """The same chain by turns about z and x alone, and the rotation of its base against the given one, 3 × 3.

    Between two axes the fixed rotation is Rz(φ)·Rx(α)·Rz(ψ) (Euler's angles); φ goes into the offset of the joint
    before it, ψ into that of the joint after it.
    """
    phi, alpha, psi = _euler_zxz(placements[0].before[:3, :3])
    base = _clean(_about_z(phi) @ _about_x(*alpha))
    parts = []
    for i, placement in enumerate(placements):
        hop = placement.after @ placements[i + 1].before if i + 1 < len(placements) else np.eye(4)
        before_psi = psi
        phi, alpha, psi = _euler_zxz(hop[:3, :3])
        back = _about_z(-phi)
        x, y, z = _clean(back @ hop[:3, 3]).tolist()
        far = np.eye(4)
        far[:3, :3] = _about_x(*alpha)
        far[:3, 3] = x, y, z
        turned = np.eye(4)
        turned[:3, :3] = back
        link = np.linalg.inv(far) @ turned @ placement.after
        link[:3, :3] = _clean(link[:3, :3])
        parts.append(Unwound(placement.offset_rad + before_psi + phi, (x, y, z), *alpha, link))
    return base, parts


def rpy_rotation(rpy_deg: Vector) -> Matrix:
    """Rz(yaw)·Ry(pitch)·Rx(roll), as URDF turns frames; 3 × 3."""
    return _clean(np.array(from_rpy_deg(rpy_deg)))


def _euler_zxz(rotation: Matrix) -> tuple[float, tuple[float, float], float]:
    """φ, (cos α, sin α), ψ with rotation = Rz(φ)·Rx(α)·Rz(ψ), |φ| ≤ π/2; φ = 0 for parallel axes."""
    across, down, cos_alpha = float(rotation[0, 2]), float(-rotation[1, 2]), float(rotation[2, 2])
    sin_alpha = hypot(across, down)
    phi = atan2(across, down) if sin_alpha else 0.0
    if abs(phi) > pi / 2:
        phi, sin_alpha = phi - pi if phi > 0.0 else phi + pi, -sin_alpha
    rest = _about_x(cos_alpha, -sin_alpha) @ _about_z(-phi) @ rotation
    return phi, (cos_alpha, sin_alpha), atan2(float(rest[1, 0]), float(rest[0, 0]))


def _axis_frame(axis: Vector) -> Matrix:
    """A rotation whose third column is `axis`, without products where the axis is one of the frame's."""
    third = np.array(axis) / np.linalg.norm(axis)
    start = np.eye(3)[int(np.argmin(np.abs(third)))]
    first = start - (start @ third) * third
    first /= np.linalg.norm(first)
    return _clean(np.column_stack([first, np.cross(third, first), third]))


def _about_z(angle_rad: float) -> Matrix:
    c, s = cos(angle_rad), sin(angle_rad)
    return _clean(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _about_x(cos_angle: float, sin_angle: float) -> Matrix:
    return np.array([[1.0, 0.0, 0.0], [0.0, cos_angle, -sin_angle], [0.0, sin_angle, cos_angle]])


def _clean(matrix: Matrix) -> Matrix:
    nearest = np.rint(matrix)
    return np.where(np.abs(matrix - nearest) < ROUNDING, nearest, matrix) + 0.0
