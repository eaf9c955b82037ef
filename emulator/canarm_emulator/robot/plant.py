"""The mechanical arm: every robot of a cell as one MuJoCo model, and its integration.

Built from the cell's Denavit-Hartenberg chains and the truth alone. Torque comes in, angles and speeds go out;
no electrics, no sensors, no commands.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Self
from xml.etree import ElementTree

import mujoco
import numpy as np

from canarm_protocol.cell.model import Cell, Joint, Robot

from ..errors import EmulatorError
from .truth import JointTruth, Truth

WIRE_LOSS_TIME_S = 0.5e-3
"""Damping of the elastic wire over its stiffness. Assumed: 2 to 3 % of critical at the konkuk1's wire modes."""
BEARING_SHARE = 0.1
"""Share of a joint's friction that is in the link's own bearing, which is all that a link on a broken wire has left.
Assumed; with a whole wire all friction is on the motor's side.
"""

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
_JAM_FRICTION_NM = 1e6  # beyond any torque of a motor, a stretched wire or a moving link
Quaternion = tuple[float, float, float, float]
_POINT_INERTIA = "1e-12 1e-12 1e-12"
_ROTOR_MASS = "1e-3"  # MuJoCo wants one; the rotor turns about its centre of mass, so gravity does no work on it
_mechanics = attrgetter(
    "mass_kg",
    "payload_kg",
    "viscous_friction_nm_s",
    "coulomb_friction_nm",
    "is_jammed",
    "rotor_inertia_kg_m2",
    "has_elastic_wire",
    "wire_stiffness_nm_rad",
    "wire_dead_band_rad",
    "wire_is_broken",
)


# A diverging integration is an error of `World`; the engine's own way is a line in a log file wherever one stands.
mujoco.set_mju_user_warning(lambda text: None)


@dataclass(frozen=True, slots=True)
class _SlackWire:
    """A wire with a dead band: its tendon in the model, the two coordinates it connects, and its damping when taut."""

    tendon: int
    motor: int
    joint: int
    dead_band_rad: float
    damping_nm_s: float


