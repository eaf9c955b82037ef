"""How a cell's numbers must relate so that a sound robot runs without a false alarm, by arithmetic.

It needs the arm's model, so that it is no part of the schema. What only a run can show, `rehearsal.py` finds.
"""

import math
from collections.abc import Iterator

from canarm_controller.dynamics import Arm, ClosedChain, SeveralArms, cell_arm
from canarm_controller.reference.carried_motion import LOOSE_M
from canarm_controller.supervision import thresholds as limit
from canarm_controller.supervision.nominal import JointNominal, joint_nominals, sensor_nominal
from canarm_controller.supervision.timing import Timing
from canarm_protocol.cell.brakes import SpringBrake
from canarm_protocol.cell.model import Cell, Joint
from canarm_protocol.cell.sensing import joint_sensors

from .carrying_values import carrying_problems

CROSSOVER = 2.4
"""Gain crossover frequency of a joint's loop over its natural frequency: delay costs phase there."""
PHASE_MARGIN_RAD, PHASE_SHARE = 1.3, 0.75
"""Phase margin of the loop without lag, and the share that lag may take: the rest damps the loop."""
LATE_CYCLES = 2.0
"""Average delay from a reading to its command, which acts from the next SYNC to the one after."""
STEP_SHARE = 1.0
"""How far one step of the position sensor may move the command, as a share of the highest current: beyond, noise alone
drives the amplifier from one end to the other."""
SENSE_SHARE = 0.5
"""Highest current that the sense may miss, as a share of the amplifier's: else it shows no failing current."""
SUPPLY_SHARE = 0.9
"""Share of the supply that holding may take: the rest is for motion."""
MOST_TWIST_RAD = 0.1
"""Most twist of a wire under the arm's weight: the models know no arm that hangs beside its motor's angle."""
POSITION_OCCURS, POSITION_DRIFT_OCCURS, SPEED_OCCURS, SPEED_DRIFT_OCCURS = 2.5, 0.55, 3.3, 1.6
"""In grains: a sound robot's residuals plus a third, see `supervision.thresholds`."""
CURRENT_SIGMAS, ACCELERATION_SIGMAS = 5.0, 2.5
"""Standard deviations that occur in a run: of a sense's noise, and of an acceleration from two readings."""


def unsound(cell: Cell) -> Iterator[str]:
    """A line for each number that is too large or too small beside others: key, value, arithmetic, what would be right.

    Raises `DynamicsError` for an arm that has no model.
    """
    arm, timing = cell_arm(cell.laden, cell.joint_names), Timing.of(cell.bus.cycle_s)
    parts: tuple[Arm, ...] = tuple(arm.parts) if isinstance(arm, SeveralArms) else (arm,)
    nominals = joint_nominals(cell, parts)
    for nominal, joint in zip(nominals, cell.joints, strict=True):
        where = f"joint {nominal.name!r}"
        yield from _drive_problems(where, nominal, joint)
        yield from _wire_problems(where, nominal)
        yield from _sense_problems(where, nominal, joint)
    yield from _gain_problems(cell, arm, nominals, timing)
    yield from _override_problems(cell, nominals, timing)
    yield from _grip_problems(cell)
    yield from carrying_problems(cell)


def _grip_problems(cell: Cell) -> Iterator[str]:
    chain = ClosedChain.of(cell)
    if chain is None or cell.object is None:
        return
    away_m = math.hypot(*chain.gap([math.radians(joint.home_deg) for joint in cell.joints]))
    if away_m > LOOSE_M:
        yield (
            f"object.slave = {cell.object.slave!r}: at home, its hand is {away_m * 1e3:.3g} mm from where it holds the "
            f"object; must be at most {LOOSE_M * 1e3:g} mm: `canarm.cooperation` plans home_deg of both robots"
        )


def _drive_problems(where: str, nominal: JointNominal, joint: Joint) -> Iterator[str]:
    held_nm = nominal.weight_nm + nominal.coulomb_nm
    held_a = held_nm / nominal.torque_per_ampere
    if held_a > nominal.max_current_a:
        yield (
            f"{where}.drive.max_current_a = {nominal.max_current_a:g}: weight and friction of {held_nm:.3g} N m over "
            f"{nominal.torque_per_ampere:.3g} N m/A take {held_a:.3g} A; must be at least that"
        )
        return
    held_v = held_a * nominal.winding_ohm
    if held_v > SUPPLY_SHARE * nominal.supply_v:
        yield (
            f"{where}.drive.supply_v = {nominal.supply_v:g}: the {held_a:.3g} A that hold the arm take {held_v:.3g} V "
            f"in motor.winding_ohm = {nominal.winding_ohm:g}; must be at least {held_v / SUPPLY_SHARE:.3g} V"
        )


def _wire_problems(where: str, nominal: JointNominal) -> Iterator[str]:
    stiffness = nominal.wire_stiffness_nm_rad
    twist_rad = nominal.weight_nm / stiffness
    if twist_rad > MOST_TWIST_RAD:
        yield (
            f"{where}.motor.wire_stiffness_nm_rad = {stiffness:g}: the weight of {nominal.weight_nm:.3g} N m in the "
            f"worst pose would twist an elastic wire by {math.degrees(twist_rad):.3g} degrees; must be at least "
            f"{nominal.weight_nm / MOST_TWIST_RAD:.3g}"
        )


