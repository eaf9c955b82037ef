"""Arms by their Denavit-Hartenberg values: any chain of revolute joints, and the five-axis shape of the paper.

Owns the numbers and the conditions for the closed form of `closed_form`; poses are elsewhere.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

from canarm_protocol.cell.model import Robot

from ..errors import CooperationError

JOINTS = 5
"""Joints of an arm of the paper's shape: waist, shoulder, elbow, pitch and roll."""
LARGEST_M = 100.0
"""A longer length is a mistaken unit."""
_SHAPE = {"d_m": (1, 2, 3), "a_m": (4,), "alpha_deg": (1, 2, 4)}
"""What must be zero in a five-axis arm, by joint from 0: joints 2 to 4 are parallel and in one plane with the waist's
axis, and the roll's axis is the approach vector."""


def _floats(name: str, values: Iterable[float]) -> tuple[float, ...]:
    try:
        return tuple(map(float, values))
    except (TypeError, ValueError):
        raise CooperationError(f"{name} = {values!r}; must be a list of numbers") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class DhChain:
    """A chain of revolute joints, A = Rz(q + offset)·Tz(d)·Tx(a)·Rx(α), one number per joint: m and degrees.

    `limits_deg` has a lowest and a highest angle for every joint; without it none is limited. Raises
    `CooperationError` for numbers that are not finite, lengths beyond 100 m, and lists of different lengths.
    """

    d_m: tuple[float, ...]
    a_m: tuple[float, ...]
    alpha_deg: tuple[float, ...]
    theta_offset_deg: tuple[float, ...] = ()
    limits_deg: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for name in ("d_m", "a_m", "alpha_deg", "theta_offset_deg"):
            object.__setattr__(self, name, _floats(name, getattr(self, name)))
        object.__setattr__(self, "limits_deg", tuple(_floats("limits_deg", pair) for pair in self.limits_deg))
        count = len(self.d_m)
        if not count:
            raise CooperationError("d_m has no number; must have one for every joint")
        for name in ("a_m", "alpha_deg", "theta_offset_deg", "limits_deg"):
            found = len(getattr(self, name))
            if found != count and (found or name in ("a_m", "alpha_deg")):
                raise CooperationError(f"{name} has {found} numbers, d_m has {count}; must have one for every joint")
        for name in ("d_m", "a_m", "alpha_deg", "theta_offset_deg"):
            for joint, value in enumerate(getattr(self, name), start=1):
                if not math.isfinite(value):
                    raise CooperationError(f"{name} of joint {joint} = {value}; must be finite")
                if name.endswith("_m") and abs(value) > LARGEST_M:
                    raise CooperationError(f"{name} of joint {joint} = {value:g} m; must be within +-{LARGEST_M:g} m")
        pairs: tuple[tuple[float, ...], ...] = self.limits_deg
        for joint, limits in enumerate(pairs, start=1):
            if len(limits) != 2 or not limits[0] < limits[1]:
                raise CooperationError(f"limits_deg of joint {joint} = {limits}; must be a lower and a higher angle")

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.d_m)

    @property
    def offsets_rad(self) -> tuple[float, ...]:
        """Offset of each joint's angle, rad."""
        return tuple(map(math.radians, self.theta_offset_deg)) or (0.0,) * self.joint_count

    @property
    def limits_rad(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest angle of each joint, rad; infinite without limits."""
        if not self.limits_deg:
            return ((-math.inf, math.inf),) * self.joint_count
        return tuple((math.radians(low), math.radians(high)) for low, high in self.limits_deg)


@dataclass(frozen=True, slots=True, kw_only=True)
class FiveAxisArm(DhChain):
    """An arm of the paper's shape: a waist, three parallel joints in a plane through its axis, and a roll.

    d₂ = d₃ = d₄ = a₅ = 0, α₂ = α₃ = α₅ = 0, α₁ and α₄ are ±90°, a₂ and a₃ are not zero; d₁, a₁, a₄, d₅ and the offsets
    are free. Raises `CooperationError` naming the value that differs.
    """

    def __post_init__(self) -> None:
        # super() without arguments does not find the new class that slots=True makes.
        super(FiveAxisArm, self).__post_init__()
        if self.joint_count != JOINTS:
            raise CooperationError(f"an arm of {self.joint_count} joints; a five-axis arm has {JOINTS}")
        for name, joints in _SHAPE.items():
            for joint in joints:
                if getattr(self, name)[joint] != 0.0:
                    value = getattr(self, name)[joint]
                    raise CooperationError(f"{name} of joint {joint + 1} = {value:g}; must be 0 in a five-axis arm")
        for joint in (0, 3):
            if abs(self.alpha_deg[joint]) != 90.0:
                value = self.alpha_deg[joint]
                raise CooperationError(f"alpha_deg of joint {joint + 1} = {value:g}; must be 90 or -90")
        for joint in (1, 2):
            if not self.a_m[joint] > 0.0:
                raise CooperationError(f"a_m of joint {joint + 1} = {self.a_m[joint]:g}; must be positive")

    @property
    def waist_sign(self) -> float:
        """+1 where α₁ = 90°: joints 2 to 4 lift the arm; −1 where α₁ = −90°: they lower it."""
        return math.copysign(1.0, self.alpha_deg[0])

    @property
    def wrist_sign(self) -> float:
        """+1 where α₄ = 90°, −1 where α₄ = −90°."""
        return math.copysign(1.0, self.alpha_deg[3])

    @property
    def reach_m(self) -> float:
        """How far the tip can be from the shoulder, stretched out, m."""
        return self.a_m[1] + self.a_m[2] + math.hypot(self.a_m[3], self.d_m[4])

    @classmethod
    def of_robot(cls, robot: Robot) -> Self:
        """The nominal arm of a cell's robot, with its joint limits.

        Raises `CooperationError` where it has another shape, a joint that counts the other way, or links by bodies
        instead of Denavit-Hartenberg values.
        """
        for joint in robot.joint:
            if joint.link is None:
                raise CooperationError(
                    f"robot {robot.name!r}, joint {joint.name!r} has a body; must have a Denavit-Hartenberg link"
                )
            if joint.link.sign < 0:
                raise CooperationError(f"robot {robot.name!r}, joint {joint.name!r}.link.sign = -1: must be 1")
        links = [joint.dh_link for joint in robot.joint]
        try:
            return cls(
                d_m=tuple(link.d_m for link in links),
                a_m=tuple(link.a_m for link in links),
                alpha_deg=tuple(link.alpha_deg for link in links),
                theta_offset_deg=tuple(link.theta_offset_deg for link in links),
                limits_deg=tuple(joint.limits_deg for joint in robot.joint),
            )
        except CooperationError as error:
            raise CooperationError(f"robot {robot.name!r}: {error}") from None


RHINO_XR = FiveAxisArm(
    d_m=(0.2604, 0.0, 0.0, 0.0, 0.1683),
    a_m=(0.0, 0.2286, 0.2286, 0.0095, 0.0),
    alpha_deg=(-90.0, 0.0, 0.0, -90.0, 0.0),
)
"""The RHINO XR: 10.25, 9, 9, 0.375 and 6.625 inch. No source for its joint limits is known, so it has none here."""
