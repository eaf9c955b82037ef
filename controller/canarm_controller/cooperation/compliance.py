"""The slave's compliant pose: STEPs 1 to 4 of the paper in the form in which they always fit a five-axis arm.

Definition 1, put right: the slave's approach is perpendicular to the object's (a_s ⟂ a_o), its normal along the
object's approach (n_s = ±a_o). Frames are (..., 4, 4); those of STEPs 1 to 3 are seen from the slave's base, as the
plane in which a five-axis arm can point is that of its own base's axis. `as_printed` has the paper's own form.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import CooperationError
from .arms import FiveAxisArm
from .closed_form import Branch, Codes, Solutions, inverse_branch
from .kinematics import Floats
from .reasons import Reason

LEAST_CROSSING = 0.05
"""‖a_o × h‖ below which the hand would have to turn through nearly 180° within a small part of a path."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Posture:
    """What is open in the slave's pose, and must stay as it is along a path for its joints to be continuous.

    - `approach`: s₂ = ±1 of a_s = s₂·(a_o × h)/‖a_o × h‖, or None: such that the hand points away from the slave's base
      at the first pose, and stays;
    - `normal`: s₃ = ±1 of n_s = s₃·a_o; the other one turns the roll by 180°;
    - `elbow`: the sign of sin θ₃; `facing`: +1 with the waist towards B, −1 away from it.
    """

    approach: int | None = None
    normal: int = 1
    elbow: int = 1
    facing: int = 1

    def __post_init__(self) -> None:
        for name in ("approach", "normal", "elbow", "facing"):
            value = getattr(self, name)
            if value not in (1, -1) and not (name == "approach" and value is None):
                raise CooperationError(f"{name} = {value}; must be 1 or -1")


class Plane(NamedTuple):
    """The plane through the slave's base's axis and B: its normal h (..., 3), B's distance ρ (...) from the axis, m."""

    normal: Floats
    distance_m: Floats


class Crossing(NamedTuple):
    """a_o × h (..., 3) and its length (...), 1 where the object's approach lies in the slave's plane, 0 across it."""

    vector: Floats
    length: Floats


def step_1(seen: Floats) -> Plane:
    """θ₁: the waist turns the slave's plane through B. `seen` is o* from the slave's base, w*⁻¹·o*."""
    x, y = seen[..., 0, 3], seen[..., 1, 3]
    distance_m = np.hypot(x, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        return Plane(np.stack([-y / distance_m, x / distance_m, np.zeros_like(x)], axis=-1), distance_m)


def step_2(seen: Floats, plane: Plane, approach: Floats) -> tuple[Floats, Crossing]:
    """θ₄: the approach a_s (..., 3) within that plane and perpendicular to a_o; `approach` is s₂, ±1."""
    a_x, a_y, a_z = (seen[..., axis, 2] for axis in range(3))
    h_x, h_y = plane.normal[..., 0], plane.normal[..., 1]
    vector = np.stack([-a_z * h_y, a_z * h_x, a_x * h_y - a_y * h_x], axis=-1)
    length = np.sqrt((vector**2).sum(axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        return (approach / length)[..., None] * vector, Crossing(vector, length)


def step_3(seen: Floats, approach_vector: Floats, normal: int) -> Floats:
    """θ₅: the roll lays the normal along a_o. The compliant frame T_s3 at B, (..., 4, 4)."""
    frame = np.zeros_like(seen)
    n, a = normal * seen[..., :3, 2], approach_vector
    frame[..., :3, 0], frame[..., :3, 2], frame[..., :3, 3] = n, a, seen[..., :3, 3]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # o = a × n
        frame[..., i, 1] = a[..., j] * n[..., k] - a[..., k] * n[..., j]
    frame[..., 3, 3] = 1.0
    return frame


def step_4(arm: FiveAxisArm, frame: Floats, branch: Branch) -> Solutions:
    """The joint angles of T_s4 by inverse kinematics."""
    return inverse_branch(arm, frame, branch)


class Compliant(NamedTuple):
    """The slave's frames (..., 4, 4) seen from its base, its joint angles (..., 5), the reason (...) where it has none,
    ‖a_o × h‖ and c₃ (...), and s₂ (..., 1), the same along each path.
    """

    frame: Floats
    q_rad: Floats
    reason: Codes
    crossing: Floats
    elbow_cosine: Floats
    approach: Floats


def comply(
    arm: FiveAxisArm,
    seen: Floats,
    posture: Posture,
    *,
    least_crossing: float = LEAST_CROSSING,
    least_axis_distance_m: float = 0.0,
) -> Compliant:
    """STEPs 1 to 4 for paths of object frames (..., poses, 4, 4), seen from the slave's base."""
    plane = step_1(seen)
    approach = outward(seen) if posture.approach is None else np.full((*seen.shape[:-3], 1), float(posture.approach))
    approach_vector, crossing = step_2(seen, plane, approach)
    frame = step_3(seen, approach_vector, posture.normal)
    found = step_4(arm, frame, Branch(posture.facing, posture.elbow))
    reason = found.reason.copy()
    reason[~(crossing.length >= least_crossing)] = Reason.PARALLEL
    reason[~(plane.distance_m >= least_axis_distance_m) | np.isnan(plane.normal[..., 0])] = Reason.BASE_AXIS
    return Compliant(frame, found.q_rad, reason, crossing.length, found.elbow_cosine, approach)


def outward(seen: Floats) -> Floats:
    """s₂ (..., 1) with which the first pose of each path points away from the slave's base: a_s·p̂ = −s₂·a_oz ≥ 0.

    Where the hand is to point straight up or down there, down.
    """
    first = seen[..., :1, :, :]
    down = first[..., 0, 2] * first[..., 0, 3] + first[..., 1, 2] * first[..., 1, 3]
    a_z = first[..., 2, 2]
    return np.where(np.abs(a_z) > 1e-12, np.where(a_z > 0.0, -1.0, 1.0), np.where(down > 0.0, -1.0, 1.0))
