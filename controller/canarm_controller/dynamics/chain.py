"""The geometry and inertia of a serial arm as plain numbers: what every form of its dynamics starts from.

Owns the step from a cell's `Robot` to standard Denavit-Hartenberg parameters in SI units. Equations of motion, drives
and joint names beyond error messages must not enter.
"""

from dataclasses import dataclass
from math import cos, isfinite, radians, sin

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Link, Robot

from ..errors import DynamicsError

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

MAX_JOINTS = 6
"""As many as the schema of a cell allows."""

_QUARTER_TURNS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}


@dataclass(frozen=True, slots=True)
class ChainLink:
    """One revolute joint and its link: A = Rz(q + offset)·Tz(d)·Tx(a)·Rx(α), paper (2-1) put right.

    `centre_m` and the principal moments `inertia_kg_m2` about it are in the link's own frame, at the link's far end.
    """

    name: str
    a_m: float
    d_m: float
    cos_alpha: float
    sin_alpha: float
    theta_offset_rad: float
    mass_kg: float
    centre_m: Vector
    inertia_kg_m2: Vector

    def twist(self) -> Floats:
        """Tz(d)·Tx(a)·Rx(α), the part of A that does not turn: 4 × 4."""
        c, s = self.cos_alpha, self.sin_alpha
        return np.array([[1, 0, 0, self.a_m], [0, c, -s, 0], [0, s, c, self.d_m], [0, 0, 0, 1]], dtype=np.float64)

    def pseudo_inertia(self) -> Floats:
        """The paper's J_i = ∫ r rᵀ dm of homogeneous points r in the link's own frame, 4 × 4.

        Its upper left part is ½tr(I)·1 − I from *central* moments I, plus m·c·cᵀ; the paper adds its m·l² to moments
        that are about the origin already.
        """
        xx, yy, zz = self.inertia_kg_m2
        centre = np.array([*self.centre_m, 1.0])
        central = np.diag([-xx + yy + zz, xx - yy + zz, xx + yy - zz, 0.0]) / 2
        return central + self.mass_kg * np.outer(centre, centre)


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
    """The nominal chain of a cell's robot.

    Raises `DynamicsError` for none or more than 6 joints, and for a parameter that is not a finite number: a robot
    that was read from a cell file has neither.
    """
    if not 1 <= len(robot.joint) <= MAX_JOINTS:
        raise DynamicsError(f"robot {robot.name!r} has {len(robot.joint)} joints; must have 1 to {MAX_JOINTS}")
    check_parameters(robot)
    links = tuple(_chain_link(joint.name, joint.dh_link) for joint in robot.joint)
    return Chain(robot.name, links, robot.gravity_m_s2)


def check_parameters(robot: Robot) -> None:
    """Raise `DynamicsError` if a parameter of the links is not a finite number; says which."""
    _check_finite(f"robot {robot.name!r}, gravity_m_s2", robot.gravity_m_s2)
    for joint in robot.joint:
        for key, value in joint.solid:
            _check_finite(f"robot {robot.name!r}, {joint.name}.link.{key}", value)


def _chain_link(name: str, link: Link) -> ChainLink:
    cos_alpha, sin_alpha = _exact_cos_sin(link.alpha_deg)
    return ChainLink(
        name=name,
        a_m=link.a_m,
        d_m=link.d_m,
        cos_alpha=cos_alpha,
        sin_alpha=sin_alpha,
        theta_offset_rad=radians(link.theta_offset_deg),
        mass_kg=link.mass_kg,
        centre_m=link.centre_of_mass_m,
        inertia_kg_m2=link.inertia_kg_m2,
    )


def _exact_cos_sin(angle_deg: float) -> tuple[float, float]:
    """Cosine and sine with true zeros at quarter turns, so that the fast forms can leave those products out."""
    exact = _QUARTER_TURNS.get(angle_deg % 360.0)
    return exact or (cos(radians(angle_deg)), sin(radians(angle_deg)))


def _check_finite(where: str, value: float | Vector) -> None:
    numbers = value if isinstance(value, tuple) else (value,)
    if not all(map(isfinite, numbers)):
        raise DynamicsError(f"{where} = {value}: must be finite")
