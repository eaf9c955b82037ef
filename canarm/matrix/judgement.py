"""Judges the outcome of a fault: every definition of the matrix in one place, each with its sentence.

Evidence in, findings out; nothing is run or printed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from canarm_controller.supervision.detection import Reaction
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.sensing import position_steps_rad

from .evidence import SENSORS, Evidence, Floats, Ints, Motion, Notice
from .safety import FTTI_S, GROWTH_RAD_S, SAFE_CURRENT_A, SAFE_SPEED_RAD_S, Bools, Safety, safety

DETECTION_S = 0.025
"""A fault must be detected within this time from the clock's start."""
POTENTIOMETER_FLOOR_LSB = 3.0
TACHOMETER_FLOOR = 0.05
CURRENT_FLOOR = 0.1
"""Floors of the sensors, the last two as shares of full scale: a smaller error is no finding."""
TOLERATED_LSB = 3.0
"""A fault is tolerated while the true angle stays within this many steps of the reference."""
_EXACT = 1.0 + 1e-9
_REACTIONS = [reaction.value for reaction in Reaction]

DEFINITIONS = (
    (
        "true residual",
        "(a) what the controller last received for a sensor, against the true value between this SYNC and the next; "
        "(b) true angle, speed and current against the twin: the fault-free run of the same scenario, same cycle.",
    ),
    (
        "clock of a detection",
        "Starts at the first cycle in which a true residual passes its floor: "
        f"{POTENTIOMETER_FLOOR_LSB:g} LSB of the potentiometer, {TACHOMETER_FLOOR:.0%} of full scale of the "
        f"tachometer, {CURRENT_FLOOR:.0%} of full scale of the current.",
    ),
    (
        "tolerated",
        f"The controller goes on, and the true angle stays within {TOLERATED_LSB:g} LSB of the potentiometer from the "
        "reference, or from where the twin is (a law that errs without any fault errs with it), from the injection to "
        "the end. A stop ends the reference: what it follows is not tolerated.",
    ),
    (
        "detected",
        "Latency is from the clock's start to the first detection; one that comes earlier counts as 0. It passes up to "
        f"{DETECTION_S * 1e3:g} ms; else the verdict is late, and without any detection MISSED.",
    ),
    ("undetectable", "Neither tolerated nor detected in time, and declared so, with the reason."),
    (
        "dangerous",
        "Declared so (torque that nobody asked for, a wrong direction, a broken wire), or something is told wrongly "
        "(sensors, codes of inputs, messages, nodes, time) and the true angle leaves the twin's by more than its floor "
        "before the controller begins to stop. Torque that is lost, and what a load, friction or a hit does to the "
        "arm, is not the drive's doing.",
    ),
    (
        "safe",
        "Torque off (no amplifier is asked for current), hold (standstill after the controller has begun to stop) or, "
        f"before that, tracking (within {TOLERATED_LSB:g} LSB of the reference or of the twin); |current| at most "
        f"{SAFE_CURRENT_A:g} A throughout. After a dangerous fault an arm may be in none of these for "
        f"{FTTI_S * 1e3:g} ms, the FTTI, from "
        "the first such cycle after the clock's start to the last one. Until then no joint becomes faster by more than "
        f"{GROWTH_RAD_S:g} rad/s than it was when the fault began, or than the twin is; once torque is off no drive "
        "puts energy into the arm, but for what its winding still holds. How fast an arm falls then is gravity's: "
        f"told, not judged. A joint that has a brake is never faster than {SAFE_SPEED_RAD_S:g} rad/s from the clock's "
        "start on, whatever the fault. An object that two robots carry is lost by no hand, whatever the fault, also "
        "after a stop, until the cards' own protection has acted: no force on it passes the hands' slip_force_n.",
    ),
    (
        "peaks",
        "Of the worst joint, since the injection. The error's ends with the reference; speed includes the fall of an "
        "arm whose torque has been switched off.",
    ),
)
"""Every definition as text, for reports."""


class Verdict(StrEnum):
    """The verdict on a cell of the matrix, from good to bad."""

    TOLERATED = "tolerated"
    BOTH = "tolerated+detected"
    DETECTED = "detected"
    UNDETECTABLE = "undetectable"
    LATE = "late"
    MISSED = "MISSED"
    BROKEN = "BROKEN"
    """The run itself failed: a defect of the bench, not a finding."""

    @property
    def passes(self) -> bool:
        """Whether the cell is as it should be."""
        return self not in (Verdict.LATE, Verdict.MISSED, Verdict.BROKEN)