class Plant:
    """State and integration of all arms of a cell; angles in rad, speeds in rad/s, in the order of `Cell.joints`.

    A joint with an elastic wire has a motor coordinate of its own, scaled to the joint by the gear; the others share
    one.
    """

    __slots__ = (
        "_applied",
        "_cell",
        "_data",
        "_model",
        "_option",
        "_position",
        "_slack_wires",
        "_step_s",
        "_tendon_damping",
        "_truth",
        "_velocity",
        "angle",
        "motor_dof",
        "speed",
    )

    def __init__(self, cell: Cell, truth: Truth) -> None:
        self._cell, self._truth = cell, truth
        self._model = mujoco.MjModel.from_xml_string(model_xml(cell, truth))
        self._data = mujoco.MjData(self._model)
        self._option = self._model.opt
        self._step_s = self._option.timestep
        self._position, self._velocity = self._data.qpos, self._data.qvel
        self._applied = self._data.qfrc_applied
        rotors = itertools.count(len(cell.joints))  # rotors follow the arms in the model
        self.motor_dof = tuple(
            next(rotors) if joint.has_elastic_wire else index for index, joint in enumerate(truth.joints)
        )
        """For each joint the index into `angle` and `speed` of its motor: its own index where the wire is rigid."""
        self._tendon_damping = self._model.tendon_damping
        tendons = itertools.count()
        self._slack_wires = tuple(
            _SlackWire(tendon, motor, index, joint.wire_dead_band_rad, float(self._tendon_damping[tendon]))
            for index, (motor, joint) in enumerate(zip(self.motor_dof, truth.joints, strict=True))
            if _has_tendon(joint)
            for tendon in (next(tendons),)
            if joint.wire_dead_band_rad > 0.0
        )
        initial = [math.radians(joint.initial_deg) for joint in truth.joints]
        initial += [initial[index] for index, joint in enumerate(truth.joints) if joint.has_elastic_wire]
        self.set_state(initial, [0.0] * len(initial))

    def set_state(self, angle: Sequence[float], speed: Sequence[float]) -> None:
        """Put joints and motors, in the order of `angle`, at these angles and speeds."""
        self.angle, self.speed = list(angle), list(speed)
        self._velocity[:] = speed

    def changed(self, truth: Truth) -> Self:
        """The same arms with another truth, in motion as they are now. Itself if nothing mechanical is different.

        Joints keep their angles and speeds, except where a wire turns rigid: there motor and joint go on with the
        common speed that conserves the momentum of motor and arm. A wire that turns elastic starts without tension,
        and no wire gains tension by the change: a broken one that is tied again, or one whose slack or softness
        ends, is tied as short as that takes, at the motor's end.
        """
        if list(map(_mechanics, truth.joints)) == list(map(_mechanics, self._truth.joints)):
            return self
        plant = type(self)(self._cell, truth)
        plant._take_over(self)
        return plant

    def strike(self, impulse_nm_s: Sequence[float]) -> None:
        """Let impulses act on the joints' links, one a joint: the speeds jump by M⁻¹ times the impulse."""
        self._position[:] = self.angle
        mujoco.mj_fwdPosition(self._model, self._data)
        impulse, jump = np.zeros((1, len(self.speed))), np.zeros((1, len(self.speed)))
        impulse[0, : len(impulse_nm_s)] = impulse_nm_s
        mujoco.mj_solveM(self._model, self._data, jump, impulse)
        self.set_state(self.angle, (np.array(self.speed) + jump[0]).tolist())

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
        for wire in self._slack_wires:
            is_taut = abs(position[wire.motor] - position[wire.joint]) > wire.dead_band_rad
            self._tendon_damping[wire.tendon] = wire.damping_nm_s if is_taut else 0.0
        if step_s != self._step_s:
            self._option.timestep = self._step_s = step_s
        mujoco.mj_step(self._model, self._data)
        self.speed = speed = self._velocity.tolist()
        self.angle = [ahead - half_s * speed[dof] for dof, ahead in enumerate(position.tolist())]

    def _take_over(self, before: "Plant") -> None:
        count = len(self.motor_dof)
        angle, speed, sources = before.angle[:count], before.speed[:count], list(range(count))
        impulse_nm_s = [0.0] * count
        for joint, (old, new) in enumerate(zip(before.motor_dof, self.motor_dof, strict=True)):
            if new != joint:
                twist = _kept_twist(
                    before.angle[old] - before.angle[joint], before._truth.joints[joint], self._truth.joints[joint]
                )
                angle.append(before.angle[old] if twist is None else before.angle[joint] + twist)
                speed.append(before.speed[old])
                sources.append(old)
            elif old != joint:
                # The rotor, part of the joint's inertia from now on, brings in what it has more of momentum.
                gear_ratio = self._cell.joints[joint].motor.gear_ratio
                inertia_kg_m2 = self._truth.joints[joint].rotor_inertia_kg_m2 * gear_ratio**2
                impulse_nm_s[joint] = inertia_kg_m2 * (before.speed[old] - before.speed[joint])
        self.set_state(angle, speed)
        # The solver starts from the last accelerations, and where it starts decides the last bits.
        self._data.qacc_warmstart[:] = before._data.qacc_warmstart[sources]
        if any(impulse_nm_s):
            self.strike(impulse_nm_s)


def _has_tendon(truth: JointTruth) -> bool:
    return truth.has_elastic_wire and not truth.wire_is_broken


