"""How strong a drive each joint of an arm needs, by arithmetic on its nominal model.

The worst holding torque over all poses within the limits is at most 60 % of the drive's torque;
the built-in motions take at most 80 %. Owns the numbers of motor, gear and amplifier, but no text of a cell.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canarm_controller.dynamics import SerialArm
from canarm_controller.reference.trajectory import BUILT_IN, blend_from, make_trajectory
from canarm_protocol.cell.model import Cell, Robot

from .request import NewCellError

Floats = NDArray[np.float64]

HOLD_SHARE, MOTION_SHARE = 0.6, 0.8
LEAST_RAD_S2 = 30.0
"""The drive of a joint with no weight to hold can still give it this acceleration at its home pose."""
LEAST_NM = 0.2
"""The weakest drive of an arm: 4 mN m at the motor."""
GEAR_RATIO, GEAR_EFFICIENCY = 60.0, 0.85
ROTOR_INERTIA_PER_NM = 1.25e-4
"""kg m2 per N m of the motor's own torque: that of a DC servo motor, 1.5e-5 at 0.12 N m."""
VISCOUS_SHARE, COULOMB_SHARE = 0.02, 0.025
"""Viscous friction at full speed, and Coulomb friction, as shares of the drive's torque."""
CURRENTS_A = (1.5, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)
SUPPLIES_V = (15.0, 24.0, 36.0, 48.0)
"""Amplifiers and supplies to choose from; the first are the D669's."""
WINDING_SHARE = 0.25
"""Voltage across the winding's resistance at the highest current, as a share of the supply."""
SUPPLY_SHARE = 0.95
"""Voltage that the motor needs at full speed and the highest current, as a share of the supply."""
WINDING_MS = 0.5
"""L/R of the winding."""
STIFFNESS_PER_RAD = 33.0
"""An elastic drive wire twists by 1/33 rad at the drive's full torque."""

POSES, SWEEPS = 48, 5
ROUNDS = 40
MOTION_S, MOTION_STEP_S, ENTRY_S = 20.48, 0.01, 2.0


@dataclass(frozen=True, slots=True)
class DriveSize:
    """Motor, gear and amplifier of one joint in a cell's units, and the torques they were chosen for."""

    hold_nm: float
    motion_nm: float
    torque_nm: float
    torque_constant_nm_a: float
    rotor_inertia_kg_m2: float
    winding_ohm: float
    winding_mh: float
    viscous_nm_s: float
    coulomb_nm: float
    stiffness_nm_rad: float
    max_current_a: float
    supply_v: float


@dataclass(frozen=True, slots=True)
class Friction:
    """Friction of one joint where its maker states it; None where it is assumed."""

    viscous_nm_s: float | None = None
    coulomb_nm: float | None = None


def size_drives(cell: Cell, friction: Sequence[Friction], speed_rad_s: Sequence[float]) -> list[DriveSize]:
    """A drive for each joint of the single robot of `cell`, whose own motors are ignored.

    `speed_rad_s` is each joint's highest speed. Raises `NewCellError` where no drive is strong enough, and
    `ControllerError` if the arm cannot be modelled.
    """
    robot = cell.robot[0]
    arm = _links_only(robot)
    hold_nm = worst_hold_nm(arm, robot)
    at_home = arm.inertia([math.radians(joint.home_deg) for joint in robot.joint])
    motion = _motions(arm, cell)
    return [
        _size(
            name,
            float(hold_nm[index]),
            at_home[index][index],
            [part[:, index] for part in motion],
            friction[index],
            speed_rad_s[index],
        )
        for index, name in enumerate(cell.joint_names)
    ]


def _links_only(robot: Robot) -> SerialArm:
    """The robot with drives of negligible inertia and friction."""
    joints = tuple(
        joint.model_copy(
            update={
                "motor": joint.motor.model_copy(
                    update={
                        "rotor_inertia_kg_m2": 1e-18,
                        "gear_ratio": 1.0,
                        "viscous_friction_nm_s": 0.0,
                        "coulomb_friction_nm": 0.0,
                    }
                )
            }
        )
        for joint in robot.joint
    )
    return SerialArm.from_robot(robot.model_copy(update={"joint": joints}))


def worst_hold_nm(arm: SerialArm, robot: Robot) -> Floats:
    """The greatest torque of gravity at each joint over all poses within the limits, N·m.

    As a function of any one angle, gravity's torque is a + b·cos q + c·sin q: three values give its greatest one
    between two limits. From many poses, one angle after another is set to it until the torque no longer grows.
    """
    low, high = (np.radians([joint.limits_deg[end] for joint in robot.joint]) for end in (0, 1))
    starts = np.random.default_rng(0).uniform(low, high, (POSES, arm.joint_count))
    return np.array(
        [max(_highest(arm, joint, sign, starts, low, high) for sign in (1.0, -1.0)) for joint in range(arm.joint_count)]
    )


