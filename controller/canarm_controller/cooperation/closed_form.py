"""Inverse kinematics of a five-axis arm in closed form: every branch, and the reason where there is none.

Poses are (..., 4, 4) in the frame of the arm's base. A pose has a solution only if its approach vector lies in the
vertical plane through the base's axis and the point: with h = (−p_y, p_x, 0)/ρ, a·h = 0.

With f = ±1 (does the waist face the point?), σ₁ and σ₄ the signs of α₁ and α₄, and everything seen in that plane
(radial r = f·ρ, vertical z): θ₁ = atan2(f·p_y, f·p_x); S₂₃₄ = σ₄·a_r, C₂₃₄ = −σ₁σ₄·a_z; what joints 2 and 3 are to span
is b₁ = r − a₁ − a₄C₂₃₄ − d₅a_r and b₂ = σ₁(p_z − d₁) − a₄S₂₃₄ − σ₁d₅a_z; c₃ = (b₁² + b₂² − a₂² − a₃²)/(2a₂a₃);
θ₂ = atan2((a₂ + a₃c₃)b₂ − a₃s₃b₁, (a₂ + a₃c₃)b₁ + a₃s₃b₂); θ₅ from n and o along the pitch axis.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import CooperationError
from .arms import FiveAxisArm
from .kinematics import Floats
from .reasons import Reason

Mask: TypeAlias = NDArray[np.bool_]
Codes: TypeAlias = NDArray[np.int8]
"""Values of `Reason`."""
YAW_TOLERANCE = 1e-9
"""|a·h| below which a pose has no yaw: rounding leaves 1e-13 for a point 1 mm from the base's axis."""
LEAST_AXIS_DISTANCE_M = 1e-6
"""A point closer to the base's axis does not determine the waist's angle; nor does an approach along the axis."""
_NEAR_AXIS_M = 0.01
_ROUNDING = 1e-12
"""Tolerance of c₃: a fully stretched arm, to a tenth of a picometre, is within reach."""


class Branch(NamedTuple):
    """One of the four solutions: `facing` +1 with the waist towards the point or −1 away from it; `elbow` is the sign
    of sin θ₃.
    """

    facing: int = 1
    elbow: int = 1


BRANCHES = (Branch(1, 1), Branch(1, -1), Branch(-1, 1), Branch(-1, -1))


class Solutions(NamedTuple):
    """Joint angles (..., 5) in rad within (−π, π] before the arm's offsets, NaN where `reason` (...), of `Reason`, says
    why there are none, and `elbow_cosine` (...), c₃: beyond ±1 where the pose is out of reach.
    """

    q_rad: Floats
    reason: Codes
    elbow_cosine: Floats

    @property
    def found(self) -> Mask:
        """Where there is a solution."""
        return np.asarray(self.reason == Reason.NONE)


def inverse(arm: FiveAxisArm, pose: ArrayLike, *, yaw_tolerance: float = YAW_TOLERANCE) -> Solutions:
    """All four solutions of poses (..., 4, 4), in the order of `BRANCHES`: angles (..., 4, 5), reasons (..., 4).

    Joint limits are heeded: a solution beyond them, whatever full turns are added, has the reason `JOINT_LIMIT`;
    within them the angles are those that the limits allow. Raises `CooperationError` for another shape.
    """
    found = [inverse_branch(arm, pose, branch, yaw_tolerance=yaw_tolerance) for branch in BRANCHES]
    limited = [_within_limits(arm, each) for each in found]
    return Solutions(
        np.stack([each.q_rad for each in limited], axis=-2),
        np.stack([each.reason for each in limited], axis=-1),
        np.stack([each.elbow_cosine for each in limited], axis=-1),
    )


