"""A joint with what moves with it, whether the cell describes it by a Denavit-Hartenberg link or by a body.

Geometry and inertia only; friction, drives and the XML never enter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from canarm_protocol.cell.arm import Tensor
from canarm_protocol.cell.model import Body, Joint, Link

from .poses import ORIGIN, Point, Pose, about_x, about_z, from_rpy_deg, quaternion_of


@dataclass(frozen=True, slots=True)
class Segment:
    """A joint and its moving body. `origin` places the body's frame at angle 0 in the end frame of the one before.

    Everything else is in the body's frame, which turns about `axis` through its origin: the end frame, centre of mass
    and principal axes (`inertial`), and the far end of the link (`tip_m`), where a payload hangs.
    """

    origin: Pose
    axis: Point
    end: Pose
    inertial: Pose
    mass_kg: float
    moments_kg_m2: tuple[float, float, float]
    tip_m: Point


def segments_of(joints: Sequence[Joint]) -> list[Segment]:
    """The segments of an arm, base to tip. The far end of a link is its end frame, that of a body the next joint.

    The last body's far end is twice as far away as its centre of mass, as in a uniform rod.
    """
    following = [*(joint.body for joint in joints[1:]), None]
    return [_segment(joint.solid, after) for joint, after in zip(joints, following, strict=True)]


def _segment(solid: Link | Body, after: Body | None) -> Segment:
    return _of_link(solid) if isinstance(solid, Link) else _of_body(solid, after)


def _of_link(link: Link) -> Segment:
    # The link's own frame lies at its far end: A = Rz(θ)·Tz(d)·Tx(a)·Rx(α), and Rz(θ) is the hinge.
    end = Pose((link.a_m, 0.0, link.d_m), about_x(math.radians(link.alpha_deg)))
    moments, axes = _possible(link.inertia_kg_m2), Pose()
    if any(link.products_kg_m2):
        moments, axes = _principal(link.tensor_kg_m2)
    return Segment(
        origin=Pose(ORIGIN, about_z(math.radians(link.theta_offset_deg))),
        axis=(0.0, 0.0, float(link.sign)),
        end=end,
        inertial=Pose(end.at(link.centre_of_mass_m), end.then(axes).quaternion),
        mass_kg=link.mass_kg,
        moments_kg_m2=moments,
        tip_m=end.position_m,
    )


def _possible(moments: Sequence[float]) -> tuple[float, float, float]:
    """Moments made possible: MuJoCo refuses a negative one, or one above the sum of the others, from rounding."""
    a, b, c = (max(moment, 0.0) for moment in moments)
    return min(a, b + c), min(b, a + c), min(c, a + b)


def _principal(tensor: Tensor) -> tuple[tuple[float, float, float], Pose]:
    """The principal moments of a tensor, and the frame of its axes."""
    xx, yy, zz, xy, xz, yz = tensor
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] = -axes[:, 2]
    return _possible(moments.tolist()), Pose(quaternion=quaternion_of(axes))


def _of_body(body: Body, after: Body | None) -> Segment:
    moments, axes = _principal(body.inertia_kg_m2)
    x, y, z = body.centre_of_mass_m
    return Segment(
        origin=Pose(body.origin_m, from_rpy_deg(body.origin_rpy_deg)),
        axis=body.axis,
        end=Pose(),
        inertial=Pose(body.centre_of_mass_m, axes.quaternion),
        mass_kg=body.mass_kg,
        moments_kg_m2=moments,
        tip_m=(2.0 * x, 2.0 * y, 2.0 * z) if after is None else after.origin_m,
    )