@dataclass(frozen=True, slots=True)
class Findings:
    """The findings from the evidence of one run. Times in s; None where not applicable.

    `clock_s` is from injection to the clock's start, `latency_s` from there to the first detection, `safe_s` from there
    to the safe state. `safe_by` is "off", "hold" or "tracking". Peaks are those since the injection, of the worst
    joint; that of the error only while a reference runs. `astray_lsb` is as the error, from reference or twin,
    whichever is nearer.
    """

    verdict: Verdict
    first: Notice | None
    reaction: str
    clock_s: float | None
    latency_s: float | None
    drives_arm: bool
    safety: Safety
    is_safe: bool
    peak_error_lsb: float | None
    peak_current_a: float
    peak_speed_rad_s: float
    is_running: bool
    astray_lsb: float | None = None
    grip_n: float | None = None
    lost_by: tuple[str, ...] = ()
    """Hands that have lost the object, and should not have."""


def judge(
    cell: Cell, run: Evidence, twin: Evidence, is_dangerous: bool, may_mislead: bool = True, lets_go: bool = False
) -> Findings:
    """Judge a run against its fault-free `twin`, of the same scenario; `is_dangerous` as the fault is declared.

    The fault counts as dangerous if it is declared so, or if it `may_mislead` controller or drives and moves the
    arm away from the twin by more than the potentiometer's floor before the controller begins to stop. A dangerous
    fault that passes its floor and is not tolerated has to end in a safe state. An object that the twin holds is held
    whatever the fault, unless that itself `lets_go`.
    """
    motion, steps_rad = run.motion, _steps_rad(cell)
    since = motion.cycle >= run.injected_cycle
    departure = true_departure(cell, motion, twin.motion)
    passed = since & (sensor_error(cell, run) | departure[0] | departure[1])
    clock = int(np.argmax(passed)) if passed.any() else None
    error_lsb = np.abs(motion.angle_rad - _reference_rad(motion, twin.motion)) / steps_rad
    astray_lsb = _astray_lsb(motion, twin.motion, error_lsb, steps_rad)
    is_tolerated = run.is_running and bool((astray_lsb[since] <= TOLERATED_LSB).all())
    notices = [each for each in run.notices if each.cycle >= run.injected_cycle]
    first = notices[0] if notices else None
    latency_s = None if first is None else _latency_s(cell, motion, clock, first)
    stop = _stop_cycle(notices)
    has_reference = since if stop is None else since & (motion.cycle <= stop)
    drives_arm = is_dangerous or (may_mislead and bool((has_reference & departure[0]).any()))
    lost_by = () if lets_go else tuple(hand for hand in run.lost_by if hand not in twin.lost_by)
    found = Safety() if clock is None else _safety(cell, run, twin.motion, clock, stop, astray_lsb)
    told = has_reference & _all(np.isfinite(error_lsb))
    error_lsb, astray_lsb = error_lsb[told], astray_lsb[told]
    return Findings(
        verdict=_verdict(is_tolerated, latency_s),
        first=first,
        reaction=max((each.reaction for each in notices), key=_strictness, default=""),
        clock_s=None if clock is None else _elapsed_s(motion, run.injected_cycle, clock),
        latency_s=latency_s,
        drives_arm=drives_arm,
        safety=found,
        is_safe=not lost_by and (found.is_safe or (found.is_slow_enough and (is_tolerated or not drives_arm))),
        peak_error_lsb=float(error_lsb.max()) if error_lsb.size else None,
        astray_lsb=float(astray_lsb.max()) if astray_lsb.size else None,
        peak_current_a=float(np.abs(motion.current_a[since]).max(initial=0.0)),
        peak_speed_rad_s=float(np.abs(motion.speed_rad_s[since]).max(initial=0.0)),
        is_running=run.is_running,
        grip_n=run.grip_n,
        lost_by=lost_by,
    )


def sensor_error(cell: Cell, run: Evidence) -> Bools:
    """In which cycles a sensor's value at the controller is off the truth by more than its floor; shape (n,).

    "True residual (a): what the controller last received for that sensor against the true value." A sample is taken at
    some time between two SYNCs, so the truth is the range from this SYNC's value to the next one's. The current sense
    sees magnitudes.
    """
    motion, is_wrong = run.motion, np.zeros(len(run.motion.cycle), dtype=np.bool_)
    truths = (motion.angle_rad, motion.speed_rad_s, motion.current_a)
    for quantity, truth, floor in zip(SENSORS, truths, _floors(cell), strict=True):
        following = np.append(truth[1:], truth[-1:], axis=0)
        low, high = np.minimum(truth, following), np.maximum(truth, following)
        if quantity is Quantity.CURRENT:
            turns = (low < 0.0) & (high > 0.0)
            low, high = np.where(turns, 0.0, np.minimum(abs(low), abs(high))), np.maximum(abs(low), abs(high))
        seen = run.seen[quantity]
        is_wrong |= ((seen > high + floor) | (seen < low - floor)).any(axis=1)
    return is_wrong


