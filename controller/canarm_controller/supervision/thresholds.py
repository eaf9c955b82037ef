"""The limits of one joint's detectors, derived from the cell.

Owns the arithmetic. Limits are multiples of a *grain*, the resolution of an angle or a speed. It is the noise
of a reading, or the error of a right model, whichever is larger. Multiples were measured at 0.3 LSB of noise, where a
grain is a step of the code; `[supervision]` of the cell overrides some of them. What is compared with a limit is not
known here.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from canarm_protocol.cell.model import Joint, Supervision

from ..estimation.blind import blind_pole_rad_s
from .nominal import ROUNDING_LSB, JointNominal, SensorNominal
from .timing import Timing
from .uncertainty import COULOMB, TORQUE_CONSTANT, WIRE

REFERENCE_NOISE = math.hypot(0.3, ROUNDING_LSB)
"""Noise of one reading in grains at which the multiples below were measured: 0.42."""
BANDWIDTH_RAD_S = 30.0
"""Bandwidth of the observer of speed and acceleration bias: fast enough for a wrong payload along a swing (10 rad/s³
leave 10/30² rad/s), slow enough that a step of either shows fully."""
SLOWEST_POLE = 0.5
"""Highest product of bandwidth and cycle time: an observer must be slower than its cycle."""
DRIFT_S = 6.0
"""Time in which the tachometer's offset is learned from the position; shorter at first."""
COULOMB_TURN = 2.0 * (COULOMB[1] - 1.0)
"""Error of the model's friction when the worst of the box changes its sign, over the nominal Coulomb friction."""
USUAL_SPEED_SHARE = 0.5
"""Speed of a joint while its payload is wrong, as a share of its highest speed."""
KICK_SHARE = 0.4
"""Share that remains of the speed change when Coulomb friction reverses between two evaluations of the model: 2.5
grains, half of the limit of a jump."""
BLIND_NOISE = 1.32
"""sqrt(7)/2: an observer with three equal poles p turns noise σ into speed noise of this times σ·p·sqrt(pT)."""
INTEGRAL_GRAINS = 5.0
"""Grain over the error of the integrated tachometer: a drift of 0.65 grains is then three standard deviations."""
TIMING_SHARE = 0.1
"""Uncertainty of a reading's time, as a share of a cycle: at the highest speed it is an error of the angle."""
ROUNDING_BIAS = 1.0 / math.pi
"""Mean rounding error of a value with sigma steps of noise, in steps, is this times exp(-2 (pi sigma)^2)."""

