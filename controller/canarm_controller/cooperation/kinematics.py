"""Forward kinematics and position Jacobian of any chain, for many poses at once.

Owns nothing of two arms. Angles are (..., joints) in rad, poses (..., 4, 4) with the columns n, o, a and p (m) of the
paper, in the frame of the arm's base.
"""

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from canarm_protocol.cell.rigid import exact_cos_sin

from ..errors import CooperationError
from .arms import DhChain, FiveAxisArm

Floats: TypeAlias = NDArray[np.float64]


BLOCK = 4096
"""Poses that go through a chain together, so that what is computed on the way stays near the processor."""


class _Frame(NamedTuple):
    """Axes and origin of a link's frame in the base, each (3, poses)."""

    x: Floats
    y: Floats
    z: Floats
    origin: Floats


def forward(chain: DhChain, q_rad: ArrayLike) -> Floats:
    """The tip's pose T, (..., 4, 4), of joint angles (..., joints) in rad; `CooperationError` for another shape."""
    q = checked_angles(chain, q_rad)
    flat = q.reshape(-1, chain.joint_count)
    pose = np.zeros((len(flat), 4, 4))
    pose[:, 3, 3] = 1.0
    for start in range(0, len(flat), BLOCK):
        *_, tip = _frames(chain, flat[start : start + BLOCK])
        for column, values in enumerate(tip):
            pose[start : start + BLOCK, :3, column] = values.T
    return pose.reshape(*q.shape[:-1], 4, 4)


def position_jacobian(chain: DhChain, q_rad: ArrayLike, point_m: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
    """∂p/∂q, (..., 3, joints), in m/rad: column i is z_{i−1} × (p − p_{i−1}).

    p is the tip, or a point that is fixed in the tip's frame, such as the master's B at `CarriedObject.offset_m`.
    """
    q = checked_angles(chain, q_rad)
    point = np.asarray(point_m, dtype=np.float64)
    if point.shape != (3,):
        raise CooperationError(f"point_m has shape {point.shape}; must be (3,)")
    *axes, tip = _frames(chain, q.reshape(-1, chain.joint_count))
    place = tip.origin + point[0] * tip.x + point[1] * tip.y + point[2] * tip.z
    columns = [np.cross(frame.z, place - frame.origin, axis=0).T for frame in axes]
    return np.stack(columns, axis=-1).reshape(*q.shape[:-1], 3, chain.joint_count)


def least_singular_value_m(arm: FiveAxisArm, q_rad: ArrayLike) -> Floats:
    """σ_min of the 3 × 5 position Jacobian, (...,) in m/rad: how near the arm is to where (5) blows up.

    In the frame that turns with the waist, the waist moves the tip across by its distance from the axis, and joints 2
    to 4 move it in the plane alone, so that σ_min is the smaller one of that distance and of what the plane has.
    """
    q = checked_angles(arm, q_rad)
    distance, radial, vertical = _plane_jacobian(arm, q)
    # Σ of a 2 × 3 matrix: the roots of λ² − (A + C)·λ + det; the smaller one by det / larger, which loses no digits.
    squares, crossed = (radial**2).sum(axis=0) + (vertical**2).sum(axis=0), (radial * vertical).sum(axis=0)
    determinant = (radial**2).sum(axis=0) * (vertical**2).sum(axis=0) - crossed**2
    larger = squares / 2 + np.sqrt(np.maximum((squares / 2) ** 2 - determinant, 0.0))
    with np.errstate(invalid="ignore"):
        smaller = np.sqrt(np.maximum(determinant, 0.0) / larger)
    return np.asarray(np.minimum(np.abs(distance), smaller))


def _plane_jacobian(arm: FiveAxisArm, q: Floats) -> tuple[Floats, Floats, Floats]:
    """The tip's signed distance from the waist's axis (...,), and its radial and vertical speeds for joints 2 to 4."""
    angles = q + np.array(arm.offsets_rad)
    summed = np.cumsum(angles[..., 1:4], axis=-1)
    cos, sin = np.moveaxis(np.cos(summed), -1, 0), np.moveaxis(np.sin(summed), -1, 0)
    wrist = arm.wrist_sign * arm.d_m[4]
    along = [arm.a_m[1] * cos[0], arm.a_m[2] * cos[1], arm.a_m[3] * cos[2] + wrist * sin[2]]
    across = [arm.a_m[1] * sin[0], arm.a_m[2] * sin[1], arm.a_m[3] * sin[2] - wrist * cos[2]]
    reach = np.cumsum(np.stack(along)[::-1], axis=0)[::-1]
    height = np.cumsum(np.stack(across)[::-1], axis=0)[::-1]
    return arm.a_m[0] + reach[0], -height, reach


def checked_angles(chain: DhChain, q_rad: ArrayLike) -> Floats:
    """The angles as floats (..., joints). Raises `CooperationError` for another shape or for what is no number."""
    try:
        q = np.asarray(q_rad, dtype=np.float64)
    except (TypeError, ValueError):
        raise CooperationError(f"joint angles {q_rad!r}; must be numbers in rad") from None
    if q.ndim == 0 or q.shape[-1] != chain.joint_count:
        raise CooperationError(f"joint angles have shape {q.shape}; must be (..., {chain.joint_count})")
    return q


def checked_pose(chain: DhChain, q_rad: ArrayLike) -> Floats:
    """The angles of one pose as floats (joints,). Raises `CooperationError` for another shape or what is not finite."""
    q = checked_angles(chain, q_rad)
    if q.ndim != 1 or not np.isfinite(q).all():
        raise CooperationError(f"the start is {q.tolist()}; must be {chain.joint_count} finite angles in rad")
    return q


def _frames(chain: DhChain, q: Floats) -> Iterator[_Frame]:
    """The base's frame and that of every link after it, for q (poses, joints).

    Poses are last in memory, so that each product is one loop.
    """
    angles = np.ascontiguousarray(q.T) + np.array(chain.offsets_rad)[:, None]
    x, y, z = (np.repeat(axis[:, None], angles.shape[1], axis=1) for axis in np.eye(3))
    frame = _Frame(x, y, z, np.zeros_like(x))
    yield frame
    for angle, d, a, alpha_deg in zip(angles, chain.d_m, chain.a_m, chain.alpha_deg, strict=True):
        cos_alpha, sin_alpha = exact_cos_sin(alpha_deg)
        cos, sin = np.cos(angle), np.sin(angle)
        x = cos * frame.x + sin * frame.y
        across = cos * frame.y - sin * frame.x
        origin = frame.origin + d * frame.z + a * x
        frame = _Frame(x, cos_alpha * across + sin_alpha * frame.z, cos_alpha * frame.z - sin_alpha * across, origin)
        yield frame
