"""The flow charts of the paper's Fig. 5 as code: a path of A in, ten joint paths out, or the reason why not.

(a) for every pose: A by the path, θ_m by (5), T_m, o* = T_m·x by (2), P_s by (3), STEPs 1 to 4, θ_s.
(b) STEPs 1 to 4: `compliance`.
"""

import numpy as np
from numpy.typing import ArrayLike

from .carrying import ArmPair, seen_from
from .compliance import Posture
from .leading import lead, refuse_beyond_limits
from .limits import PlanLimits
from .master import NEWTON_STEPS
from .paths import Path
from .plan import CooperationPlan
from .reasons import Reason, RefusedPlanError
from .supporting import SlaveMotion, support

SLAVE = "slave"


def plan_cooperation(
    pair: ArmPair,
    path: Path,
    master_start_rad: ArrayLike,
    *,
    posture: Posture | None = None,
    newton_steps: int = NEWTON_STEPS,
    damping_m: float = 0.0,
    limits: PlanLimits | None = None,
) -> CooperationPlan:
    """Ten joint paths that lead the object along `path`: the master grips it, the slave supports it.

    `master_start_rad` (5,) is the master's pose at the start; where the path has positions instead of displacements, it
    is the pose from which the first place is looked for. `newton_steps` = 0 and `damping_m` = 0 is (5) as printed.

    Raises `RefusedPlanError`, with its reason, for a path that cannot be followed from end to end: nothing has moved
    then. Raises `CooperationError` for input that is no path or no pose.
    """
    posture, limits = posture or Posture(), limits or PlanLimits()
    master = lead(pair, path, master_start_rad, newton_steps=newton_steps, damping_m=damping_m, limits=limits)
    object_frame = pair.carried.frame(master.tip)
    seen = seen_from(pair.base_transform, object_frame)
    slave = support(pair.slave, seen, posture, limits)
    _refuse(pair, slave, seen[:, :3, 3], limits)
    return CooperationPlan(
        pair=pair,
        posture=Posture(
            approach=int(slave.compliant.approach[0]),
            normal=posture.normal,
            elbow=posture.elbow,
            facing=posture.facing,
        ),
        time_s=master.time_s,
        target_m=master.target_m,
        master_rad=master.q_rad,
        slave_rad=slave.q_rad,
        object_frame=object_frame,
    )


def _refuse(pair: ArmPair, slave: SlaveMotion, point_m: np.ndarray, limits: PlanLimits) -> None:
    reason, pose = Reason(int(slave.reason)), int(slave.pose)
    if reason is Reason.NONE:
        return
    if reason is Reason.JOINT_LIMIT:
        refuse_beyond_limits(SLAVE, pair.slave, slave.q_rad)
    x, y, z = point_m[pose].tolist()
    away, crossing, cosine = np.hypot(x, y), slave.compliant.crossing[pose], slave.compliant.elbow_cosine[pose]
    with np.errstate(invalid="ignore"):
        steps = np.degrees(np.abs(slave.q_rad[pose] - slave.q_rad[pose - 1])) if pose else np.zeros(5)
    joint = int(np.argmax(steps))
    detail = {
        Reason.OUT_OF_REACH: f"B is at ({x:.3f}, {y:.3f}, {z:.3f}) m from its base, the elbow's cosine would be "
        f"{cosine:.2f}; must be within +-1: bring base and B nearer to each other, or further apart if they touch",
        Reason.BASE_AXIS: f"B is {away * 1e3:.3g} mm from it; must be at least {limits.least_axis_distance_m * 1e3:g} "
        "mm: move the slave's base",
        Reason.PARALLEL: f"|a_o x h| = {crossing:.3g}; must be at least {limits.least_crossing:g}, or the hand would "
        "have to turn round: move the slave's base, or turn the object",
        Reason.SINGULAR: f"the elbow is straight or folded, its cosine is {cosine:.4f}; |sine| must be at least "
        f"{limits.least_elbow_sine:g}: move the slave's base",
        Reason.BRANCH_FLIP: f"joint {joint + 1} would turn by {steps[joint]:.3g} deg from one pose to the next; "
        f"at most {limits.largest_step_deg:g} deg: move the slave's base, or take smaller steps",
    }.get(reason, "")
    raise RefusedPlanError(reason, SLAVE, pose, detail)
