"""The slave's part of a plan, for one base or for many at once: STEPs 1 to 4 along paths, on one branch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .arms import FiveAxisArm
from .closed_form import Codes, into_limits
from .compliance import Compliant, Posture, comply
from .kinematics import Floats
from .limits import PlanLimits
from .reasons import Reason


class SlaveMotion(NamedTuple):
    """The slave along paths (..., n): angles (..., n, 5) in rad, continuous and within the limits where `reason` (...)
    is `NONE`; else `pose` (...) is the first that fails, and `steps` (...) the largest step of any joint, rad.
    """

    q_rad: Floats
    reason: Codes
    pose: NDArray[np.intp]
    largest_step_rad: Floats
    compliant: Compliant


def support(arm: FiveAxisArm, seen: Floats, posture: Posture, limits: PlanLimits) -> SlaveMotion:
    """The slave along paths of object frames (..., n, 4, 4), seen from its base."""
    found = comply(
        arm,
        seen,
        posture,
        least_crossing=limits.least_crossing,
        least_axis_distance_m=limits.least_axis_distance_m,
    )
    reasons = found.reason
    with np.errstate(invalid="ignore"):
        is_straight = 1.0 - found.elbow_cosine**2 < limits.least_elbow_sine**2
    reasons[(reasons == Reason.NONE) & is_straight] = Reason.SINGULAR
    q_rad = unwound(found.q_rad)
    steps = np.abs(np.diff(q_rad, axis=-2)).max(axis=-1)
    with np.errstate(invalid="ignore"):
        flips = steps > np.radians(limits.largest_step_deg)
    reasons[..., 1:][flips & (reasons[..., 1:] == Reason.NONE)] = Reason.BRANCH_FLIP
    pose = np.argmax(reasons != Reason.NONE, axis=-1)
    reason = np.take_along_axis(reasons, pose[..., None], axis=-1)[..., 0]
    works = reason == Reason.NONE
    lowest, highest = q_rad.min(axis=-2), q_rad.max(axis=-2)
    moved, is_within = into_limits(arm, lowest, highest)
    turns = np.where(works[..., None], np.round((moved - lowest) / (2 * np.pi)), 0.0)
    q_rad = q_rad + 2 * np.pi * turns[..., None, :]
    reason = np.where(works & ~is_within.all(axis=-1), Reason.JOINT_LIMIT, reason).astype(np.int8)
    if arm.limits_deg:
        low, high = np.array(arm.limits_rad).T
        beyond = ((q_rad < low) | (q_rad > high)).any(axis=-1)
        pose = np.where(reason == Reason.JOINT_LIMIT, np.argmax(beyond, axis=-1), pose)
    return SlaveMotion(q_rad, reason, pose, steps.max(axis=-1, initial=0.0), found)


def unwound(q_rad: Floats) -> Floats:
    """Angles (..., n, joints) with full turns added, so that no step along n is longer than half a turn."""
    turns = np.cumsum(np.round(np.diff(q_rad, axis=-2) / (2 * np.pi)), axis=-2)
    joined = q_rad.copy()
    joined[..., 1:, :] -= 2 * np.pi * turns
    return joined