def true_departure(cell: Cell, motion: Motion, twin: Motion) -> tuple[Bools, Bools]:
    """In which cycles the true angle, and the true speed or current, leave the twin's by the floor; (n,) each.

    "True residual (b): true angle, speed and current against the fault-free run of the same scenario, same cycle."
    """
    is_paced, rows = np.append(True, np.diff(motion.cycle) > 0) & _has_twin(motion, twin), _rows(motion, twin)
    pairs = (
        (motion.angle_rad, twin.angle_rad),
        (motion.speed_rad_s, twin.speed_rad_s),
        (motion.current_a, twin.current_a),
    )
    angle, speed, current = (
        is_paced & (np.abs(mine - its[rows]) > floor).any(axis=1)
        for (mine, its), floor in zip(pairs, _floors(cell), strict=True)
    )
    return angle, speed | current


def _reference_rad(motion: Motion, twin: Motion) -> Floats:
    """The controller's reference; if it reports none, the true angle of its fault-free run."""
    if np.isfinite(motion.reference_rad).any():
        return motion.reference_rad
    return np.where(_has_twin(motion, twin)[:, np.newaxis], twin.angle_rad[_rows(motion, twin)], np.nan)


def _astray_lsb(motion: Motion, twin: Motion, error_lsb: Floats, steps_rad: Floats) -> Floats:
    """How far the true angle is from the reference or from the twin, whichever is nearer; NaN without a reference."""
    from_twin_lsb = np.abs(motion.angle_rad - twin.angle_rad[_rows(motion, twin)]) / steps_rad
    return np.where(_has_twin(motion, twin)[:, np.newaxis], np.minimum(error_lsb, from_twin_lsb), error_lsb)


def _has_twin(motion: Motion, twin: Motion) -> Bools:
    """Which rows of `motion` belong to cycles that the twin also has."""
    return np.asarray(motion.cycle <= twin.cycle[-1])


def _rows(motion: Motion, twin: Motion) -> Ints:
    """The twin's row for the same cycle; after its end, its last row."""
    return np.asarray(np.searchsorted(twin.cycle, np.minimum(motion.cycle, twin.cycle[-1])))


def _verdict(is_tolerated: bool, latency_s: float | None) -> Verdict:
    """The run's own verdict: "latency = detection - clock start, passes if <= 25 ms; both may hold"."""
    is_in_time = latency_s is not None and latency_s <= DETECTION_S * _EXACT
    if is_tolerated:
        return Verdict.BOTH if latency_s is not None else Verdict.TOLERATED
    if is_in_time:
        return Verdict.DETECTED
    return Verdict.MISSED if latency_s is None else Verdict.LATE


def _latency_s(cell: Cell, motion: Motion, clock: int | None, first: Notice) -> float:
    """A detection before the clock's start, or without one, counts as 0."""
    return 0.0 if clock is None else max(first.cycle - int(motion.cycle[clock]), 0) * cell.bus.cycle_s


def _safety(cell: Cell, run: Evidence, twin: Motion, clock: int, stop: int | None, astray_lsb: Floats) -> Safety:
    """Whether the run is safe in time.

    A hold is a standstill (all speeds below the tachometer's floor) after the controller has begun to stop. Until then
    being within 3 LSB of the reference or of the twin counts as well.
    """
    motion = run.motion
    is_stopping = np.zeros(len(motion.cycle), dtype=np.bool_) if stop is None else motion.cycle >= stop
    holding = _all(np.abs(motion.speed_rad_s) <= _floors(cell)[1]) & is_stopping
    tracking = _all(astray_lsb <= TOLERATED_LSB) & ~is_stopping
    injected = int(np.searchsorted(motion.cycle, run.injected_cycle))
    twin_rad_s = np.where(_has_twin(motion, twin)[:, np.newaxis], twin.speed_rad_s[_rows(motion, twin)], 0.0)
    return safety(cell, motion, twin_rad_s, injected, clock, holding, tracking)


def _stop_cycle(notices: Sequence[Notice]) -> int | None:
    """The cycle in which the controller begins to stop."""
    return min((each.cycle for each in notices if each.stops), default=None)


def _all(condition: Bools) -> Bools:
    """Whether `condition` holds for every joint; (n, joints) to (n,)."""
    return np.asarray(condition.all(axis=1))


def _floors(cell: Cell) -> tuple[Floats, Floats, Floats]:
    """Floors of angle, speed and current, each (joints,): 3 LSB, 5 % and 10 % of full scale."""
    return (
        POTENTIOMETER_FLOOR_LSB * _steps_rad(cell),
        np.array([TACHOMETER_FLOOR * joint.fastest_rad_s for joint in cell.joints]),
        np.array([CURRENT_FLOOR * joint.drive.max_current_a for joint in cell.joints]),
    )


def _steps_rad(cell: Cell) -> Floats:
    return np.array(position_steps_rad(cell))


def _elapsed_s(motion: Motion, cycle: int, row: int) -> float:
    return float(motion.time_s[row] - motion.time_s[np.searchsorted(motion.cycle, cycle)])


def _strictness(reaction: str) -> int:
    return _REACTIONS.index(reaction) if reaction in _REACTIONS else len(_REACTIONS)
