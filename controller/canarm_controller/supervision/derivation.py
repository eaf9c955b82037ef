"""The detectors of a cell as text: for each joint its detectors with limit, unit and the limit's derivation.

Owns the text; the arithmetic is in `thresholds`, the detectors' meanings are in `detection`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from canarm_protocol.cell.model import SENSOR_KINDS, Cell, Quantity, Supervision
from canarm_protocol.cell.sensing import joint_sensors

from ..dynamics import Arm, ClosedChain, SeveralArms, cell_arm
from . import thresholds as limit
from . import uncertainty as box
from .detection import DETECTORS, named_for
from .following import NORMAL_FACTOR
from .grip_watch import FIRST_S, OBJECT_LOST, SURE, TAKEN_UP_S, TIMES, UNSURE, grip_limits
from .nominal import JointNominal, joint_nominals, sensor_nominal
from .overdue import HELD_SHARE, SURE_SHARE, is_counted
from .reach import Reach
from .sensor_less import BLIND_FACTOR, PERSISTENT_CYCLES
from .tachless import STUCK_FACTOR, UNLEARNED_SHARE, least_travel_rad, sudden_rad
from .thresholds import Thresholds, cell_thresholds
from .timing import Timing

NAME_WIDTH, LIMIT_WIDTH = 24, 26
NO_TACHOMETER, NO_SENSE = "no tachometer", "no current sense"


@dataclass(frozen=True, slots=True)
class Row:
    """One detector at one joint; if it does not apply, `limit` is empty and `why` tells the reason."""

    detector: str
    limit: str
    why: str

    def __str__(self) -> str:
        return f"  {self.detector:<{NAME_WIDTH}} {self.limit or 'does not apply':<{LIMIT_WIDTH}} {self.why}"


def detector_lines(cell: Cell) -> Iterator[str]:
    """The output of `canarm check --detectors`. Raises `DynamicsError` for an arm without a model."""
    timing, limits = Timing.of(cell.bus.cycle_s), cell.supervision
    arm = cell_arm(cell.laden, cell.joint_names)
    parts: tuple[Arm, ...] = tuple(arm.parts) if isinstance(arm, SeveralArms) else (arm,)
    nominals = joint_nominals(cell, parts)
    missing = limit.missing_cycles(limits, timing.period_s)
    yield f"cycle {1e3 * timing.period_s:g} ms; {missing} cycles without inputs in a row stop the run"
    yield from _box_lines()
    rows = zip(nominals, cell_thresholds(nominals, limits, timing), cell.joints, joint_sensors(cell), strict=True)
    for nominal, derived, joint, sensors in rows:
        yield ""
        yield from _grain_lines(nominal, derived, timing)
        position = sensor_nominal(sensors.position)
        margin = limit.range_margin_rad(position, limits)
        step = limit.longest_step_rad(position, joint.fastest_rad_s, limits, timing.period_s)
        reach = Reach.of(nominal, joint)
        for row in (*_range_rows(margin, step, limits, reach), *joint_rows(nominal, derived, limits, timing, reach)):
            yield str(row)
    yield from _grip_lines(cell, nominals)
    yield ""
    named = {row.detector for row in joint_rows(nominals[0], derived, limits, timing, reach)}
    of_a_joint = (
        "impossible",
        *(f"{kind.kind}-" for kind in SENSOR_KINDS.values() if kind.quantity is Quantity.POSITION),
    )
    others = [name for name in DETECTORS if name not in {*named, OBJECT_LOST} and not name.startswith(of_a_joint)]
    yield f"without a limit of a joint: {', '.join(others)}"


def _grip_lines(cell: Cell, nominals: Sequence[JointNominal]) -> Iterator[str]:
    chain, carried = ClosedChain.of(cell), cell.object
    yield ""
    if chain is None or carried is None:
        yield str(Row(OBJECT_LOST, "", "no object"))
        return
    limits = grip_limits(cell, chain, nominals)
    yield f"object, in the hands of {carried.master} and {carried.slave}:"
    why = (
        f"that the hands move against each other: {SURE:g} x the {1e3 * limits.reading:.3g} mm by which all readings "
        f"at once may be off; {UNSURE:g} x that in the first {FIRST_S:g} s, and in the first {TAKEN_UP_S:g} s "
        f"{1e3 * limits.twist:.3g} mm more, the softest wires' twist"
    )
    yield str(Row(OBJECT_LOST, f"{1e3 * limits.sure:.3g} mm, {TIMES} looks", why))


def _box_lines() -> Iterator[str]:
    light, heavy = box.PAYLOAD
    yield (
        f"no whole robot is accused: payload {light:+.0%} to {heavy:+.0%} of the last link, Coulomb friction "
        f"{_times(box.COULOMB)}, viscous {_times(box.VISCOUS)},"
    )
    yield (
        f"  torque constant {_times(box.TORQUE_CONSTANT)}, noise {_times(box.NOISE)}, potentiometers off by "
        f"{box.OFFSET_DEG:g} deg, drive wires rigid or elastic, {_times(box.WIRE)} as stiff as the cell says"
    )


def joint_rows(
    nominal: JointNominal, derived: Thresholds, limits: Supervision, timing: Timing, reach: Reach
) -> list[Row]:
    """The detectors of one joint that have a limit."""
    rows = [
        *_position_rows(nominal, derived, limits, timing, reach),
        *_speed_rows(nominal, derived, limits, reach),
        *_current_rows(nominal, derived, limits, reach),
        *_arm_rows(nominal, derived, limits, timing, reach),
    ]
    sensor = nominal.position.title
    return [Row(named_for(sensor, row.detector), row.limit, named_for(sensor, row.why)) for row in rows]


def _grain_lines(nominal: JointNominal, derived: Thresholds, timing: Timing) -> Iterator[str]:
    position, speed = nominal.position, nominal.speed
    yield f"{nominal.name}:"
    integral = limit.INTEGRAL_GRAINS * limit.integral_error_rad(nominal, timing)
    yield (
        f"  grain of angle {_deg(derived.position_grain)}: {position.title} {position.noise_lsb:.2f} LSB of "
        f"{_deg(position.step)} makes {_deg(position.noise / limit.REFERENCE_NOISE)}, "
        f"the integrated tachometer {_deg(integral)}, twist of the wire {_deg(limit.unlearned_twist_rad(nominal))}, "
        f"a tenth of a cycle {_deg(limit.timing_error_rad(nominal, timing))}"
    )
    noise = limit.speed_noise_rad_s(nominal, timing)
    source = f"{speed.title} {speed.noise_lsb:.2f} LSB of {speed.step:.3g} rad/s" if speed else "observer of the angle"
    yield (
        f"  grain of speed {derived.speed_grain:.3g} rad/s: {source} makes {noise / limit.REFERENCE_NOISE:.3g}, "
        f"the payload that turns {limit.payload_speed_rad_s(nominal, timing):.3g}, "
        f"friction that turns {limit.friction_speed_rad_s(nominal, timing):.3g}"
    )


def _range_rows(margin: float, step: float, limits: Supervision, reach: Reach) -> Iterator[Row]:
    sigmas, speeds = limit.MARGIN_SIGMAS, limit.STEP_SPEEDS
    why = f"{_deg(limit.MARGIN_RAD)} and {sigmas:g} deviations of a reading, beyond the stops"
    yield Row("impossible-position", _deg(margin), _source("range_margin_deg", limits.range_margin_deg, why))
    why = f"{speeds:g} times the fastest motion of a cycle and {limit.STEP_SIGMAS:g} deviations of a reading"
    yield Row(
        "impossible-motion",
        _deg(step),
        _source("max_position_step_deg", limits.max_position_step_deg, why) + reach.beyond_travel(step),
    )


def _position_rows(
    nominal: JointNominal, derived: Thresholds, limits: Supervision, timing: Timing, reach: Reach
) -> Iterator[Row]:
    has_tachometer = nominal.speed is not None
    factor = 1.0 if has_tachometer else BLIND_FACTOR
    against = "the integrated tachometer" if has_tachometer else f"the model, {factor:g} times the limit"
    jump = _source("position_jump_lsb", limits.position_jump_lsb, f"{limit.POSITION_JUMP:g} grains, from {against}")
    if not has_tachometer:
        jump += f"; or {_deg(sudden_rad(nominal, timing.period_s))} in a cycle, that stay for as many"
    shown = f"{_deg(factor * derived.jump)}, {PERSISTENT_CYCLES} cycles"
    too_far = reach.beyond_travel(factor * derived.jump)
    yield Row("potentiometer-jump", shown, jump + too_far)
    if nominal.position.end_codes:
        yield Row("potentiometer-range", shown, f"the same, at code {_ends(nominal.position.end_codes)}{too_far}")
    yield Row("potentiometer-spike", _deg(factor * derived.jump), f"the same, for fewer cycles{too_far}")
    stuck = f"{limit.STUCK_TRAVEL:g} grains that the tachometer turns while the code stands"
    if not has_tachometer:
        least = STUCK_FACTOR * least_travel_rad(nominal)
        stuck = f"{STUCK_FACTOR:g} x {limit.STUCK_TRAVEL:g} grains that the model turns while the code stands, and "
        stuck += f"{UNLEARNED_SHARE * limit.unmodelled_rad_s2(nominal):.3g} rad/s2 that it may lack; down to "
        stuck += f"{_deg(least)} at low speeds, after readings that the model has foreseen"
        if is_counted(nominal):
            friction_rad_s2 = nominal.coulomb_nm * nominal.mobility_per_kg_m2[1]
            stuck += f"; or a count so late that {SURE_SHARE * friction_rad_s2:.3g} rad/s2 would have to be lacking, "
            stuck += (
                f"or not there while {HELD_SHARE * friction_rad_s2:.3g} are (less in poses and grips of less mobility)"
            )
    travel = derived.stuck_travel if has_tachometer else STUCK_FACTOR * derived.stuck_travel
    yield Row("potentiometer-stuck", _deg(travel), stuck + reach.beyond_travel(travel))
    drift = f"{limit.POSITION_DRIFT:g} grains, filtered over 16 readings"
    drift = _source("position_drift_lsb", limits.position_drift_lsb, drift)
    if has_tachometer:
        drift += (
            f"; {_deg(derived.twist)} more in the first 2 s: {nominal.weight_nm:.3g} N m and {nominal.payload_nm:.3g} "
        )
        drift += f"of payload on {box.WIRE[0] * nominal.wire_stiffness_nm_rad:.3g} N m/rad, until the wire is learned"
    for name in ("potentiometer-mismatch", "tachometer-mismatch", "drive-broken"):
        yield Row(name, _deg(derived.drift), drift) if has_tachometer else Row(name, "", NO_TACHOMETER)
        drift = f"the same, after {'a doubtful speed' if 'pot' in name else 'an unexpected acceleration'}"


def _speed_rows(nominal: JointNominal, derived: Thresholds, limits: Supervision, reach: Reach) -> Iterator[Row]:
    speed = nominal.speed
    if speed is None:
        for name in ("jump", "range", "spike", "stuck"):
            yield Row(f"tachometer-{name}", "", NO_TACHOMETER)
        for name in ("sensor-noise", "overspeed", "both-sensors"):
            yield Row(name, "", NO_TACHOMETER)
        return
    jump = _source("speed_jump_lsb", limits.speed_jump_lsb, f"{limit.SPEED_JUMP:g} grains from the model")
    too_fast = reach.beyond_tachometer(derived.step)
    yield Row("tachometer-jump", _rad_s(derived.step), f"{jump}, and the angle does not follow{too_fast}")
    yield Row("tachometer-spike", _rad_s(derived.step), f"the same, and gone before that is decided{too_fast}")
    if speed.end_codes:
        yield Row("tachometer-range", _rad_s(derived.step), f"the same, at code {_ends(speed.end_codes)}{too_fast}")
        why = f"its end, after an unexpected acceleration{reach.beyond_supply(nominal.fastest_rad_s)}"
        yield Row("overspeed", _rad_s(nominal.fastest_rad_s), why)
    stuck = (
        f"{limit.STUCK_SPEED:g} grains that the model's speed changes while the code stands; payload that turns makes "
    )
    stuck += f"up to {_rad_s(derived.stuck_drift * 0.05 * (0.025 + 2.0 / limit.BANDWIDTH_RAD_S))} of it in 50 ms, "
    stuck += f"friction that has just turned {_rad_s(0.05 * derived.stuck_turned)}"
    yield Row("tachometer-stuck", _rad_s(derived.stuck_speed), stuck + reach.beyond_tachometer(derived.stuck_speed))
    yield Row("sensor-noise", _rad_s(derived.doubt), "off one way, then the other; or three spikes")
    both = BLIND_FACTOR * derived.jump
    yield Row("both-sensors", _deg(both), f"{BLIND_FACTOR:g} times the limit of a jump{reach.beyond_travel(both)}")


def _current_rows(nominal: JointNominal, derived: Thresholds, limits: Supervision, reach: Reach) -> Iterator[Row]:
    names = "current-mismatch", "current-sense-mismatch", "current-sense-range"
    if nominal.current is None:
        yield from (Row(name, "", NO_SENSE) for name in names)
        return
    why = (
        f"{100 * limit.CURRENT_SHARE:g} % of {nominal.max_current_a:g} A, at least {limit.CURRENT_SIGMAS:g} deviations"
    )
    why = _source("current_mismatch_a", limits.current_mismatch_a, why)
    if derived.moving_current < derived.current:
        visible = f"{100 * limit.VISIBLE_SHARE:g} % of the fastest speed within {1e3 * limit.VISIBLE_S:g} ms"
        why += f"; from {_ampere(derived.moving_current)} on, half of what makes {visible}, if the arm goes with it"
    for name in names:
        yield Row(name, _ampere(derived.current), why + reach.beyond_amplifier(derived.current))
        why = "the same, and the arm does not care"


def _arm_rows(
    nominal: JointNominal, derived: Thresholds, limits: Supervision, timing: Timing, reach: Reach
) -> Iterator[Row]:
    if nominal.speed is None:
        why = f"{limit.LASTING_SHARE_OF_FALL:g} of what the arm's whole weight makes: lasting alone, {NO_TACHOMETER}"
        yield Row("acceleration-mismatch", _rad_s2(derived.lasting), why + reach.beyond_drive(derived.lasting))
        yield Row("wrong-direction", "", NO_TACHOMETER)
    else:
        noise = limit.ACCELERATION_SIGMAS * limit.acceleration_noise_rad_s2(nominal, timing)
        friction = limit.FRICTION_REVERSALS * nominal.coulomb_nm * nominal.mobility_per_kg_m2[1]
        why = f"noise over {1e3 * timing.assessed_s:g} ms {noise:.3g}, friction that turns {friction:.3g}; "
        why = _source("acceleration_mismatch_rad_s2", limits.acceleration_mismatch_rad_s2, why)
        turned = derived.turned_nm * nominal.mobility_per_kg_m2[1]
        turned_why = f"+{turned:.3g} where it has just turned: {limit.COULOMB_TURN:.3g} x {nominal.coulomb_nm:.3g} N m"
        turned_why += f"; +{2.0 / limit.BANDWIDTH_RAD_S * derived.payload:.3g} per rad/s at which the payload turns"
        start = f"at the start, on elastic wires, {derived.start_acceleration:.3g}; lasting, more than any payload: "
        start += f"{derived.lasting:.3g}"
        start += reach.beyond_drive(derived.acceleration) or reach.beyond_drive(derived.lasting, "lasting, ")
        yield Row("acceleration-mismatch", _rad_s2(derived.acceleration), f"{why.rstrip('; ')}; {turned_why}; {start}")
        told = f"commanded at least, of which 1.5 to 2.6 times are missing; sudden {_ampere(derived.sudden_current)}"
        told += reach.beyond_amplifier(derived.told_current) or reach.beyond_amplifier(
            derived.sudden_current, "sudden, "
        )
        yield Row("wrong-direction", _ampere(derived.told_current), told)
    unit = f"{NORMAL_FACTOR:g} x what the law says, in units of {_deg(derived.following_unit)}"
    yield Row("following-error", f"{_deg(NORMAL_FACTOR * derived.following_unit)} x law", unit)
    yield Row(
        "saturation", f"{1e3 * timing.saturated * timing.period_s:g} ms", "at the amplifier's limit, with that error"
    )


def _source(key: str, value: float | None, derived: str) -> str:
    return derived if value is None else f"{key} = {value:g} of the cell; else {derived}"


def _times(factors: tuple[float, float]) -> str:
    return f"x{factors[0]:.2g} to x{factors[1]:.2g}"


def _ends(codes: tuple[int, ...]) -> str:
    return " or ".join(map(str, codes))


def _deg(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.3g} deg"


def _rad_s(speed_rad_s: float) -> str:
    return f"{speed_rad_s:.3g} rad/s"


def _rad_s2(acceleration_rad_s2: float) -> str:
    return f"{acceleration_rad_s2:.3g} rad/s2"


def _ampere(current_a: float) -> str:
    return f"{1e3 * current_a:.3g} mA" if current_a < 1.0 else f"{current_a:.3g} A"
