"""The geometry and inertia of a serial arm as plain numbers, from which every form of its dynamics starts.

Owns the step from a cell's `Robot` to Denavit-Hartenberg parameters in SI units; `frames` holds the one from bodies.
Equations of motion, drives and joint names beyond error messages must not enter.
"""

from dataclasses import dataclass
from math import isfinite, radians
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Joint, Robot
from canarm_protocol.cell.rigid import exact_cos_sin

from ..errors import DynamicsError
from .frames import Placement, unwound

Floats: TypeAlias = NDArray[np.float64]
Vector = tuple[float, float, float]
Tensor = tuple[float, float, float, float, float, float]

_HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
"""Rx(pi), with which Rz(-q) = Rx(pi)·Rz(q)·Rx(pi)."""
MAX_JOINTS = 7
"""The schema of a cell allows no more."""


@dataclass(frozen=True, slots=True)
class ChainLink:
    """One revolute joint and its link: A = Rz(q + offset)·T(a, b, d)·Rx(α), with b = 0 paper (2-1) put right.

    Every chain of revolute joints can be written in this way: α and the offsets allow any direction of the axes, and b
    avoids the distant origins that Denavit and Hartenberg's convention needs for nearly parallel axes.

    `centre_m` and the tensor `inertia_kg_m2` (xx, yy, zz, xy, xz, yz) about it are in the link's own frame, at the
    link's far end.
    """

    name: str
    a_m: float
    b_m: float
    d_m: float
    cos_alpha: float
    sin_alpha: float
    theta_offset_rad: float
    mass_kg: float
    centre_m: Vector
    inertia_kg_m2: Tensor

    def twist(self) -> Floats:
        """T(a, b, d)·Rx(α), the part of A that does not turn: 4 × 4."""
        c, s = self.cos_alpha, self.sin_alpha
        return np.array([[1, 0, 0, self.a_m], [0, c, -s, self.b_m], [0, s, c, self.d_m], [0, 0, 0, 1]], np.float64)

    def pseudo_inertia(self) -> Floats:
        """The paper's J_i = ∫ r rᵀ dm of homogeneous points r in the link's own frame, 4 × 4.

        Its upper left part is ½tr(I)·1 − I from *central* moments I, plus m·c·cᵀ; the paper adds its m·l² to moments
        that are about the origin already.
        """
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        centre = np.array([*self.centre_m, 1.0])
        second = np.zeros((4, 4))
        second[:3, :3] = 0.5 * (xx + yy + zz) * np.eye(3) - np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return second + self.mass_kg * np.outer(centre, centre)


@dataclass(frozen=True, slots=True)
class Chain:
    """A serial arm of revolute joints, base to tip, in a field of gravity (m/s², along the axes of the base)."""

    name: str
    links: tuple[ChainLink, ...]
    gravity_m_s2: Vector

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""
        return tuple(link.name for link in self.links)


def chain_of(robot: Robot) -> Chain:
    """The nominal chain of a cell's robot. Where bodies stand for links, its base is turned with the first axis.

    Raises `DynamicsError` for none or more than 7 joints, and for a parameter that is not a finite number: a robot
    that was read from a cell file has neither.
    """
    if not 1 <= len(robot.joint) <= MAX_JOINTS:
        raise DynamicsError(f"robot {robot.name!r} has {len(robot.joint)} joints; must have 1 to {MAX_JOINTS}")
    check_parameters(robot)
    if all(joint.link is not None and joint.link.sign > 0 for joint in robot.joint):
        return Chain(robot.name, tuple(map(_link_by_denavit_hartenberg, robot.joint)), robot.gravity_m_s2)
    base, parts = unwound([_placement(joint) for joint in robot.joint])
    gx, gy, gz = (base.T @ np.array(robot.gravity_m_s2)).tolist()
    links = tuple(
        ChainLink(
            joint.name, *part.reach_m, part.cos_alpha, part.sin_alpha, part.offset_rad, *part.moved(*_inertial(joint))
        )
        for joint, part in zip(robot.joint, parts, strict=True)
    )
    return Chain(robot.name, links, (gx, gy, gz))


def check_parameters(robot: Robot) -> None:
    """Raise `DynamicsError` if a parameter of the links is not a finite number; says which."""
    _check_finite(f"robot {robot.name!r}, gravity_m_s2", robot.gravity_m_s2)
    for joint in robot.joint:
        for key, value in joint.solid:
            kind = "link" if joint.body is None else "body"
            _check_finite(f"robot {robot.name!r}, {joint.name}.{kind}.{key}", value)


def _link_by_denavit_hartenberg(joint: Joint) -> ChainLink:
    link = joint.dh_link
    return ChainLink(
        name=joint.name,
        a_m=link.a_m,
        b_m=0.0,
        d_m=link.d_m,
        cos_alpha=exact_cos_sin(link.alpha_deg)[0],
        sin_alpha=exact_cos_sin(link.alpha_deg)[1],
        theta_offset_rad=radians(link.theta_offset_deg),
        mass_kg=link.mass_kg,
        centre_m=link.centre_of_mass_m,
        inertia_kg_m2=link.tensor_kg_m2,
    )


def _placement(joint: Joint) -> Placement:
    """Where the joint's axis is in the link before, and its own link's frame from there."""
    body = joint.body
    if body is not None:
        return Placement.of_body(body.origin_m, body.origin_rpy_deg, body.axis)
    link = _link_by_denavit_hartenberg(joint)
    if joint.dh_link.sign > 0:
        return Placement(np.eye(4), link.theta_offset_rad, link.twist())
    return Placement(_HALF_TURN, -link.theta_offset_rad, _HALF_TURN @ link.twist())


def _inertial(joint: Joint) -> tuple[float, Vector, Tensor]:
    """Mass, centre of mass and central tensor of the joint's link, in its own frame."""
    if joint.body is not None:
        return joint.body.mass_kg, joint.body.centre_of_mass_m, joint.body.inertia_kg_m2
    link = _link_by_denavit_hartenberg(joint)
    return link.mass_kg, link.centre_m, link.inertia_kg_m2


def _check_finite(where: str, value: object) -> None:
    numbers = value if isinstance(value, tuple) else (value,)
    if not all(isfinite(number) for number in numbers):
        raise DynamicsError(f"{where} = {value}: must be finite")
