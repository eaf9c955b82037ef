"""The arms of a cell as MJCF, the text that MuJoCo compiles: bodies, hinges, stops, friction, drive wires.

Made from cell and truth only. State and integration are in `plant.py`.
"""

import math
from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell, Joint, Robot

from .carried import add_object, add_pin, hand, text_of
from .poses import Point, Pose, from_rpy_deg, rotated
from .segments import segments_of
from .truth import JointTruth, Truth

WIRE_LOSS_TIME_S = 0.5e-3
"""Damping of the elastic wire over its stiffness. Assumed: 2 to 3 % of critical at the konkuk1's wire modes."""
BEARING_SHARE = 0.1
"""Share of a joint's friction in the link's own bearing, which is what a link on a broken wire is left with. Assumed;
with a whole wire all friction is on the motor's side.
"""

_OPTION = {
    "integrator": "Euler",  # half the error of implicitfast with an elastic wire, the same without
    "solver": "Newton",
    "jacobian": "dense",
    "tolerance": "1e-12",
}
_DISABLED = ("contact", "sensor", "actuation", "autoreset", "island")
_FRICTION = {
    # MuJoCo raises the time constant to two steps (refsafe), which stops a sliding joint within one step; 0.9999 is the
    # largest impedance that it accepts, and leaves the least creep at rest.
    "solreffriction": "1e-6 1",
    "solimpfriction": "0.9999 0.9999 0.001 0.5 2",
}
_STOP = {
    # A bumper of 4 ms, several steps long: stiff and critically damped.
    "solreflimit": "0.004 1",
    "solimplimit": "0.95 0.99 0.001 0.5 2",
}
_JAM_FRICTION_NM = 1e6  # beyond any torque of a motor, a stretched wire or a moving link
_POINT_INERTIA = "1e-12 1e-12 1e-12"
_SAME_GRAVITY_M_S2 = 1e-9  # rounding of a turned base
_ROTOR_MASS = "1e-3"  # MuJoCo wants one; the rotor turns about its centre of mass, so gravity does no work on it


def has_tendon(truth: JointTruth) -> bool:
    """Whether an elastic wire connects motor and joint."""
    return truth.has_elastic_wire and not truth.wire_is_broken


def model_xml(cell: Cell, truth: Truth) -> str:
    """MJCF of all arms of `cell`: hinges named as the joints, in the order of `Cell.joints`; then the wires' rotors.

    Each robot is a body of the world with its name, at its base's pose. Arms do not touch each other, nor themselves.
    """
    root = ElementTree.Element("mujoco", model=cell.name)
    # konkuk1's rods have no inertia about their own axis; MuJoCo wants a positive one.
    _add(root, "compiler", angle="radian", autolimits="true", boundinertia="1e-12")
    option = _add(root, "option", gravity=text_of(*world_gravity(cell)), **_OPTION)
    _add(option, "flag", **dict.fromkeys(_DISABLED, "disable"))
    world = _add(root, "worldbody")
    names = cell.joint_names
    carriers = () if cell.object is None else (cell.object.master, cell.object.slave)
    for robot, own in zip(cell.robot, cell.blocks, strict=True):
        pose = Pose(_base_m(cell, robot, truth), from_rpy_deg(robot.base_rpy_deg))
        base = _add(world, "body", name=robot.name, pos=text_of(*pose.position_m), quat=text_of(*pose.quaternion))
        tip = _add_chain(base, robot, names[own], truth.joints[own])
        if robot.name in carriers:
            tip.set("name", hand(robot.name))
            if cell.object is not None and truth.object is not None and robot.name == cell.object.master:
                add_object(tip, cell, truth.object)
    if cell.object is not None:
        add_pin(root, cell.object)
    tendons = _add(root, "tendon")
    for name, joint, true in zip(names, cell.joints, truth.joints, strict=True):
        if true.has_elastic_wire:
            _add_wire(world, tendons, name, joint, true)
    return ElementTree.tostring(root, encoding="unicode")


def _base_m(cell: Cell, robot: Robot, truth: Truth) -> Point:
    if cell.object is None or truth.object is None or robot.name != cell.object.slave:
        return robot.base_m
    x, y, z = robot.base_m
    return x + truth.object.base_x_m, y + truth.object.base_y_m, z + truth.object.base_z_m


