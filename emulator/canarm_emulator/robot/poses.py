"""Quaternions (w, x, y, z) and rigid poses, in plain floats."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

Quaternion = tuple[float, float, float, float]
Point = tuple[float, float, float]

UNTURNED: Quaternion = (1.0, 0.0, 0.0, 0.0)
ORIGIN: Point = (0.0, 0.0, 0.0)


class Pose(NamedTuple):
    """The pose of a frame in another one."""

    position_m: Point = ORIGIN
    quaternion: Quaternion = UNTURNED

    def then(self, after: "Pose") -> "Pose":
        """The pose `after`, given in this frame, seen from the outer frame."""
        moved = self.position_m if after.position_m == ORIGIN else self.at(after.position_m)
        return Pose(moved, product(self.quaternion, after.quaternion))

    def at(self, point_m: Sequence[float]) -> Point:
        """A point of this frame, seen from the outer one."""
        x, y, z = (p + c for p, c in zip(self.position_m, rotated(self.quaternion, point_m), strict=True))
        return x, y, z


def about_x(angle_rad: float) -> Quaternion:
    """A turn about x."""
    return math.cos(angle_rad / 2), math.sin(angle_rad / 2), 0.0, 0.0


def about_y(angle_rad: float) -> Quaternion:
    """A turn about y."""
    return math.cos(angle_rad / 2), 0.0, math.sin(angle_rad / 2), 0.0


def about_z(angle_rad: float) -> Quaternion:
    """A turn about z."""
    return math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)


def from_rpy_deg(rpy_deg: Sequence[float]) -> Quaternion:
    """Roll, pitch and yaw about the fixed axes x, y, z, in this order, as URDF has them."""
    roll, pitch, yaw = map(math.radians, rpy_deg)
    return product(about_z(yaw), product(about_y(pitch), about_x(roll)))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """First `q`, then `p`."""
    result = np.zeros(4)
    mujoco.mju_mulQuat(result, np.array(p), np.array(q))
    w, x, y, z = result.tolist()
    return w, x, y, z


def rotated(quaternion: Quaternion, vector: Sequence[float]) -> list[float]:
    """`vector`, turned."""
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, np.array(vector), np.array(quaternion))
    return list(map(float, result))


def quaternion_of(rotation: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> Quaternion:
    """The quaternion of a rotation matrix, shape (3, 3)."""
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, np.ascontiguousarray(rotation).reshape(9))
    w, x, y, z = result.tolist()
    return w, x, y, z