POSITION_JUMP, POSITION_DRIFT, SPEED_JUMP, SPEED_DRIFT = 4.5, 0.65, 5.0, 2.2
"""Grains: a residual of the angle (1.9 occur), over 16 readings (0.48); of the speed (2.5), over 8 (1.3)."""
DOUBT, STUCK_SPEED, STUCK_TRAVEL, STUCK_SUSPECT = 2.7, 4.5, 1.25, 0.5
"""Grains: a speed error that is no fault, but remembered (a payload of ±50 % leaves 2.2); how far the model's speed or
the tachometer's travel must change while a code does not; and the travel at which a verdict waits for the rest."""
STANDING, TOLD, TOLD_SHARE = 3.06, 25.0, 0.2
"""Grains of speed: below, a joint stands; above, in both directions, a tachometer has proved itself again, or at a
fifth of its range if that is less."""
STANDING_SHARE = 0.024
"""Of the fastest speed, konkuk1's 0.06 of 2.5 rad/s: a joint stands below that, or below what its sensors can tell,
whatever its model may lack."""
ACCELERATION_SIGMAS, FRICTION_REVERSALS = 3.5, 2.0
"""An unexpected acceleration exceeds these: deviations of two readings `assessed` cycles apart, and friction."""
START_FACTOR, WIRE_OVERSHOOT = 4.0, 2.0
"""While the arm leaves its support the payload is not known; and an elastic wire that takes up the arm lets the motor
swing by itself, up to twice what drive, weight and friction make of the rotor alone."""
UNLEARNED_TWIST = 0.25
"""A compliance is learned to a third of what the softest of the box has, a drift is 0.65 grains, and the arm's weight
turns by half of its most about its mean: 0.33 x 0.5 = 0.65 x 0.25."""
LIGHTEST_SHARE = 0.05
"""Of a joint's inertia: no link is lighter than that beside its rotor."""
LASTING_SHARE_OF_FALL, LASTING_FACTOR = 0.9, 3.0
"""Share of the acceleration by the arm's whole weight, which no gained or lost payload reaches; never less
than this factor on the limit of unexpected accelerations."""
CURRENT_SHARE, CURRENT_SIGMAS = 0.05, 8.0
"""Share of the amplifier's full scale, half of a fault; never below the noise of the sense."""
VISIBLE_SHARE, VISIBLE_S = 0.05, 0.025
"""Share of the fastest speed by which a joint must not come to be faster or slower within this time, unnoticed."""
FLUTTER_SHARE, FLUTTER_SIGMAS = 0.2, 5.0
"""Share of that limit (15 of konkuk1's 75 mA), and deviations of noise: 5 mA occur; offset and gain errors cause no
more. Above it, the current does not follow the command."""
TOLD_CURRENT_SHARE, TOLD_CURRENT_SIGMAS, SUDDEN_FACTOR = 0.08 / 1.5, 2.4, 1.5
"""Share of full scale, and deviations of acceleration noise as current: a missing share of torque shows above it."""
SAG_SHARE = 0.115
"""Share of the deflection by half the weight in a loop of 12 rad/s: the unit of a law's normal following error."""
JUDGED_AT_RAD_S = 12.0
"""Natural frequency at which laws state their normal following error."""
MARGIN_RAD, MARGIN_SIGMAS = math.radians(1.0), 4.54
"""Margin beyond the stops: their give, and the noise of a reading."""
MISSING_S, LEAST_MISSING = 0.04, 4
"""The longest time under the last currents; but at least as many cycles that a lost frame stops nothing."""
SILENT_S = 0.015
"""The longest silence of a card while others are heard: robots that carry something stop together within 20 ms."""
STEP_SPEEDS, STEP_SIGMAS = 4.0, 15.0
"""An impossible step, as multiples of the fastest motion per cycle and of the noise."""


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Limits of one joint in rad, rad/s, rad/s² and A. Without a tachometer, speed limits apply to the model."""

    noise_rad: float
    """Standard deviation of one reading of the angle."""
    position_grain: float
    speed_grain: float
    jump: float
    drift: float
    step: float
    swing: float
    doubt: float
    stuck_speed: float
    stuck_travel: float
    stuck_suspect: float
    standing: float
    moved: float
    """An angle that noise does not make: a joint is no longer where it was."""
    told_speed: float
    acceleration: float
    start_acceleration: float
    start_speed: float
    """While the arm takes up its wires, rad/s: what the motors swing by."""
    wire_turn_s: float
    """A quarter of the quickest swing of a motor on its wire: from one side to the other it takes twice as long."""
    twist: float
    """What the softest wire of the box is twisted by under the heaviest arm, rad."""
    lasting: float
    turned_nm: float
    """What Coulomb friction of the box, in N·m, may be off by in a joint that has just turned, or stands."""
    motor_share: float
    """How much more a motor answers alone, on an elastic wire, than with its joint."""
    payload: float
    """What payload and torque constant of the box make of the joint, rad/s²."""
    stuck_drift: float
    """What that may change by in a second, rad/s³, while a code does not change."""
    stuck_turned: float
    """The same for a joint that stands, rad/s: its friction may be anything."""
    current: float
    moving_current: float
    """A difference of the currents, A, that moves the joint visibly before it is as large as `current`."""
    told_current: float
    sudden_current: float
    flutter: float
    following_unit: float


def thresholds(joint: JointNominal, limits: Supervision, timing: Timing, falling_rad_s2: float) -> Thresholds:
    """Limits of `joint`; `falling_rad_s2` is the highest acceleration of any of the arm's joints by its weight."""
    position, speed = joint.position, joint.speed
    position_grain, speed_grain = position_grain_rad(joint, timing), speed_grain_rad_s(joint, timing)
    position_step, speed_step = position.step, speed.step if speed else speed_grain
    step = _chosen(limits.speed_jump_lsb, speed_step, SPEED_JUMP * speed_grain)
    sigma = acceleration_noise_rad_s2(joint, timing)
    acceleration = limits.acceleration_mismatch_rad_s2 or max(
        ACCELERATION_SIGMAS * sigma, FRICTION_REVERSALS * joint.coulomb_nm * joint.mobility_per_kg_m2[1]
    )
    told_a = max(
        TOLD_CURRENT_SHARE * joint.max_current_a,
        TOLD_CURRENT_SIGMAS * sigma / (joint.torque_per_ampere * joint.mobility_per_kg_m2[0]),
    )
    current_a = limits.current_mismatch_a or current_limit_a(joint)
    return Thresholds(
        noise_rad=REFERENCE_NOISE * position_grain,
        position_grain=position_grain,
        speed_grain=speed_grain,
        jump=_chosen(limits.position_jump_lsb, position_step, POSITION_JUMP * position_grain),
        drift=_chosen(limits.position_drift_lsb, position_step, POSITION_DRIFT * position_grain),
        step=step,
        swing=_chosen(limits.speed_drift_lsb, speed_step, SPEED_DRIFT * speed_grain),
        doubt=min(DOUBT * speed_grain, step),
        stuck_speed=STUCK_SPEED * speed_grain,
        stuck_travel=STUCK_TRAVEL * position_grain,
        stuck_suspect=STUCK_SUSPECT * position_grain,
        standing=standing_rad_s(joint, timing),
        moved=STANDING * position.noise / REFERENCE_NOISE,
        told_speed=min(TOLD * speed_grain, TOLD_SHARE * joint.fastest_rad_s),
        acceleration=acceleration,
        start_acceleration=max(START_FACTOR * acceleration, wire_swing_rad_s2(joint)),
        start_speed=wire_speed_rad_s(joint),
        wire_turn_s=0.5 * math.pi / wire_rad_s(joint, WIRE[1]),
        twist=twist_rad(joint) if speed else 0.0,
        lasting=max(
            LASTING_SHARE_OF_FALL * falling_rad_s2, LASTING_FACTOR * acceleration, payload_change_rad_s2(joint)
        ),
        turned_nm=turned_nm(joint),
        motor_share=motor_share(joint),
        payload=joint.payload_rad_s2,
        stuck_drift=payload_turn_rad_s3(joint),
        stuck_turned=turned_nm(joint) * joint.mobility_per_kg_m2[1],
        current=current_a,
        moving_current=moving_current_a(joint, current_a),
        told_current=told_a,
        sudden_current=SUDDEN_FACTOR * told_a,
        flutter=flutter_limit_a(joint, current_a),
        following_unit=following_unit_rad(joint, position_grain),
    )


