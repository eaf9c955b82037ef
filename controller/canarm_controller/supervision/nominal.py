"""A joint's nominal figures for the detectors: noise of its sensors, mobility, weight, drive.

Turns cell and nominal arm into plain numbers; `thresholds.py` derives the limits from them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell, Joint, Robot
from canarm_protocol.cell.sensing import JointSensors, WiredSensor, joint_sensors
from canarm_protocol.cell.sensors import AnalogueSensor

from ..dynamics import Arm, Floats, nominal_arm
from .uncertainty import PAYLOAD, TORQUE_CONSTANT

ROUNDING_LSB = 1.0 / math.sqrt(12.0)
"""Standard deviation of the error of rounding to a whole code."""
POSES = 96
"""Number of poses, evenly spread over the joints' ranges: extremes of gravity and inertia to a few per cent."""
PLASTIC = 1.2207440846
"""The root of x**4 = x + 1: steps of its inverse powers, modulo 1, fill a box evenly (Roberts' R sequence)."""


@dataclass(frozen=True, slots=True)
class SensorNominal:
    """One sensor: `step` of its code and noise of one reading (standard deviation, rounding included), in its unit.

    `skew_s` is how long after SYNC it is sampled. A counter has no ends, `end_codes` is empty.
    """

    title: str
    step: float
    noise: float
    end_codes: tuple[int, ...]
    skew_s: float

    @property
    def noise_lsb(self) -> float:
        """Noise of one reading in steps of the code."""
        return self.noise / self.step


@dataclass(frozen=True, slots=True)
class JointNominal:
    """One joint. Mobility is the acceleration per N·m of its drive, other drives' torques unchanged: least and most."""

    name: str
    position: SensorNominal
    speed: SensorNominal | None
    current: SensorNominal | None
    mobility_per_kg_m2: tuple[float, float]
    falling_rad_s2: float
    """The highest acceleration of the joint by the arm's own weight with all torque off."""
    weight_nm: float
    """The highest holding torque of the joint."""
    payload_nm: float
    """The most that a payload within the box adds to it."""
    payload_rad_s2: float
    """Highest acceleration by payload and torque constant within the box of an arm that is held as nominal."""
    payload_change_rad_s2: float
    """The same of an arm that is held with a payload at one end of the box, which then is at the other."""
    coulomb_nm: float
    rotor_kg_m2: float
    wire_stiffness_nm_rad: float
    torque_per_ampere: float
    max_current_a: float
    fastest_rad_s: float
    """The end of its tachometer's range, or the speed at which the back-EMF equals the supply."""
    winding_s: float
    """Electrical time constant L/R."""
    winding_ohm: float
    supply_v: float
    back_emf_v_s_rad: float


def joint_nominals(cell: Cell, arms: Sequence[Arm]) -> tuple[JointNominal, ...]:
    """All joints of `cell`; `arms` are those of its robots, in order."""
    nominals: list[JointNominal] = []
    sensors = iter(joint_sensors(cell))
    for robot, arm in zip(cell.laden, arms, strict=True):
        loads = _loads(arm, heavier_arm(robot), [joint.limits_deg for joint in robot.joint])
        for joint, load in zip(robot.joint, loads, strict=True):
            nominals.append(_nominal(cell.joint_names[len(nominals)], joint, load, next(sensors)))
    return tuple(nominals)


def heavier_arm(robot: Robot) -> Arm:
    """The nominal arm with its last link heavier by the most that the box has."""
    *others, last = robot.joint
    factor = 1.0 + PAYLOAD[1]
    solid = last.solid
    xx, yy, zz, xy, xz, yz = (factor * each for each in solid.tensor_kg_m2)
    heavier = solid.with_inertial(factor * solid.mass_kg, solid.centre_of_mass_m, (xx, yy, zz, xy, xz, yz))
    last = last.model_copy(update={"body" if last.body else "link": heavier})
    return nominal_arm(robot.model_copy(update={"joint": (*others, last)}))


@dataclass(frozen=True, slots=True)
class _Load:
    mobility: tuple[float, float]
    falling_rad_s2: float
    weight_nm: float
    payload_nm: float
    payload_rad_s2: float
    payload_change_rad_s2: float


