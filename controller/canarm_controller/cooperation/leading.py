"""The master's part of a plan: the path by (5), T_m and o*, refused where the arm cannot follow."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CooperationError
from .arms import FiveAxisArm
from .carrying import ArmPair
from .closed_form import into_limits
from .kinematics import Floats, checked_pose, forward, least_singular_value_m
from .limits import PlanLimits
from .master import NEWTON_STEPS, follow
from .paths import Path
from .reasons import Reason, RefusedPlanError

MASTER = "master"


@dataclass(frozen=True, slots=True, eq=False)
class MasterMotion:
    """The master along a path, in its base's frame: targets of its tip (n, 3) in m, angles (n, 5) in rad, tip T_m."""

    time_s: Floats
    target_m: Floats
    q_rad: Floats
    tip: Floats


def lead(
    pair: ArmPair,
    path: Path,
    start_rad: ArrayLike,
    *,
    newton_steps: int = NEWTON_STEPS,
    damping_m: float = 0.0,
    limits: PlanLimits | None = None,
) -> MasterMotion:
    """The master along `path` from `start_rad` (5,). Raises `RefusedPlanError` where it cannot follow."""
    limits = limits or PlanLimits()
    arm = pair.master
    if newton_steps < 0 or not 0.0 <= damping_m < np.inf:
        raise CooperationError(f"newton_steps = {newton_steps}, damping_m = {damping_m}; must be 0 or more")
    start = checked_pose(arm, start_rad)
    target = path.point_m + forward(arm, start)[:3, 3] if path.from_start else path.point_m
    q_rad = follow(
        arm,
        start,
        target,
        newton_steps=newton_steps,
        damping_m=damping_m,
        damped_below_m=limits.least_singular_value_m,
    )
    _refuse_what_is_not_reached(arm, target, q_rad, limits, damping_m > 0.0)
    tip = forward(arm, q_rad)
    error = np.sqrt(((tip[:, :3, 3] - target) ** 2).sum(axis=1))
    off = np.flatnonzero(~(error <= limits.largest_path_error_m))
    if len(off):
        pose = int(off[0])
        raise RefusedPlanError(
            Reason.OFF_PATH,
            MASTER,
            pose,
            f"the tip would be {error[pose] * 1e3:.3g} mm beside it; at most {limits.largest_path_error_m * 1e3:g} mm: "
            "start nearer to the path, take smaller steps, or stay where the arm is nimbler",
        )
    refuse_steps(MASTER, q_rad, limits)
    return MasterMotion(path.time_s, target, _limited(arm, q_rad), tip)


def refuse_steps(robot: str, q_rad: Floats, limits: PlanLimits) -> None:
    """Raise `RefusedPlanError` where a joint of `q_rad` (n, 5) turns too far from one pose to the next."""
    steps = np.abs(np.diff(q_rad, axis=0))
    far = np.argwhere(~(steps <= np.radians(limits.largest_step_deg)))
    if len(far):
        pose, joint = far[0].tolist()
        raise RefusedPlanError(
            Reason.BRANCH_FLIP,
            robot,
            pose + 1,
            f"joint {joint + 1} would turn by {np.degrees(steps[pose, joint]):.3g} deg from one pose to the next; "
            f"at most {limits.largest_step_deg:g} deg: keep away from there, or take smaller steps",
        )


def refuse_beyond_limits(robot: str, arm: FiveAxisArm, q_rad: Floats) -> None:
    """Raise `RefusedPlanError` where `q_rad` (n, 5), no full turns added, leaves the arm's joint limits."""
    low, high = np.array(arm.limits_rad).T
    beyond = np.argwhere((q_rad < low) | (q_rad > high))
    if len(beyond):
        pose, joint = beyond[0].tolist()
        limit = arm.limits_deg[joint]
        raise RefusedPlanError(
            Reason.JOINT_LIMIT,
            robot,
            pose,
            f"joint {joint + 1} would be at {np.degrees(q_rad[pose, joint]):.4g} deg; "
            f"must be within {limit[0]:g} and {limit[1]:g} deg",
        )


def _refuse_what_is_not_reached(
    arm: FiveAxisArm, target: Floats, q_rad: Floats, limits: PlanLimits, damped: bool
) -> None:
    """Raise `RefusedPlanError` at the first pose whose point is too far away, or where the arm is nearly singular."""
    radial = np.hypot(target[:, 0], target[:, 1]) - abs(arm.a_m[0])
    away = np.hypot(np.maximum(radial, 0.0), target[:, 2] - arm.d_m[0])
    sigma = least_singular_value_m(arm, q_rad)
    is_far = ~(away <= arm.reach_m)
    is_near = ~(sigma >= limits.least_singular_value_m) & (not damped)
    failing = np.flatnonzero(is_far | is_near)
    if not len(failing):
        return
    pose = int(failing[0])
    if is_far[pose]:
        raise RefusedPlanError(
            Reason.OUT_OF_REACH,
            MASTER,
            pose,
            f"the point is {away[pose]:.3f} m from the shoulder; the arm reaches {arm.reach_m:.3f} m",
        )
    raise RefusedPlanError(
        Reason.SINGULAR,
        MASTER,
        pose,
        f"sigma_min of its Jacobian is {sigma[pose]:.3g} m/rad; must be at least {limits.least_singular_value_m:g}: "
        "begin in a pose that is bent, or damp (5)",
    )


def _limited(arm: FiveAxisArm, q_rad: Floats) -> Floats:
    """The path with the full turns that bring it into the limits. Raises where none do."""
    lowest, highest = q_rad.min(axis=0), q_rad.max(axis=0)
    moved, _ = into_limits(arm, lowest, highest)
    limited: Floats = q_rad + np.round((moved - lowest) / (2 * np.pi)) * 2 * np.pi
    refuse_beyond_limits(MASTER, arm, limited)
    return limited
