"""Arms to write cells for: from a URDF file, or made up for a number of joints. No drives, no cards."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from canarm_protocol.cell.urdf import read_urdf

from .request import Arm, ArmJoint

Vector = tuple[float, float, float]
ALONG_X, UP = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
PITCH, YAW, ROLL = (0.0, -1.0, 0.0), UP, ALONG_X
"""Axes of a joint that lifts, one that turns the arm about its base, and one that rolls the links beyond it."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One link of a made-up arm: a solid cylinder from its joint to the next one."""

    name: str
    axis: Vector
    along: Vector
    length_m: float
    radius_m: float
    mass_kg: float
    limit_deg: float


COLUMN = Segment("waist", YAW, UP, 0.12, 0.05, 1.5, 150.0)
UPPER_ARM = Segment("shoulder", PITCH, ALONG_X, 0.25, 0.03, 1.0, 110.0)
SHORT_UPPER_ARM = Segment("shoulder", PITCH, ALONG_X, 0.12, 0.035, 0.5, 110.0)
UPPER_ARM_ROLL = Segment("arm_roll", ROLL, ALONG_X, 0.13, 0.03, 0.5, 150.0)
FOREARM = Segment("elbow", PITCH, ALONG_X, 0.2, 0.025, 0.6, 130.0)
FOREARM_ROLL = Segment("forearm_roll", ROLL, ALONG_X, 0.06, 0.025, 0.2, 150.0)
HAND = Segment("wrist", PITCH, ALONG_X, 0.06, 0.02, 0.15, 110.0)
TOOL = Segment("tool_roll", ROLL, ALONG_X, 0.04, 0.02, 0.1, 150.0)
SEGMENTS: dict[int, tuple[Segment, ...]] = {
    1: (UPPER_ARM,),
    2: (UPPER_ARM, FOREARM),
    3: (COLUMN, UPPER_ARM, FOREARM),
    4: (COLUMN, UPPER_ARM, FOREARM, HAND),
    5: (COLUMN, UPPER_ARM, FOREARM, HAND, TOOL),
    6: (COLUMN, UPPER_ARM, FOREARM, FOREARM_ROLL, HAND, TOOL),
    7: (COLUMN, SHORT_UPPER_ARM, UPPER_ARM_ROLL, FOREARM, FOREARM_ROLL, HAND, TOOL),
}
"""Base to tip, by the number of joints: the usual arm of each."""
PITCH_HOME_DEG = 20.0
"""Lifting joints are slightly bent at home: a stretched arm is singular."""


def made_up_arm(joint_count: int) -> Arm:
    """A made-up arm of 1 to 7 joints for a laboratory bench."""
    origin: Vector = (0.0, 0.0, 0.0)
    joints = []
    for segment in SEGMENTS[joint_count]:
        x, y, z = segment.along
        half = segment.length_m / 2.0
        joints.append(
            ArmJoint(
                name=segment.name,
                limits_deg=(-segment.limit_deg, segment.limit_deg),
                home_deg=PITCH_HOME_DEG if segment.axis == PITCH else 0.0,
                body={
                    "origin_m": origin,
                    "axis": segment.axis,
                    "mass_kg": segment.mass_kg,
                    "centre_of_mass_m": (x * half, y * half, z * half),
                    "inertia_kg_m2": cylinder(segment),
                },
                comment=f"a cylinder of {1000 * segment.length_m:g} mm, radius {1000 * segment.radius_m:g} mm",
            )
        )
        origin = (x * segment.length_m, y * segment.length_m, z * segment.length_m)
    plural = "joint" if joint_count == 1 else "joints"
    return Arm(f"arm{joint_count}", f"An arm of {joint_count} {plural}", joints)


def cylinder(segment: Segment) -> tuple[float, float, float, float, float, float]:
    """[ixx, iyy, izz, ixy, ixz, iyz] about the centre: m r²/2 along the axis, m (3 r² + l²)/12 across."""
    square = segment.radius_m**2
    along = segment.mass_kg * square / 2.0
    across = segment.mass_kg * (3.0 * square + segment.length_m**2) / 12.0
    xx, yy, zz = (along if part else across for part in segment.along)
    return (xx, yy, zz, 0.0, 0.0, 0.0)


def arm_of_urdf(path: Path, named: str) -> Arm:
    """The arm in the file `path`, which the cell refers to as `named`. Raises `CellError`."""
    joints = [
        ArmJoint(
            name=joint.name,
            limits_deg=joint.limits_deg,
            home_deg=_home_deg(joint.limits_deg),
            body=None,
            comment=f"{joint.urdf_name} of the file",
            states_limits=joint.is_continuous,
            speed_rad_s=joint.velocity_rad_s or None,
            effort_nm=joint.effort_nm or None,
            viscous_nm_s=joint.damping_nm_s or None,
            coulomb_nm=joint.friction_nm or None,
        )
        for joint in read_urdf(path)
    ]
    name = "".join(letter for letter in path.stem.lower().replace(" ", "_") if letter.isalnum() or letter in "_-")
    name = name.encode("ascii", "ignore").decode().lstrip("0123456789_-")[:32] or "arm"
    return Arm(name, f"The arm of {path.name}", joints, named)


def _home_deg(limits_deg: Sequence[float]) -> float:
    """0 if it is at least a tenth of the travel from both limits, else the middle."""
    low, high = limits_deg
    margin = 0.1 * (high - low)
    return 0.0 if low + margin <= 0.0 <= high - margin else float(math.floor((low + high) / 2.0 + 0.5))