def _loads(arm: Arm, heavier: Arm, limits_deg: Sequence[tuple[float, float]]) -> list[_Load]:
    """Extremes over poses within the limits, per joint. Inertia and weight are linear in the payload."""
    low, high = np.radians(limits_deg).T
    count = arm.joint_count
    steps = np.array([PLASTIC ** -(axis + 1) for axis in range(count)])
    lightest = PAYLOAD[0] / PAYLOAD[1]
    rotors = np.diag(arm.rotor_inertia)
    poses = low + (high - low) * ((0.5 + np.outer(np.arange(1, POSES + 1), steps)) % 1.0)
    inertia, gravity = _along(arm, poses)
    more_inertia, more_gravity = (
        more - own for more, own in zip(_along(heavier, poses), (inertia, gravity), strict=True)
    )
    inverse = np.linalg.inv(inertia + rotors)
    mobility = np.diagonal(inverse, axis1=1, axis2=2)
    falling, weight = np.abs(_times(inverse, gravity)), np.abs(gravity)
    payload = np.abs(more_gravity) * max(1.0, -lightest)
    sagging: list[Floats] = []
    changed: list[Floats] = []
    for share in (lightest, 1.0):
        true = np.linalg.inv(inertia + rotors + share * more_inertia)
        rows = ((factor - 1.0) * gravity - share * more_gravity for factor in TORQUE_CONSTANT)
        sagging += [np.abs(_times(true, row)) for row in rows]
        changed.append(np.abs(_times(true, (1.0 - lightest) * more_gravity)))
    extremes = (
        np.min(mobility, 0),
        np.max(mobility, 0),
        *(np.max(rows, 0) for rows in (falling, weight, payload, np.concatenate(sagging), np.concatenate(changed))),
    )
    return [
        _Load((least, most), *others)
        for least, most, *others in zip(*(extreme.tolist() for extreme in extremes), strict=True)
    ]


def _along(arm: Arm, poses: Floats) -> tuple[Floats, Floats]:
    """Inertia matrix without rotors, (poses, joints, joints), and gravity, (poses, joints), in each of the poses."""
    rows = poses.tolist()
    return np.array([arm.inertia(pose) for pose in rows]), np.array([arm.gravity(pose) for pose in rows])


def _times(matrices: NDArray[np.floating[Any]], vectors: Floats) -> Floats:
    product: Floats = (matrices @ vectors[..., None])[..., 0]
    return product


def _nominal(name: str, joint: Joint, load: _Load, sensors: JointSensors) -> JointNominal:
    motor, drive = joint.motor, joint.drive
    return JointNominal(
        name=name,
        position=sensor_nominal(sensors.position),
        speed=sensor_nominal(sensors.velocity) if sensors.velocity else None,
        current=sensor_nominal(sensors.current) if sensors.current else None,
        mobility_per_kg_m2=load.mobility,
        falling_rad_s2=load.falling_rad_s2,
        weight_nm=load.weight_nm,
        payload_nm=load.payload_nm,
        payload_rad_s2=load.payload_rad_s2,
        payload_change_rad_s2=load.payload_change_rad_s2,
        coulomb_nm=motor.coulomb_friction_nm,
        rotor_kg_m2=motor.reflected_inertia_kg_m2,
        wire_stiffness_nm_rad=motor.wire_stiffness_nm_rad,
        torque_per_ampere=motor.torque_per_ampere,
        max_current_a=drive.max_current_a,
        fastest_rad_s=joint.fastest_rad_s,
        winding_s=motor.winding_mh * 1e-3 / motor.winding_ohm,
        winding_ohm=motor.winding_ohm,
        supply_v=drive.supply_v,
        back_emf_v_s_rad=motor.back_emf_v_s_rad,
    )


def sensor_nominal(wired: WiredSensor) -> SensorNominal:
    """A sensor's figures for the detectors; a counter has only rounding noise."""
    sensor, step = wired.sensor, wired.scale.lsb
    noise_lsb, ends = (sensor.noise_lsb, (0, wired.highest_code)) if isinstance(sensor, AnalogueSensor) else (0.0, ())
    return SensorNominal(sensor.title, step, step * math.hypot(noise_lsb, ROUNDING_LSB), ends, wired.skew_s)