def _add_chain(
    base: ElementTree.Element, robot: Robot, names: Sequence[str], truth: Sequence[JointTruth]
) -> ElementTree.Element:
    """Add a robot's bodies. Returns the last one."""
    parent, end = base, Pose()
    for name, joint, true, segment in zip(names, robot.joint, truth, segments_of(robot.joint), strict=True):
        pose = end.then(segment.origin)
        body = _add(parent, "body", pos=text_of(*pose.position_m), quat=text_of(*pose.quaternion))
        lower, upper = map(math.radians, joint.limits_deg)
        drive = _bearing_attributes(true) if true.has_elastic_wire else _drive_attributes(joint, true)
        axis = text_of(*segment.axis)
        _add(body, "joint", name=name, axis=axis, range=text_of(lower, upper), **_STOP, **drive)
        inertia = (moment * true.mass_kg / segment.mass_kg for moment in segment.moments_kg_m2)
        _add(
            body,
            "inertial",
            pos=text_of(*segment.inertial.position_m),
            quat=text_of(*segment.inertial.quaternion),
            mass=text_of(true.mass_kg),
            diaginertia=text_of(*inertia),
        )
        if true.payload_kg > 0.0:
            payload = _add(body, "body", pos=text_of(*segment.tip_m))
            _add(payload, "inertial", pos="0 0 0", mass=text_of(true.payload_kg), diaginertia=_POINT_INERTIA)
        parent, end = body, segment.end
    return parent


def _add_wire(
    world: ElementTree.Element, tendons: ElementTree.Element, name: str, joint: Joint, truth: JointTruth
) -> None:
    rotor = f"{name}.rotor"
    body = _add(world, "body", name=rotor)
    _add(body, "joint", name=rotor, axis="0 0 1", **_drive_attributes(joint, truth))
    _add(body, "inertial", pos="0 0 0", mass=_ROTOR_MASS, diaginertia=_POINT_INERTIA)
    if not has_tendon(truth):
        return
    stiffness = truth.wire_stiffness_nm_rad
    damping = stiffness * WIRE_LOSS_TIME_S
    dead_band = text_of(-truth.wire_dead_band_rad, truth.wire_dead_band_rad)
    wire = _add(tendons, "fixed", stiffness=text_of(stiffness), damping=text_of(damping), springlength=dead_band)
    _add(wire, "joint", joint=rotor, coef="1")
    _add(wire, "joint", joint=name, coef="-1")


def _drive_attributes(joint: Joint, truth: JointTruth) -> dict[str, str]:
    """Reflected rotor inertia and friction; both sit on the motor's side of the wire. A rigid one brings in a jam."""
    share = 1.0 - BEARING_SHARE if truth.wire_is_broken else 1.0
    friction_nm = truth.coulomb_friction_nm * share
    if truth.is_jammed and not truth.has_elastic_wire:
        friction_nm += _JAM_FRICTION_NM
    return {
        "armature": text_of(truth.rotor_inertia_kg_m2 * joint.motor.gear_ratio**2),
        "damping": text_of(truth.viscous_friction_nm_s * share),
        "frictionloss": text_of(friction_nm),
        **_FRICTION,
    }


def _bearing_attributes(truth: JointTruth) -> dict[str, str]:
    """Friction on the link's side of an elastic wire: none, unless the wire is broken or the joint jammed."""
    if not (truth.wire_is_broken or truth.is_jammed):
        return {}
    share = BEARING_SHARE if truth.wire_is_broken else 0.0
    friction_nm = truth.coulomb_friction_nm * share + (_JAM_FRICTION_NM if truth.is_jammed else 0.0)
    return {
        "damping": text_of(truth.viscous_friction_nm_s * share),
        "frictionloss": text_of(friction_nm),
        **_FRICTION,
    }


def world_gravity(cell: Cell) -> Point:
    """Gravity of the world, m/s²: that of the first robot, along the world's axes."""
    return _gravity_in_world(cell.robot[0])


def own_gravity(cell: Cell, model: mujoco.MjModel) -> NDArray[np.float64] | None:
    """Forces for `MjData.xfrc_applied`, shape (bodies, 6), that give each robot its own gravity; None if not needed.

    The cell sets a robot's gravity: it may hang on a wall or a ceiling, or be balanced by springs.
    """
    world = np.array(world_gravity(cell))
    forces = np.zeros((model.nbody, 6))
    for robot in cell.robot:
        difference = np.array(_gravity_in_world(robot)) - world
        if np.abs(difference).max() > _SAME_GRAVITY_M_S2:
            root = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, robot.name)
            bodies = model.body_rootid == root
            forces[bodies, :3] = model.body_mass[bodies, np.newaxis] * difference
    return forces if forces.any() else None


def _gravity_in_world(robot: Robot) -> Point:
    if not any(robot.base_rpy_deg):
        return robot.gravity_m_s2
    x, y, z = rotated(from_rpy_deg(robot.base_rpy_deg), robot.gravity_m_s2)
    return x, y, z


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)