def cell_thresholds(joints: Sequence[JointNominal], limits: Supervision, timing: Timing) -> tuple[Thresholds, ...]:
    """Limits of all joints of a cell."""
    falling_rad_s2 = max(joint.falling_rad_s2 for joint in joints)
    return tuple(thresholds(joint, limits, timing, falling_rad_s2) for joint in joints)


def observer_bandwidth_rad_s(period_s: float) -> float:
    """Bandwidth of the observer of a joint's speed and acceleration bias."""
    return min(BANDWIDTH_RAD_S, SLOWEST_POLE / period_s)


def position_grain_rad(joint: JointNominal, timing: Timing) -> float:
    """Grain of an angle: noise of the sensor, or the error of the integrated tachometer."""
    grain = joint.position.noise / REFERENCE_NOISE
    return max(
        grain,
        INTEGRAL_GRAINS * integral_error_rad(joint, timing),
        timing_error_rad(joint, timing),
        unlearned_twist_rad(joint),
    )


def unlearned_twist_rad(joint: JointNominal) -> float:
    """What of a wire's twist is not known after its compliance has been learned; with a sensor at either end of it."""
    return UNLEARNED_TWIST * twist_rad(joint) if joint.speed else 0.0


def timing_error_rad(joint: JointNominal, timing: Timing) -> float:
    """Error of an angle at the highest speed due to its uncertain time."""
    return TIMING_SHARE * joint.fastest_rad_s * timing.period_s


def integral_error_rad(joint: JointNominal, timing: Timing) -> float:
    """Standard deviation of the integrated tachometer while its offset is learned: a random walk, and rounding."""
    speed = joint.speed
    if speed is None:
        return 0.0
    rate = 2.0 / DRIFT_S
    walk = speed.noise * math.sqrt(timing.period_s / (4.0 * rate))
    analogue_lsb2 = max(speed.noise_lsb**2 - ROUNDING_LSB**2, 0.0)
    bias = speed.step * ROUNDING_BIAS * math.exp(-2.0 * math.pi**2 * analogue_lsb2)
    return math.hypot(walk, bias / (2.0 * rate))