def _kept_twist(twist_rad: float, old: JointTruth, new: JointTruth) -> float | None:
    """The twist, motor minus joint, with which an elastic wire goes on that has changed; None if it stays as it is."""
    old_wire = old.wire_is_broken, old.wire_dead_band_rad, old.wire_stiffness_nm_rad
    if new.wire_is_broken or old_wire == (False, new.wire_dead_band_rad, new.wire_stiffness_nm_rad):
        return None
    stretch_rad = 0.0 if old.wire_is_broken else max(abs(twist_rad) - old.wire_dead_band_rad, 0.0)
    limit_rad = new.wire_dead_band_rad + stretch_rad * min(old.wire_stiffness_nm_rad / new.wire_stiffness_nm_rad, 1.0)
    return None if abs(twist_rad) <= limit_rad else math.copysign(limit_rad, twist_rad)


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
    first, names = 0, cell.joint_names
    for robot in cell.robot:
        base = _add(world, "body", name=robot.name, quat=_text(*_base_quaternion(robot, gravity)))
        last = first + len(robot.joint)
        _add_chain(base, robot, names[first:last], truth.joints[first:last])
        first = last
    tendons = _add(root, "tendon")
    for name, joint, true in zip(names, cell.joints, truth.joints, strict=True):
        if true.has_elastic_wire:
            _add_wire(world, tendons, name, joint, true)
    return ElementTree.tostring(root, encoding="unicode")


def _add_chain(base: ElementTree.Element, robot: Robot, names: Sequence[str], truth: Sequence[JointTruth]) -> None:
    parent, position, quaternion = base, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    for name, joint, true in zip(names, robot.joint, truth, strict=True):
        link = joint.dh_link
        turned = _product(quaternion, _about_z(math.radians(link.theta_offset_deg)))
        body = _add(parent, "body", pos=_text(*position), quat=_text(*turned))
        lower, upper = map(math.radians, joint.limits_deg)
        drive = _bearing_attributes(true) if true.has_elastic_wire else _drive_attributes(joint, true)
        _add(body, "joint", name=name, axis="0 0 1", range=_text(lower, upper), **_STOP, **drive)
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
        if true.payload_kg > 0.0:
            payload = _add(body, "body", pos=_text(*position))
            _add(payload, "inertial", pos="0 0 0", mass=_text(true.payload_kg), diaginertia=_POINT_INERTIA)
        parent = body


def _add_wire(
    world: ElementTree.Element, tendons: ElementTree.Element, name: str, joint: Joint, truth: JointTruth
) -> None:
    rotor = f"{name}.rotor"
    body = _add(world, "body", name=rotor)
    _add(body, "joint", name=rotor, axis="0 0 1", **_drive_attributes(joint, truth))
    _add(body, "inertial", pos="0 0 0", mass=_ROTOR_MASS, diaginertia=_POINT_INERTIA)
    if not _has_tendon(truth):
        return
    stiffness = truth.wire_stiffness_nm_rad
    damping = stiffness * WIRE_LOSS_TIME_S
    dead_band = _text(-truth.wire_dead_band_rad, truth.wire_dead_band_rad)
    wire = _add(tendons, "fixed", stiffness=_text(stiffness), damping=_text(damping), springlength=dead_band)
    _add(wire, "joint", joint=rotor, coef="1")
    _add(wire, "joint", joint=name, coef="-1")


def _drive_attributes(joint: Joint, truth: JointTruth) -> dict[str, str]:
    """Reflected rotor inertia and friction; both sit on the motor's side of the wire. A rigid one brings in a jam."""
    share = 1.0 - BEARING_SHARE if truth.wire_is_broken else 1.0
    friction_nm = truth.coulomb_friction_nm * share
    if truth.is_jammed and not truth.has_elastic_wire:
        friction_nm += _JAM_FRICTION_NM
    return {
        "armature": _text(truth.rotor_inertia_kg_m2 * joint.motor.gear_ratio**2),
        "damping": _text(truth.viscous_friction_nm_s * share),
        "frictionloss": _text(friction_nm),
        **_FRICTION,
    }


def _bearing_attributes(truth: JointTruth) -> dict[str, str]:
    """Friction on the link's side of an elastic wire: none, unless the wire is broken or the joint jammed."""
    if not (truth.wire_is_broken or truth.is_jammed):
        return {}
    share = BEARING_SHARE if truth.wire_is_broken else 0.0
    friction_nm = truth.coulomb_friction_nm * share + (_JAM_FRICTION_NM if truth.is_jammed else 0.0)
    return {
        "damping": _text(truth.viscous_friction_nm_s * share),
        "frictionloss": _text(friction_nm),
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