def inverse_branch(
    arm: FiveAxisArm, pose: ArrayLike, branch: Branch = BRANCHES[0], *, yaw_tolerance: float = YAW_TOLERANCE
) -> Solutions:
    """The solutions of poses (..., 4, 4) on one branch, without regard to joint limits.

    With an infinite `yaw_tolerance` the yaw is passed over: the arm then reaches the point, and misses the direction.
    """
    n, o, a, p = _columns(pose)
    c1, s1, is_off_plane, is_on_axis = _waist(a, p, branch.facing, yaw_tolerance)
    with np.errstate(invalid="ignore", divide="ignore"):
        a_radial = c1 * a[0] + s1 * a[1]
        s234, c234 = arm.wrist_sign * a_radial, -arm.waist_sign * arm.wrist_sign * a[2]
        level = np.hypot(s234, c234)  # 1, but for rounding and for a yaw that is passed over
        s234, c234 = s234 / level, c234 / level
        b1 = c1 * p[0] + s1 * p[1] - arm.a_m[0] - arm.a_m[3] * c234 - arm.d_m[4] * arm.wrist_sign * s234
        b2 = arm.waist_sign * (p[2] - arm.d_m[0]) - arm.a_m[3] * s234 + arm.d_m[4] * arm.wrist_sign * c234
        a2, a3 = arm.a_m[1], arm.a_m[2]
        c3 = (b1 * b1 + b2 * b2 - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
        reached = np.where(np.abs(c3) <= 1.0 + _ROUNDING, np.clip(c3, -1.0, 1.0), np.nan)
        s3 = branch.elbow * np.sqrt(1.0 - reached * reached)
        across = -arm.waist_sign * arm.wrist_sign  # the pitch axis, turned by α₄, is this much of the plane's normal
        theta = np.stack(
            [
                np.arctan2(s1, c1),
                np.arctan2((a2 + a3 * reached) * b2 - a3 * s3 * b1, (a2 + a3 * reached) * b1 + a3 * s3 * b2),
                np.arctan2(s3, reached),
                np.arctan2(s234, c234),
                np.arctan2(across * (c1 * n[1] - s1 * n[0]), across * (c1 * o[1] - s1 * o[0])),
            ],
            axis=-1,
        )
    theta[..., 3] = _wrapped(theta[..., 3] - theta[..., 1] - theta[..., 2])
    reason = np.zeros(c3.shape, dtype=np.int8)
    reason[np.isnan(reached)] = Reason.OUT_OF_REACH
    reason[is_off_plane] = Reason.YAW
    reason[is_on_axis] = Reason.BASE_AXIS
    theta[reason != Reason.NONE] = np.nan
    return Solutions(theta - np.array(arm.offsets_rad), reason, c3)


def _waist(a: Floats, p: Floats, facing: int, yaw_tolerance: float) -> tuple[Floats, Floats, Mask, Mask]:
    """Cos θ₁, sin θ₁, where the approach leaves the plane through the base's axis and p, and where θ₁ is open.

    Near the axis p has few digits left to say where the plane is; there the approach, if it lies in it, says it better.
    """
    rho, level = np.hypot(p[0], p[1]), np.hypot(a[0], a[1])
    across = np.abs(a[0] * p[1] - a[1] * p[0])  # ρ·|a·h|
    near = _NEAR_AXIS_M * level
    by_approach = (rho < near) & (across <= YAW_TOLERANCE * near)
    with np.errstate(invalid="ignore", divide="ignore"):
        towards = facing * np.where(a[0] * p[0] + a[1] * p[1] < 0.0, -1.0, 1.0) / level
        cos = np.where(by_approach, towards * a[0], facing * p[0] / rho)
        sin = np.where(by_approach, towards * a[1], facing * p[1] / rho)
    is_on_axis = ~by_approach & ~(rho >= LEAST_AXIS_DISTANCE_M)
    return cos, sin, ~(across <= yaw_tolerance * np.maximum(rho, near)), is_on_axis


def _columns(pose: ArrayLike) -> list[Floats]:
    """n, o, a and p, each (3, ...)."""
    try:
        matrix = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise CooperationError("a pose must be a matrix of 4 x 4 numbers") from None
    if matrix.shape[-2:] != (4, 4):
        raise CooperationError(f"a pose has shape {matrix.shape}; must be (..., 4, 4)")
    return [np.moveaxis(matrix[..., :3, column], -1, 0) for column in range(4)]


def _wrapped(angle: Floats) -> Floats:
    """The same angle in (−π, π]."""
    return np.asarray(angle - 2 * np.pi * np.ceil((angle - np.pi) / (2 * np.pi)))


def _within_limits(arm: FiveAxisArm, found: Solutions) -> Solutions:
    if not arm.limits_deg:
        return found
    q_rad, is_within = into_limits(arm, found.q_rad, found.q_rad)
    reason = np.where(found.found & ~is_within.all(axis=-1), Reason.JOINT_LIMIT, found.reason).astype(np.int8)
    return Solutions(np.where((reason == Reason.NONE)[..., None], q_rad, np.nan), reason, found.elbow_cosine)


def into_limits(arm: FiveAxisArm, lowest_rad: Floats, highest_rad: Floats) -> tuple[Floats, Mask]:
    """`lowest_rad` (..., 5), moved by the fewest full turns that bring the whole way up to `highest_rad` into the
    limits, and for each joint whether there are such turns; if not, by those that bring it nearest to them.
    """
    if not arm.limits_deg:
        return lowest_rad, np.ones(lowest_rad.shape, dtype=np.bool_)
    low, high = np.array(arm.limits_rad).T
    with np.errstate(invalid="ignore"):
        fewest = np.ceil((low - lowest_rad) / (2 * np.pi))
        most = np.floor((high - highest_rad) / (2 * np.pi))
        is_within = fewest <= most
        nearest = np.round(((low + high) - (lowest_rad + highest_rad)) / (4 * np.pi))
        turns = np.where(is_within, np.clip(0.0, fewest, most), nearest)
    return lowest_rad + 2 * np.pi * np.where(np.isfinite(turns), turns, 0.0), is_within