def speed_grain_rad_s(joint: JointNominal, timing: Timing) -> float:
    """Grain of a speed: noise of the tachometer, a turning payload, or reversing friction."""
    noise = speed_noise_rad_s(joint, timing) / REFERENCE_NOISE
    return max(noise, payload_speed_rad_s(joint, timing), friction_speed_rad_s(joint, timing))


def standing_rad_s(joint: JointNominal, timing: Timing) -> float:
    """The speed below which a joint stands: of noise alone, or a small part of its fastest; not what a model lacks."""
    noise = STANDING * speed_noise_rad_s(joint, timing) / REFERENCE_NOISE
    return min(STANDING * speed_grain_rad_s(joint, timing), max(noise, STANDING_SHARE * joint.fastest_rad_s))


def speed_noise_rad_s(joint: JointNominal, timing: Timing) -> float:
    """Standard deviation of one speed: the tachometer's reading, or the observer's estimate from the angle."""
    if joint.speed:
        return joint.speed.noise
    pole = blind_pole_rad_s(timing.period_s)
    return BLIND_NOISE * pole * math.sqrt(pole * timing.period_s) * joint.position.noise


def payload_speed_rad_s(joint: JointNominal, timing: Timing) -> float:
    """Error of the observer's speed while a wrong payload turns with the arm."""
    bandwidth = observer_bandwidth_rad_s(timing.period_s) if joint.speed else blind_pole_rad_s(timing.period_s)
    return payload_turn_rad_s3(joint) / bandwidth**2


def payload_turn_rad_s3(joint: JointNominal) -> float:
    """How fast what a payload makes of the joint changes while the arm turns."""
    return joint.payload_rad_s2 * USUAL_SPEED_SHARE * joint.fastest_rad_s


def friction_speed_rad_s(joint: JointNominal, timing: Timing) -> float:
    """Error of the speed when Coulomb friction reverses before the model is evaluated again."""
    reversal_rad_s2 = 2.0 * joint.coulomb_nm * joint.mobility_per_kg_m2[1]
    return KICK_SHARE * reversal_rad_s2 * timing.refresh * timing.period_s


def acceleration_noise_rad_s2(joint: JointNominal, timing: Timing) -> float:
    """Standard deviation of an acceleration from two readings of the tachometer."""
    return math.sqrt(2.0) * speed_noise_rad_s(joint, timing) / timing.assessed_s


def wire_swing_rad_s2(joint: JointNominal) -> float:
    """How the motor may swing while the wire takes up the arm: all that the drive has, the heaviest arm, friction."""
    drive_nm = TORQUE_CONSTANT[1] * joint.torque_per_ampere * joint.max_current_a
    torque_nm = drive_nm + joint.weight_nm + joint.payload_nm + COULOMB[1] * joint.coulomb_nm
    return WIRE_OVERSHOOT * torque_nm / joint.rotor_kg_m2


def wire_rad_s(joint: JointNominal, factor: float) -> float:
    """The swing of motor against joint on an elastic wire that is `factor` times as stiff as the cell says."""
    whole = 1.0 / joint.mobility_per_kg_m2[0]
    link = max(whole - joint.rotor_kg_m2, LIGHTEST_SHARE * whole)
    return math.sqrt(factor * joint.wire_stiffness_nm_rad * (1.0 / joint.rotor_kg_m2 + 1.0 / link))


def wire_speed_rad_s(joint: JointNominal) -> float:
    """How fast a motor swings on its wire that takes up the heaviest arm, and turns friction."""
    torque_nm = joint.weight_nm + joint.payload_nm + COULOMB[1] * joint.coulomb_nm
    return WIRE_OVERSHOOT * torque_nm / (joint.rotor_kg_m2 * wire_rad_s(joint, WIRE[0]))


def motor_share(joint: JointNominal) -> float:
    """How much more a motor answers alone, on an elastic wire, than with its joint."""
    return max(1.0 / (joint.mobility_per_kg_m2[0] * joint.rotor_kg_m2) - 1.0, 0.0)


