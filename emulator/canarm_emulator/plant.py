"""The mechanical arm: every robot of a cell as one MuJoCo model, and its integration.

Built from the cell's Denavit-Hartenberg chains and the truth alone. Torque comes in, angles and speeds go out;
no electrics, no sensors, no commands.
"""

import itertools
import math
from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np

from canarm_protocol.cell import Cell, Joint, Robot

from .errors import EmulatorError
from .truth import JointTruth, Truth

WIRE_LOSS_TIME_S = 0.5e-3
"""Damping of the elastic wire over its stiffness. Assumed: 2 to 3 % of critical at the konkuk1's wire modes."""

_OPTION = {
    "integrator": "Euler",  # with an elastic wire half as far off as implicitfast; without, the same
    "solver": "Newton",
    "jacobian": "dense",
    "tolerance": "1e-12",
}
_DISABLED = ("contact", "sensor", "actuation", "autoreset", "island")
_FRICTION = {
    # MuJoCo raises the time constant to two steps (refsafe), which stops a sliding joint within one step; the
    # largest impedance that it takes, 0.9999, leaves the least creep at rest.
    "solreffriction": "1e-6 1",
    "solimpfriction": "0.9999 0.9999 0.001 0.5 2",
}
_STOP = {
    # A bumper of 4 ms, several steps long: stiff and critically damped.
    "solreflimit": "0.004 1",
    "solimplimit": "0.95 0.99 0.001 0.5 2",
}
Quaternion = tuple[float, float, float, float]
_ROTOR_MASS = "1e-3"  # MuJoCo wants one; the rotor turns about its centre of mass, so gravity does no work on it


# A diverging integration is an error of `World`; the engine's own way is a line in a log file wherever one stands.
mujoco.set_mju_user_warning(lambda text: None)


class Plant:
    """State and integration of all arms of a cell; angles in rad, speeds in rad/s, in the order of `Cell.joints`.

    A joint with an elastic wire has a motor coordinate of its own, scaled to the joint by the gear; the others share
    one.
    """

    __slots__ = (
        "_applied",
        "_data",
        "_model",
        "_option",
        "_position",
        "_velocity",
        "angle",
        "motor_dof",
        "speed",
    )

    def __init__(self, cell: Cell, truth: Truth) -> None:
        self._model = mujoco.MjModel.from_xml_string(model_xml(cell, truth))
        self._data = mujoco.MjData(self._model)
        self._option = self._model.opt
        self._position, self._velocity = self._data.qpos, self._data.qvel
        self._applied = self._data.qfrc_applied
        rotors = itertools.count(len(cell.joints))  # rotors follow the arms in the model
        self.motor_dof = tuple(
            next(rotors) if joint.has_elastic_wire else index for index, joint in enumerate(truth.joints)
        )
        """For each joint the index into `angle` and `speed` of its motor: its own index where the wire is rigid."""
        initial = [math.radians(joint.initial_deg) for joint in truth.joints]
        initial += [initial[index] for index, joint in enumerate(truth.joints) if joint.has_elastic_wire]
        self.set_state(initial, [0.0] * len(initial))

    def set_state(self, angle: Sequence[float], speed: Sequence[float]) -> None:
        """Put joints and motors, in the order of `angle`, at these angles and speeds."""
        self.angle, self.speed = list(angle), list(speed)
        self._velocity[:] = speed

    def step(self, torque_nm: Sequence[float], step_s: float) -> None:
        """Advance by `step_s` under constant motor torques, one a joint. `angle` and `speed` become new lists.

        MuJoCo's semi-implicit Euler (v += h·a(q), q += h·v) with half a drift before and half a drift less after is
        position Verlet: second order, no energy drift of an undamped wire, and one force evaluation a step. The
        lists of the state before the step stay as they were.
        """
        half_s = 0.5 * step_s
        position, applied, motor_dof, speed = self._position, self._applied, self.motor_dof, self.speed
        for dof, angle in enumerate(self.angle):
            position[dof] = angle + half_s * speed[dof]
        for joint, torque in enumerate(torque_nm):
            applied[motor_dof[joint]] = torque
        self._option.timestep = step_s
        mujoco.mj_step(self._model, self._data)
        self.speed = speed = self._velocity.tolist()
        self.angle = [ahead - half_s * speed[dof] for dof, ahead in enumerate(position.tolist())]


def model_xml(cell: Cell, truth: Truth) -> str:
    """MJCF of all arms of `cell`: hinges named as the joints, in the order of `Cell.joints`; then the wires' rotors.

    The world frame is the first robot's base frame; the others' bases are turned so that their gravity agrees with it.
    Arms do not touch each other. Raises `EmulatorError` if the robots disagree on the strength of gravity.
    """
    root = ElementTree.Element("mujoco", model=cell.name)
    # konkuk1's rods have no inertia about their own axis; MuJoCo wants a positive one.
    _add(root, "compiler", angle="radian", autolimits="true", boundinertia="1e-12")
    gravity = cell.robot[0].gravity_m_s2
    option = _add(root, "option", gravity=_text(*gravity), **_OPTION)
    _add(option, "flag", **dict.fromkeys(_DISABLED, "disable"))
    world = _add(root, "worldbody")
    first = 0
    for robot in cell.robot:
        base = _add(world, "body", name=robot.name, quat=_text(*_base_quaternion(robot, gravity)))
        _add_chain(base, robot, truth.joints[first : first + len(robot.joint)])
        first += len(robot.joint)
    tendons = _add(root, "tendon")
    for joint, true in zip(cell.joints, truth.joints, strict=True):
        if true.has_elastic_wire:
            _add_wire(world, tendons, joint, true)
    return ElementTree.tostring(root, encoding="unicode")