def weak_brakes(cell: Cell) -> Iterator[str]:
    """A line for each spring brake that the arm's weight turns in its worst pose: key, value, arithmetic.

    Raises `DynamicsError` for an arm that has no model.
    """
    arm = cell_arm(cell.laden, cell.joint_names)
    parts: tuple[Arm, ...] = tuple(arm.parts) if isinstance(arm, SeveralArms) else (arm,)
    for nominal, joint in zip(joint_nominals(cell, parts), cell.joints, strict=True):
        brake = joint.brake
        if not isinstance(brake, SpringBrake):
            continue
        own_nm = nominal.torque_per_ampere * nominal.max_current_a
        torque_nm = own_nm if brake.torque_nm is None else brake.torque_nm
        if torque_nm + nominal.coulomb_nm < nominal.weight_nm:
            assumed = ", what the motor has" if brake.torque_nm is None else ""
            yield (
                f"joint {nominal.name!r}.brake.torque_nm = {torque_nm:.4g}{assumed}: with coulomb_friction_nm = "
                f"{nominal.coulomb_nm:g} it is less than the weight of {nominal.weight_nm:.3g} N m in the worst pose, "
                f"where the joint sinks on its brake; {nominal.weight_nm - nominal.coulomb_nm:.3g} would hold it"
            )


def _sense_problems(where: str, nominal: JointNominal, joint: Joint) -> Iterator[str]:
    sense = joint.sensors.current_sense
    if nominal.current is None or sense is None:
        return
    key = f"{where}.sensors.current_sense.full_scale_a = {sense.full_scale_a:g}"
    if sense.full_scale_a < nominal.max_current_a:
        yield f"{key}: drive.max_current_a = {nominal.max_current_a:g} is beyond it; must be at least that"
    blind_a = limit.CURRENT_SIGMAS * nominal.current.noise
    most_a = SENSE_SHARE * nominal.max_current_a
    if blind_a > most_a:
        yield (
            f"{key}: {limit.CURRENT_SIGMAS:g} deviations of a reading ({nominal.current.noise_lsb:.2g} steps of "
            f"{nominal.current.step:.3g} A) are {blind_a:.3g} A, of drive.max_current_a = {nominal.max_current_a:g}; "
            f"must be at most {sense.full_scale_a * most_a / blind_a:.3g}"
        )


def _gain_problems(cell: Cell, arm: Arm, nominals: tuple[JointNominal, ...], timing: Timing) -> Iterator[str]:
    rows = zip(nominals, arm.effective_inertia, strict=True)
    own_table = {each.name for each in cell.control.joint if each.natural_frequency_rad_s is not None}
    for nominal, inertia in rows:
        omega = cell.control.of_joint(nominal.name).natural_frequency_rad_s
        where = f"control.joint {nominal.name!r}" if nominal.name in own_table else "control"
        most = PHASE_SHARE * PHASE_MARGIN_RAD
        late_s = LATE_CYCLES * timing.period_s + nominal.winding_s
        phase = CROSSOVER * omega * late_s
        if phase > most:
            yield (
                f"{where}.natural_frequency_rad_s = {omega:g}: at joint {nominal.name!r} the loop crosses over at "
                f"{CROSSOVER:g} times as much, where {LATE_CYCLES:g} cycles and motor.winding_mh over winding_ohm, "
                f"{1e3 * late_s:.3g} ms, cost {phase:.3g} rad of phase; must be at most {most:.3g} rad: "
                f"{most / (CROSSOVER * late_s):.3g} rad/s"
            )
        per_step_a = inertia * omega**2 * nominal.position.step / nominal.torque_per_ampere
        most_a = STEP_SHARE * nominal.max_current_a
        if per_step_a > most_a:
            yield (
                f"{where}.natural_frequency_rad_s = {omega:g}: one step of the {nominal.position.title} of joint "
                f"{nominal.name!r}, {math.degrees(nominal.position.step):.3g} deg, moves its command by "
                f"{per_step_a:.3g} A; must be at most {most_a:.3g} A, {STEP_SHARE:g} of drive.max_current_a: "
                f"{omega * math.sqrt(most_a / per_step_a):.3g} rad/s"
            )


def _override_problems(cell: Cell, nominals: tuple[JointNominal, ...], timing: Timing) -> Iterator[str]:
    limits = cell.supervision
    for nominal, joint, sensors in zip(nominals, cell.joints, joint_sensors(cell), strict=True):
        grain = limit.position_grain_rad(nominal, timing) / nominal.position.step
        speed_grain = limit.speed_grain_rad_s(nominal, timing)
        speed_lsb = speed_grain / (nominal.speed.step if nominal.speed else speed_grain)
        sigma = limit.acceleration_noise_rad_s2(nominal, timing)
        step_deg = math.degrees(joint.fastest_rad_s * timing.period_s + 3.0 * sensor_nominal(sensors.position).noise)
        needed = {
            "position_jump_lsb": POSITION_OCCURS * grain,
            "position_drift_lsb": POSITION_DRIFT_OCCURS * grain,
            "speed_jump_lsb": SPEED_OCCURS * speed_lsb,
            "speed_drift_lsb": SPEED_DRIFT_OCCURS * speed_lsb,
            "current_mismatch_a": CURRENT_SIGMAS * nominal.current.noise if nominal.current else 0.0,
            "acceleration_mismatch_rad_s2": ACCELERATION_SIGMAS * sigma,
            "max_position_step_deg": step_deg,
        }
        for key, least in needed.items():
            value = getattr(limits, key)
            if value is not None and value < least:
                yield (
                    f"supervision.{key} = {value:g}: steps and noise of the sensors of joint {nominal.name!r}, and "
                    f"what a sound arm does besides, come to {least:.3g}; must be at least that, or left out"
                )