def twist_rad(joint: JointNominal) -> float:
    """What the softest wire is twisted by under the heaviest arm."""
    return (joint.weight_nm + joint.payload_nm) / (WIRE[0] * joint.wire_stiffness_nm_rad)


def turned_nm(joint: JointNominal) -> float:
    """What the model's friction is off by in a joint that has turned: the worst of the box, one way and the other."""
    return COULOMB_TURN * joint.coulomb_nm


def payload_change_rad_s2(joint: JointNominal) -> float:
    """What a payload that changes from one end of the box to the other makes, while friction of the box turns."""
    return joint.payload_change_rad_s2 + turned_nm(joint) * joint.mobility_per_kg_m2[1]


def current_limit_a(joint: JointNominal) -> float:
    """How far measured and commanded current may differ."""
    noise = CURRENT_SIGMAS * joint.current.noise if joint.current else 0.0
    return max(CURRENT_SHARE * joint.max_current_a, noise)


def moving_current_a(joint: JointNominal, current_a: float) -> float:
    """A current that makes half of a visible speed in the time in which that has to be noticed: then the arm tells."""
    per_ampere_rad_s2 = joint.torque_per_ampere * joint.mobility_per_kg_m2[1]
    moving = 0.5 * VISIBLE_SHARE * joint.fastest_rad_s / (VISIBLE_S * per_ampere_rad_s2)
    noise = CURRENT_SIGMAS * joint.current.noise if joint.current else 0.0
    return min(current_a, max(moving, noise))


def flutter_limit_a(joint: JointNominal, current_a: float) -> float:
    """How much the difference of the currents may change from one reading to the next, on average over four."""
    noise = FLUTTER_SIGMAS * joint.current.noise if joint.current else 0.0
    return max(FLUTTER_SHARE * current_a, noise)


def following_unit_rad(joint: JointNominal, position_grain: float) -> float:
    """The unit of laws' normal following errors: a grain, or a share of a loop's sag under a wrong payload or friction.

    A loop is as stiff in any pose, so friction is seen by the greatest inertia.
    """
    sag = joint.payload_rad_s2 / JUDGED_AT_RAD_S**2
    rubbed = turned_nm(joint) * joint.mobility_per_kg_m2[0] / JUDGED_AT_RAD_S**2
    return max(position_grain, 2.0 * SAG_SHARE * sag, SAG_SHARE * rubbed)


def _chosen(override_lsb: float | None, step: float, derived: float) -> float:
    return derived if override_lsb is None else override_lsb * step


def unmodelled_rad_s2(joint: JointNominal) -> float:
    """Error of a right model: a payload, and Coulomb friction that changes its sign, both of the box."""
    return joint.payload_rad_s2 + turned_nm(joint) * joint.mobility_per_kg_m2[1]


def range_margin_rad(position: SensorNominal, limits: Supervision) -> float:
    """How far beyond its stops a joint may be measured."""
    if limits.range_margin_deg is not None:
        return math.radians(limits.range_margin_deg)
    return MARGIN_RAD + MARGIN_SIGMAS * position.noise


def range_rad(joint: Joint, position: SensorNominal, limits: Supervision) -> tuple[float, float]:
    """Where a joint may be measured: between its stops and a little beyond. Also where a run may begin."""
    margin = range_margin_rad(position, limits)
    low, high = joint.limits_deg
    return math.radians(low) - margin, math.radians(high) + margin


def longest_step_rad(position: SensorNominal, fastest: float, limits: Supervision, period_s: float) -> float:
    """A step per cycle that is impossible at up to `fastest` rad/s."""
    if limits.max_position_step_deg is not None:
        return math.radians(limits.max_position_step_deg)
    return STEP_SPEEDS * fastest * period_s + STEP_SIGMAS * position.noise


def missing_cycles(limits: Supervision, period_s: float) -> int:
    """Number of cycles in a row without all inputs after which the run stops."""
    return limits.missing_cycles or max(round(MISSING_S / period_s), LEAST_MISSING)


def silent_cycles(limits: Supervision, period_s: float) -> int:
    """Number of cycles in a row in which a card is silent and others are not, after which the run stops."""
    return min(max(round(SILENT_S / period_s), LEAST_MISSING), missing_cycles(limits, period_s))