def _add_chain(base: ElementTree.Element, robot: Robot, truth: Sequence[JointTruth]) -> None:
    parent, position, quaternion = base, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    for joint, true in zip(robot.joint, truth, strict=True):
        link = joint.link
        turned = _product(quaternion, _about_z(math.radians(link.theta_offset_deg)))
        body = _add(parent, "body", pos=_text(*position), quat=_text(*turned))
        lower, upper = map(math.radians, joint.limits_deg)
        drive = {} if true.has_elastic_wire else _drive_attributes(joint, true)
        _add(body, "joint", name=joint.name, axis="0 0 1", range=_text(lower, upper), **_STOP, **drive)
        # The link's own frame lies at its far end: A = Rz(θ)·Tz(d)·Tx(a)·Rx(α), and Rz(θ) is the hinge.
        position, quaternion = (link.a_m, 0.0, link.d_m), _about_x(math.radians(link.alpha_deg))
        centre = (p + c for p, c in zip(position, _rotated(quaternion, link.centre_of_mass_m), strict=True))
        inertia = (moment * true.mass_kg / link.mass_kg for moment in link.inertia_kg_m2)
        _add(
            body,
            "inertial",
            pos=_text(*centre),
            quat=_text(*quaternion),
            mass=_text(true.mass_kg),
            diaginertia=_text(*inertia),
        )
        parent = body


def _add_wire(world: ElementTree.Element, tendons: ElementTree.Element, joint: Joint, truth: JointTruth) -> None:
    rotor = f"{joint.name}.rotor"
    body = _add(world, "body", name=rotor)
    _add(body, "joint", name=rotor, axis="0 0 1", **_drive_attributes(joint, truth))
    _add(body, "inertial", pos="0 0 0", mass=_ROTOR_MASS, diaginertia="1e-12 1e-12 1e-12")
    stiffness = truth.wire_stiffness_nm_rad
    damping = stiffness * WIRE_LOSS_TIME_S
    wire = _add(tendons, "fixed", stiffness=_text(stiffness), damping=_text(damping), springlength="0")
    _add(wire, "joint", joint=rotor, coef="1")
    _add(wire, "joint", joint=joint.name, coef="-1")


def _drive_attributes(joint: Joint, truth: JointTruth) -> dict[str, str]:
    """Reflected rotor inertia and friction; both sit on the motor's side of the wire."""
    return {
        "armature": _text(truth.rotor_inertia_kg_m2 * joint.motor.gear_ratio**2),
        "damping": _text(truth.viscous_friction_nm_s),
        "frictionloss": _text(truth.coulomb_friction_nm),
        **_FRICTION,
    }


def _base_quaternion(robot: Robot, world_gravity: Sequence[float]) -> Quaternion:
    """Shortest rotation that takes the robot's gravity, given in its base frame, to the world's."""
    own, world = np.array(robot.gravity_m_s2), np.array(world_gravity)
    strength, own_strength = float(np.linalg.norm(world)), float(np.linalg.norm(own))
    if not math.isclose(own_strength, strength, rel_tol=1e-9):
        raise EmulatorError(
            f"robot {robot.name!r}: gravity_m_s2 of strength {own_strength:g} must be as strong as the first robot's, "
            f"{strength:g}: all robots of a cell share one world"
        )
    if strength == 0.0 or np.array_equal(own, world):
        return (1.0, 0.0, 0.0, 0.0)
    own, world = own / own_strength, world / strength
    cosine = float(own @ world)
    if cosine < -1 + 1e-12:
        x, y, z = np.cross(own, np.eye(3)[np.argmin(np.abs(own))])
        return _unit(0.0, float(x), float(y), float(z))
    x, y, z = np.cross(own, world)
    return _unit(1.0 + cosine, float(x), float(y), float(z))


def _unit(*parts: float) -> Quaternion:
    length = math.hypot(*parts)
    w, x, y, z = (part / length for part in parts)
    return w, x, y, z


def _about_x(angle_rad: float) -> Quaternion:
    return math.cos(angle_rad / 2), math.sin(angle_rad / 2), 0.0, 0.0


def _about_z(angle_rad: float) -> Quaternion:
    return math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    result = np.zeros(4)
    mujoco.mju_mulQuat(result, np.array(p), np.array(q))
    w, x, y, z = result.tolist()
    return w, x, y, z


def _rotated(quaternion: Quaternion, vector: Sequence[float]) -> list[float]:
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, np.array(vector), np.array(quaternion))
    return list(map(float, result))


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _text(*numbers: float) -> str:
    return " ".join(map(repr, numbers))
