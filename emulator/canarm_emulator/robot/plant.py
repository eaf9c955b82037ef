"""The mechanical arms: every robot of a cell in one MuJoCo model, and its integration.

`model_xml.py` writes the model. Torques go in, angles and speeds come out; drives, sensors and commands never enter.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Self

import mujoco
import numpy as np

from canarm_protocol.cell.model import Cell

from .carried import Grips, ObjectState, elements
from .model_xml import WIRE_LOSS_TIME_S, has_tendon, model_xml, own_gravity
from .stiffness import fastest_wire_rad_s, inverse_inertia
from .truth import JointTruth, Truth

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


# `World` reports a diverging integration; the engine would write a log file into the working directory.
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

    A joint with an elastic wire has a second coordinate for its motor, scaled to the joint by the gear; otherwise joint
    and motor share one.
    """

    __slots__ = (
        "_applied",
        "_brake_nm",
        "_cell",
        "_data",
        "_friction_nm",
        "_model",
        "_option",
        "_position",
        "_positions",
        "_set_position",
        "_slack_wires",
        "_step_s",
        "_tendon_damping",
        "_truth",
        "_velocities",
        "_velocity",
        "angle",
        "compliance",
        "fastest_rad_s",
        "grips",
        "motor_dof",
        "speed",
    )

    def __init__(self, cell: Cell, truth: Truth) -> None:
        self._cell, self._truth = cell, truth
        self._model = mujoco.MjModel.from_xml_string(model_xml(cell, truth))
        self._data = mujoco.MjData(self._model)
        self._option = self._model.opt
        self._step_s = self._option.timestep
        # Setting elements of a memoryview takes a third of the time of an array's.
        self._position = self._data.qpos
        self._set_position, self._velocity = elements(self._data.qpos), elements(self._data.qvel)
        self._positions: Callable[[], Any] = self._set_position.tolist
        self._velocities: Callable[[], Any] = self._velocity.tolist
        self._applied = elements(self._data.qfrc_applied)
        forces = own_gravity(cell, self._model)
        if forces is not None:
            self._data.xfrc_applied[:] = forces
        rotors = itertools.count(len(cell.joints))  # rotors follow the arms in the model
        self.motor_dof = tuple(
            next(rotors) if joint.has_elastic_wire else index for index, joint in enumerate(truth.joints)
        )
        """For each joint the index of its motor in `angle` and `speed`: the joint's own index if the wire is rigid."""
        self._tendon_damping = self._model.tendon_damping
        tendons = itertools.count()
        self._slack_wires = tuple(
            _SlackWire(tendon, motor, index, joint.wire_dead_band_rad, float(self._tendon_damping[tendon]))
            for index, (motor, joint) in enumerate(zip(self.motor_dof, truth.joints, strict=True))
            if has_tendon(joint)
            for tendon in (next(tendons),)
            if joint.wire_dead_band_rad > 0.0
        )
        initial = [math.radians(joint.initial_deg) for joint in truth.joints]
        initial += [initial[index] for index, joint in enumerate(truth.joints) if joint.has_elastic_wire]
        self.set_state(initial, [0.0] * len(initial))
        self.grips: Grips | None = None
        if truth.object is not None:
            self.grips = Grips(cell, truth.object, self._model, self._data)
            self._data.qpos[:] = initial
            self.grips.begin(cell)
        inverse = inverse_inertia(self._model, initial)
        wires = [
            (motor, index, joint.wire_stiffness_nm_rad)
            for index, (motor, joint) in enumerate(zip(self.motor_dof, truth.joints, strict=True))
            if has_tendon(joint)
        ]
        rings = fastest_wire_rad_s(inverse, wires)
        self.fastest_rad_s = max(rings, rings**2 * WIRE_LOSS_TIME_S)
        """The highest natural frequency of arms and wires where the arms are parked, or the rate of its damping."""
        self.compliance = [float(inverse[motor, motor]) for motor in self.motor_dof]
        """Acceleration of each motor per torque in that pose, rad/s² per N·m."""
        self._friction_nm: list[float] = self._model.dof_frictionloss.tolist()
        """Without brakes."""
        self._brake_nm = [0.0] * len(self.motor_dof)

    def set_state(self, angle: Sequence[float], speed: Sequence[float]) -> None:
        """Put joints and motors, in the order of `angle`, at these angles and speeds."""
        self.angle, self.speed = list(angle), list(speed)
        self._data.qvel[:] = speed

    def changed(self, truth: Truth) -> Self:
        """The same arms with another truth, in their present motion; the same object if no mechanics have changed.

        Joints keep their angles and speeds, except if a wire becomes rigid: motor and joint then continue with the
        common speed that conserves the momentum of motor and arm. A wire that becomes elastic starts without tension,
        and no wire gains tension by the change: when a broken wire is tied again, or slack or softness ends, the
        motor's end is tied accordingly.
        """
        if truth.object == self._truth.object and (
            list(map(_mechanics, truth.joints)) == list(map(_mechanics, self._truth.joints))
        ):
            return self
        plant = type(self)(self._cell, truth)
        plant._take_over(self)
        return plant

    def strike(self, impulse_nm_s: Sequence[float]) -> None:
        """Apply impulses to the links, one per joint: the speeds jump by M⁻¹ times the impulses."""
        self._position[:] = self.angle
        mujoco.mj_fwdPosition(self._model, self._data)
        impulse, jump = np.zeros((1, len(self.speed))), np.zeros((1, len(self.speed)))
        impulse[0, : len(impulse_nm_s)] = impulse_nm_s
        mujoco.mj_solveM(self._model, self._data, jump, impulse)
        self.set_state(self.angle, (np.array(self.speed) + jump[0]).tolist())

    def step(self, torque_nm: Sequence[float], step_s: float) -> None:
        """Advance by `step_s` under constant motor torques, one per joint. `angle` and `speed` become new lists.

        MuJoCo's semi-implicit Euler (v += h·a(q), q += h·v) with half a drift before it and half a drift taken back
        after it is position Verlet: second order, no energy drift of an undamped wire, and one force evaluation per
        step. The lists of the state before the step are left unchanged.
        """
        half_s = 0.5 * step_s
        position, applied, motor_dof, speed = self._set_position, self._applied, self.motor_dof, self.speed
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
        ahead, speed = self._positions(), self._velocities()
        self.speed = speed
        self.angle = [ahead[dof] - half_s * rate for dof, rate in enumerate(speed)]
        if self.grips is not None:
            self.grips.look(step_s)

    @property
    def object(self) -> ObjectState | None:
        """The object that the arms carry; None if the cell has none."""
        return None if self.grips is None else self.grips.state()

    def object_summary(self) -> dict[str, Any] | None:
        """Figures of the grips since power-on; None if there is no object."""
        return None if self.grips is None else self.grips.summary()

    def open_grip(self, hand: str) -> None:
        """The "master" or the "slave" lets go of the object, if there is one."""
        if self.grips is not None:
            self.grips.open(hand)

    def move_hand(self, hand: str, bits: int) -> None:
        """What the latch tells the motor of the "master"'s hand or the "slave"'s, see `HandBits`."""
        if self.grips is not None:
            self.grips.command(hand, bits)

    def wait(self, step_s: float) -> None:
        """Let time pass for arms that rest on supports: only hands move."""
        if self.grips is not None and self.grips.moves:
            self._position[:] = self.angle
            self.grips.wait(step_s)

    def brake(self, joint: int, friction_nm: float) -> None:
        """Dry friction of a brake at a joint's motor, from the next step on."""
        if friction_nm != self._brake_nm[joint]:
            self._brake_nm[joint], dof = friction_nm, self.motor_dof[joint]
            self._model.dof_frictionloss[dof] = self._friction_nm[dof] + friction_nm

    def hold(self, angle: Sequence[float], dofs: Iterable[int]) -> None:
        """Put these joints and motors back to `angle`, at rest: a support carries them."""
        for dof in dofs:
            self.angle[dof], self.speed[dof], self._velocity[dof] = angle[dof], 0.0, 0.0

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
                # The rotor becomes part of the joint's inertia and brings in its excess momentum.
                gear_ratio = self._cell.joints[joint].motor.gear_ratio
                inertia_kg_m2 = self._truth.joints[joint].rotor_inertia_kg_m2 * gear_ratio**2
                impulse_nm_s[joint] = inertia_kg_m2 * (before.speed[old] - before.speed[joint])
        self.set_state(angle, speed)
        if self.grips is not None and before.grips is not None:
            self.grips.take_over(before.grips)
        for joint, friction_nm in enumerate(before._brake_nm):
            self.brake(joint, friction_nm)
        # The solver's starting point, the last accelerations, decides the last bits.
        self._data.qacc_warmstart[:] = before._data.qacc_warmstart[sources]
        if any(impulse_nm_s):
            self.strike(impulse_nm_s)


def _kept_twist(twist_rad: float, old: JointTruth, new: JointTruth) -> float | None:
    """The twist (motor minus joint) of an elastic wire after it has changed; None if it does not change."""
    old_wire = old.wire_is_broken, old.wire_dead_band_rad, old.wire_stiffness_nm_rad
    if new.wire_is_broken or old_wire == (False, new.wire_dead_band_rad, new.wire_stiffness_nm_rad):
        return None
    stretch_rad = 0.0 if old.wire_is_broken else max(abs(twist_rad) - old.wire_dead_band_rad, 0.0)
    limit_rad = new.wire_dead_band_rad + stretch_rad * min(old.wire_stiffness_nm_rad / new.wire_stiffness_nm_rad, 1.0)
    return None if abs(twist_rad) <= limit_rad else math.copysign(limit_rad, twist_rad)
