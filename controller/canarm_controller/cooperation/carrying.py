"""The object and the two arms around it: where the slave takes hold, and where its base stands.

Owns the paper's x of (2), o* of (1) and w*. How the slave turns its hand is for `compliance`.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from canarm_protocol.cell.model import Robot
from canarm_protocol.cell.rigid import from_rpy_deg, to_rpy

from ..errors import CooperationError
from .arms import FiveAxisArm
from .kinematics import Floats

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CarriedObject:
    """A long object that the master grips at A and the slave holds at B; A is the master's tip.

    B is `grasp_distance_m` away from A, the paper's K: half the object's length unless given, as (2) says, which is the
    object's middle if A is its end. θ_x and θ_z of (2) are its direction in the master's tool frame: both 0, it lies
    along the tool's x axis (the normal vector); θ_x turns it about the tool's z axis, θ_z lifts it out of x and y.

    Raises `CooperationError` for lengths that are not positive and finite, and for a B beyond the object.
    """

    length_m: float
    grasp_distance_m: float | None = None
    theta_x_deg: float = 0.0
    theta_z_deg: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.length_m < math.inf:
            raise CooperationError(f"length_m = {self.length_m}; must be positive, in metres")
        if not 0.0 < self.distance_m <= self.length_m:
            raise CooperationError(
                f"grasp_distance_m = {self.distance_m}; must be above 0 and at most the object's length, "
                f"{self.length_m:g} m"
            )
        for name in ("theta_x_deg", "theta_z_deg"):
            if not math.isfinite(getattr(self, name)):
                raise CooperationError(f"{name} = {getattr(self, name)}; must be finite")

    @property
    def distance_m(self) -> float:
        """K: from A to B, m."""
        return self.length_m / 2 if self.grasp_distance_m is None else self.grasp_distance_m

    @property
    def offset_m(self) -> Vector:
        """B in the master's tool frame: the translation of (2)."""
        theta_x, theta_z = math.radians(self.theta_x_deg), math.radians(self.theta_z_deg)
        level = self.distance_m * math.cos(theta_z)
        return level * math.cos(theta_x), level * math.sin(theta_x), self.distance_m * math.sin(theta_z)

    def frame(self, master_tip: Floats) -> Floats:
        """o* = T_m·x, (..., 4, 4): the master's directions, at B."""
        frame = np.array(master_tip, dtype=np.float64)
        frame[..., :3, 3] += frame[..., :3, :3] @ np.array(self.offset_m)
        return frame


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmPair:
    """Two arms and the object between them. The slave's base is placed in the master's base: m, and degrees about the
    fixed axes x, y, z in this order.
    """

    master: FiveAxisArm
    slave: FiveAxisArm
    carried: CarriedObject
    slave_base_m: Vector
    slave_base_rpy_deg: Vector = (0.0, 0.0, 0.0)
    names: tuple[str, str] = field(default=("master", "slave"))

    def __post_init__(self) -> None:
        for name in ("slave_base_m", "slave_base_rpy_deg"):
            value = getattr(self, name)
            if len(value) != 3 or not all(map(math.isfinite, value)):
                raise CooperationError(f"{name} = {value}; must be three finite numbers")

    @property
    def base_transform(self) -> Floats:
        """w*: the slave's base in the master's base, 4 × 4. The paper calls it a rotation; it is a translation too."""
        return transform(self.slave_base_m, self.slave_base_rpy_deg)


def pair_of(master: Robot, slave: Robot, carried: CarriedObject) -> ArmPair:
    """The nominal arms of two robots of a cell, each where its `base_m` and `base_rpy_deg` put it in the world.

    Raises `CooperationError` where one of them is no five-axis arm.
    """
    bases = [transform(robot.base_m, robot.base_rpy_deg) for robot in (master, slave)]
    (between,) = seen_from(bases[0], bases[1][None])
    x, y, z = between[:3, 3].tolist()
    roll, pitch, yaw = to_rpy(between[:3, :3].tolist())
    return ArmPair(
        master=FiveAxisArm.of_robot(master),
        slave=FiveAxisArm.of_robot(slave),
        carried=carried,
        slave_base_m=(x, y, z),
        slave_base_rpy_deg=(math.degrees(roll), math.degrees(pitch), math.degrees(yaw)),
        names=(master.name, slave.name),
    )


def transform(place_m: Vector, rpy_deg: Vector) -> Floats:
    """A pose, 4 × 4, from its place and its angles about the fixed axes x, y, z in this order."""
    pose = np.eye(4)
    pose[:3, :3] = from_rpy_deg(rpy_deg)
    pose[:3, 3] = place_m
    return pose


def seen_from(base_transform: Floats, frame: Floats) -> Floats:
    """Frames (n, 4, 4) seen from bases (..., 4, 4): w*⁻¹·o*, (..., n, 4, 4)."""
    turn, place = base_transform[..., :3, :3], base_transform[..., :3, 3]
    back = np.swapaxes(turn, -1, -2)[..., None, :, :]
    seen = np.zeros((*base_transform.shape[:-2], *frame.shape))
    seen[..., :3, :3] = back @ frame[..., :3, :3]
    away = frame[..., :3, 3] - place[..., None, :]
    seen[..., :3, 3] = (back @ away[..., None])[..., 0]
    seen[..., 3, 3] = 1.0
    return seen