def _highest(arm: SerialArm, joint: int, sign: float, starts: Floats, low: Floats, high: Floats) -> float:
    def value(poses: Floats) -> Floats:
        still = np.zeros_like(poses)
        return sign * arm.torque_batch_nm(poses, still, still)[:, joint]

    poses = starts.copy()
    probes_rad = np.array([0.0, 1.0, 2.0]) * (2.0 * np.pi / 3.0)
    for angle in list(range(arm.joint_count)) * SWEEPS:
        probes = np.repeat(poses[None], 3, axis=0)
        probes[:, :, angle] = probes_rad[:, None]
        found = value(probes.reshape(-1, arm.joint_count)).reshape(3, -1)
        along, across = (2.0 / 3.0 * wave(probes_rad) @ found for wave in (np.cos, np.sin))
        peak = low[angle] + np.mod(np.arctan2(across, along) - low[angle], 2.0 * np.pi)
        tried = np.stack(
            [np.full(len(poses), low[angle]), np.full(len(poses), high[angle]), np.minimum(peak, high[angle])]
        )
        best = np.argmax(along * np.cos(tried) + across * np.sin(tried), axis=0)
        poses[:, angle] = tried[best, np.arange(len(poses))]
    return float(np.max(value(poses)))


def _motions(arm: SerialArm, cell: Cell) -> tuple[Floats, Floats, Floats]:
    """Torque of the links (N·m), speed (rad/s) and acceleration (rad/s²) through the built-in motions, (n, joints).

    Each is entered from rest at the home pose, which takes more torque than the motion itself.
    """
    home_rad = [math.radians(joint.home_deg) for joint in cell.joints]
    parts: list[tuple[Floats, Floats, Floats]] = []
    for name in BUILT_IN:
        motion = make_trajectory(name, cell)
        entered = blend_from(motion, home_rad, ENTRY_S)
        for trajectory, seconds in ((entered, ENTRY_S), (motion, MOTION_S)):
            reference = trajectory.sample(0, round(seconds / MOTION_STEP_S), MOTION_STEP_S)
            speed, change = reference.velocity_rad_s, reference.acceleration_rad_s2
            parts.append((arm.torque_batch_nm(reference.position_rad, speed, change), speed, change))
    load, speed, change = (np.concatenate([part[index] for part in parts]) for index in range(3))
    return load, speed, change


def _size(
    name: str, hold_nm: float, inertia_kg_m2: float, motion: Sequence[Floats], friction: Friction, fastest_rad_s: float
) -> DriveSize:
    """The drive of one joint, by iteration: its own rotor and friction are part of its load."""
    load_nm, speed, change = motion
    torque_nm = motion_nm = 0.0
    for _ in range(ROUNDS):
        rotor = _rotor_inertia(torque_nm)
        reflected = rotor * GEAR_RATIO**2
        viscous = _chosen(friction.viscous_nm_s, VISCOUS_SHARE * torque_nm / fastest_rad_s)
        coulomb = _chosen(friction.coulomb_nm, COULOMB_SHARE * torque_nm)
        own_nm = reflected * change + viscous * speed + coulomb * np.sign(speed)
        motion_nm = float(np.max(np.abs(load_nm + own_nm)))
        floor_nm = max(LEAST_NM, LEAST_RAD_S2 * (inertia_kg_m2 + reflected))
        before, torque_nm = torque_nm, max(hold_nm / HOLD_SHARE, motion_nm / MOTION_SHARE, floor_nm)
    if not before > 0.99 * torque_nm:
        raise NewCellError(
            f"joint {name!r}: no motor is strong enough for itself: hold {hold_nm:.3g} N m, motion {motion_nm:.3g} N m "
            f"at {fastest_rad_s:g} rad/s; give the joint less mass or less speed"
        )
    torque_nm = _up(torque_nm)
    amplifier = _amplifier(name, torque_nm, fastest_rad_s)
    max_current_a, supply_v = amplifier
    winding_ohm = WINDING_SHARE * supply_v / max_current_a
    return DriveSize(
        hold_nm=hold_nm,
        motion_nm=motion_nm,
        torque_nm=torque_nm,
        torque_constant_nm_a=torque_nm / (GEAR_RATIO * GEAR_EFFICIENCY * max_current_a),
        rotor_inertia_kg_m2=_rotor_inertia(torque_nm),
        winding_ohm=winding_ohm,
        winding_mh=winding_ohm * WINDING_MS,
        viscous_nm_s=_chosen(friction.viscous_nm_s, VISCOUS_SHARE * torque_nm / fastest_rad_s),
        coulomb_nm=_chosen(friction.coulomb_nm, COULOMB_SHARE * torque_nm),
        stiffness_nm_rad=STIFFNESS_PER_RAD * torque_nm,
        max_current_a=max_current_a,
        supply_v=supply_v,
    )


def _amplifier(name: str, torque_nm: float, fastest_rad_s: float) -> tuple[float, float]:
    """Current and supply of the smallest amplifier that makes `torque_nm` at full speed: K_e·N·ω + R·I fits in."""
    for max_current_a in CURRENTS_A:
        back_emf_v = torque_nm * fastest_rad_s / (GEAR_EFFICIENCY * max_current_a)
        for supply_v in SUPPLIES_V:
            if back_emf_v + WINDING_SHARE * supply_v <= SUPPLY_SHARE * supply_v:
                return max_current_a, supply_v
    raise NewCellError(
        f"joint {name!r}: {torque_nm:.3g} N m at {fastest_rad_s:g} rad/s takes {back_emf_v:.0f} V at "
        f"{CURRENTS_A[-1]:g} A, and the largest supply has {SUPPLIES_V[-1]:g} V; give the joint less mass or less speed"
    )


def _rotor_inertia(torque_nm: float) -> float:
    return ROTOR_INERTIA_PER_NM * torque_nm / (GEAR_RATIO * GEAR_EFFICIENCY)


def _chosen(stated: float | None, assumed: float) -> float:
    return assumed if stated is None else stated


def _up(value: float) -> float:
    """`value` rounded up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit - 1e-9) * unit
