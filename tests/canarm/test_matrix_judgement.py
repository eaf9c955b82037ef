"""How the fault matrix judges a run: its definitions on made-up runs, and what is seen of a run on the bus."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from canarm.matrix import foreign_run
from canarm.matrix.bus_reactions import beside_twin, reactions
from canarm.matrix.evidence import SENSORS, Evidence, Motion, Notice, Received, seen_by_controller
from canarm.matrix.foreign_run import require_whole
from canarm.matrix.html_report import as_html
from canarm.matrix.judgement import Findings, Verdict, judge
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.reasons import why
from canarm.matrix.table import Matrix, Row, as_csv
from canarm.matrix.text_report import as_text
from canarm.usage import UsageError
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell, Quantity

CELL: Cell = load_cell("konkuk1", {})
CYCLE_S = 0.0025  # konkuk1.toml
CYCLES, INJECTED = 400, 100
LSB_RAD = np.radians(270.0 / 255)  # PHYSICS: 270 degrees on 8 bits, 1 LSB = 1.059 degrees


def a_run(notices: tuple[Notice, ...] = (), is_running: bool = True) -> Evidence:
    """Both joints rest at 0 under no current, the reference with them, and the sensors say so."""
    still = [np.zeros((CYCLES, 2)) for _ in range(6)]
    cycle = np.arange(CYCLES)
    motion = Motion(cycle, cycle * CYCLE_S, *still)
    return Evidence(motion, {sensor: np.zeros((CYCLES, 2)) for sensor in SENSORS}, notices, INJECTED, is_running)


def noticed(cycle: int, stops: bool = False) -> Notice:
    return Notice("some-detector", "joint2", cycle, "safe-stop-off" if stops else "degraded", stops)


def judged(evidence: Evidence, is_dangerous: bool = False) -> Findings:
    return judge(CELL, evidence, a_run(), is_dangerous)


@pytest.mark.parametrize(
    ("sensor", "floor"),
    [
        (Quantity.POSITION, 3 * LSB_RAD),
        (Quantity.VELOCITY, 0.125),  # 5 % of 2.5 rad/s
        (Quantity.CURRENT, 0.15),  # 10 % of 1.5 A
    ],
)
def test_the_clock_starts_when_a_sensor_is_off_by_more_than_its_floor(sensor: Quantity, floor: float) -> None:
    wrong = a_run((noticed(160),))
    wrong.seen[sensor][120:, 1] = 0.99 * floor
    assert judged(wrong).clock_s is None
    wrong.seen[sensor][150:, 1] = 1.01 * floor
    found = judged(wrong)
    assert found.clock_s == pytest.approx(50 * CYCLE_S)
    assert found.latency_s == pytest.approx(10 * CYCLE_S)


@pytest.mark.parametrize(("signal", "floor"), [("angle_rad", 3 * LSB_RAD), ("speed_rad_s", 0.125), ("current_a", 0.15)])
def test_the_clock_starts_when_the_truth_leaves_the_twin(signal: str, floor: float) -> None:
    departed = a_run()
    for sensor, true in zip(SENSORS, ("angle_rad", "speed_rad_s", "current_a"), strict=True):
        departed.seen[sensor][:] = getattr(departed.motion, true)
    getattr(departed.motion, signal)[130:, 0] = 0.99 * floor
    assert judged(departed).clock_s is None
    getattr(departed.motion, signal)[140:, 0] = 1.01 * floor
    assert judged(departed).clock_s == pytest.approx(40 * CYCLE_S)


def test_a_sample_taken_between_two_syncs_may_have_any_value_between_theirs() -> None:
    stepping = a_run()
    stepping.motion.current_a[150:, 0] = -1.0
    stepping.seen[Quantity.CURRENT][149:, 0] = 0.6  # magnitude, on the way from 0 to 1 A
    stepping.seen[Quantity.CURRENT][150:, 0] = 1.0
    twin = dataclasses.replace(a_run(), motion=stepping.motion)
    assert judge(CELL, stepping, twin, False).clock_s is None
    stepping.seen[Quantity.CURRENT][149, 0] = 1.2
    assert judge(CELL, stepping, twin, False).clock_s == pytest.approx(49 * CYCLE_S)


@pytest.mark.parametrize(
    ("error_lsb", "notice", "verdict"),
    [
        (2.9, None, Verdict.TOLERATED),
        (2.9, 150, Verdict.BOTH),
        (2.9, 390, Verdict.BOTH),
        (3.1, 160, Verdict.DETECTED),
        (3.1, 120, Verdict.DETECTED),
        (3.1, 161, Verdict.LATE),
        (3.1, None, Verdict.MISSED),
        (3.1, 99, Verdict.MISSED),  # before the injection: no answer to it
    ],
)
def test_verdicts_are_as_defined(error_lsb: float, notice: int | None, verdict: Verdict) -> None:
    evidence = a_run(() if notice is None else (noticed(notice),))
    evidence.motion.angle_rad[150:, 0] = error_lsb * LSB_RAD
    assert judged(evidence).verdict is verdict


@pytest.mark.parametrize(("error_lsb", "verdict"), [(12.9, Verdict.TOLERATED), (13.1, Verdict.MISSED)])
def test_a_law_that_errs_without_a_fault_too_may_go_on_erring(error_lsb: float, verdict: Verdict) -> None:
    """The twin is 10 LSB from the reference: what is within 3 LSB of that is as good as no fault."""
    twin, run = a_run(), a_run()
    twin.motion.angle_rad[:, 0] = 10.0 * LSB_RAD
    run.motion.angle_rad[:, 0] = error_lsb * LSB_RAD
    found = judge(CELL, run, twin, True)
    assert found.verdict is verdict
    assert found.peak_error_lsb == pytest.approx(error_lsb)
    if verdict is Verdict.MISSED:
        assert "error 3.1 LSB > 3 LSB" in why(found)
    else:
        assert found.is_safe


def test_a_detection_before_the_clock_counts_as_no_latency() -> None:
    evidence = a_run((noticed(140),))
    evidence.motion.angle_rad[150:, 0] = 4 * LSB_RAD
    assert judged(evidence).latency_s == 0.0


def test_a_stopped_run_is_not_tolerated_however_small_its_error() -> None:
    assert judged(a_run((noticed(110, stops=True),), is_running=False)).verdict is Verdict.DETECTED


def driven(off_from: int, speed_rad_s: float = 1.0) -> Evidence:
    """Torque that nobody wants from cycle 150 on, until the controller switches it off."""
    evidence = a_run((noticed(152, stops=True),), is_running=False)
    motion = evidence.motion
    motion.command_a[:off_from, 0] = motion.current_a[150:off_from, 0] = 1.5
    motion.speed_rad_s[150:, 0] = motion.motor_speed_rad_s[150:, 0] = speed_rad_s
    motion.reference_rad[153:] = np.nan
    return evidence


@pytest.mark.parametrize(("off_from", "is_safe"), [(192, True), (193, False)])  # 40 cycles are 100 ms
def test_torque_has_to_be_off_within_the_ftti(off_from: int, is_safe: bool) -> None:
    found = judged(driven(off_from), is_dangerous=True)
    assert (found.safety.by, found.is_safe) == ("off", is_safe)
    assert found.safety.safe_s == pytest.approx((off_from - 152) * CYCLE_S)  # with the stop it follows no more


def test_an_arm_that_follows_is_safe_until_it_does_so_no_more() -> None:
    for off_from, is_safe in ((340, True), (341, False)):
        late = a_run((noticed(300, stops=True),), is_running=False)
        late.motion.current_a[150:off_from, 0] = late.motion.command_a[:off_from, 0] = 0.5
        late.motion.speed_rad_s[300:] = 0.5
        found = judged(late, is_dangerous=True)
        assert (found.is_safe, found.safety.by) == (is_safe, "off")
    late.motion.angle_rad[200:210, 0] = 3.1 * LSB_RAD
    assert judged(late, is_dangerous=True).safety.safe_s == pytest.approx((341 - 200) * CYCLE_S)


def falling(cell: Cell, from_cycle: int, speed_rad_s: float) -> Findings:
    """Torque is off from cycle 160 on; joint 3 falls from a cycle on."""
    evidence = driven(160)
    evidence.motion.speed_rad_s[from_cycle:, 1] = evidence.motion.motor_speed_rad_s[from_cycle:, 1] = speed_rad_s
    return judge(cell, evidence, a_run(), is_dangerous=True)


def test_how_fast_an_arm_without_brakes_falls_is_told_and_not_judged() -> None:
    found = falling(CELL, 161, 8.0)
    assert found.is_safe
    assert found.peak_speed_rad_s == 8.0


def test_until_it_is_safe_no_joint_becomes_faster_by_more_than_half_the_limit() -> None:
    assert falling(CELL, 160, 1.5).is_safe  # at rest when the fault struck
    assert not falling(CELL, 160, 1.51).is_safe


def test_a_joint_that_was_hit_may_be_as_fast_as_it_was_or_as_its_twin_is() -> None:
    for cycles, is_safe in ((slice(INJECTED - 1, INJECTED), True), (slice(INJECTED - 9, INJECTED - 1), False)):
        fast = driven(160, speed_rad_s=-2.9)
        fast.motion.speed_rad_s[cycles, 0] = 1.41
        assert judged(fast, is_dangerous=True).is_safe is is_safe
    for twin_rad_s, is_safe in ((1.41, True), (1.39, False)):
        twin = a_run()
        twin.motion.speed_rad_s[150:, 0] = twin_rad_s
        assert judge(CELL, driven(160, speed_rad_s=-2.9), twin, is_dangerous=True).is_safe is is_safe


def test_a_joint_with_a_brake_is_never_faster_than_3_rad_s_not_even_after_the_ftti() -> None:
    braked = load_cell("konkuk1-brakes")
    assert falling(braked, 161, 3.0).is_safe
    assert not falling(braked, 390, 3.01).is_safe
    harmless = driven(160)
    harmless.motion.speed_rad_s[390, 1] = 3.01
    assert judge(CELL, harmless, a_run(), is_dangerous=False).is_safe
    assert not judge(braked, harmless, a_run(), is_dangerous=False).is_safe  # loss of torque is no excuse


def test_the_current_of_a_motor_that_its_brake_shorts_is_no_amplifiers() -> None:
    evidence = driven(160)
    evidence.motion.current_a[170, 0] = -2.0  # against the motion
    assert not judged(evidence, is_dangerous=True).is_safe
    assert judge(load_cell("konkuk1-brakes"), evidence, a_run(), is_dangerous=True).is_safe


@pytest.mark.parametrize(
    ("current_a", "cycle", "speed_rad_s", "is_safe"),
    [
        (1.5 * np.exp(-5.0), 161, 1.0, True),  # 2.5 ms after it was switched off: L/R = 1.25 mH / 2.5 ohm = 0.5 ms
        (0.03, 161, 1.0, False),  # 2 % of 1.5 A
        (0.03, 300, 1.0, False),
        (0.03, 300, -1.0, True),  # a generator takes energy out of the arm
    ],
)
def test_no_drive_puts_energy_into_the_arm_once_its_torque_is_off(
    current_a: float, cycle: int, speed_rad_s: float, is_safe: bool
) -> None:
    evidence = driven(160, speed_rad_s)
    evidence.motion.current_a[cycle, 0] = current_a
    found = judged(evidence, is_dangerous=True)
    assert found.is_safe is is_safe
    assert ("W into the arm" in why(found)) is not is_safe


def test_a_hold_is_safe_once_the_arm_stands_still() -> None:
    holding = driven(CYCLES)
    holding.motion.speed_rad_s[170:] = 0.1
    assert judged(holding, is_dangerous=True).safety.by == "hold"
    holding.motion.speed_rad_s[170:] = 0.2  # above 0.125 rad/s it does not stand
    assert judged(holding, is_dangerous=True).safety.safe_s is None


def test_more_than_the_amplifier_should_give_is_never_safe() -> None:
    evidence = driven(160)
    evidence.motion.current_a[155, 0] = 1.51
    assert not judged(evidence, is_dangerous=True).is_safe


def test_a_fault_that_is_not_dangerous_need_not_end_in_a_safe_state() -> None:
    assert judged(driven(CYCLES), is_dangerous=False).is_safe
    moved = driven(CYCLES)
    moved.motion.angle_rad[151:] = 4 * LSB_RAD
    assert judged(moved, is_dangerous=False).drives_arm
    assert not judged(moved, is_dangerous=False).is_safe
    assert judge(CELL, moved, a_run(), is_dangerous=False, may_mislead=False).is_safe  # a load or a hit has moved it


def test_a_late_cell_says_how_late_and_why_it_is_not_tolerated() -> None:
    erring = a_run((noticed(178),))
    erring.motion.angle_rad[150:, 0] = 3.1 * LSB_RAD
    assert why(judged(erring)) == "late: 70 ms > 25 ms; not tolerated: error 3.1 LSB > 3 LSB"  # 28 cycles
    stopped = a_run((noticed(178, stops=True),), is_running=False)
    stopped.seen[Quantity.VELOCITY][150:] = 1.0
    assert why(judged(stopped)) == "late: 70 ms > 25 ms; not tolerated: stopped"


def test_a_missed_cell_says_that_nothing_was_noticed() -> None:
    erring = a_run()
    erring.motion.angle_rad[150:, 0] = 4.0 * LSB_RAD
    assert "missed: nothing noticed; not tolerated: error 4 LSB > 3 LSB" in why(judged(erring))


def test_an_unsafe_cell_says_which_limit_it_broke() -> None:
    assert why(judged(driven(238), is_dangerous=True)) == "not safe: off only after 215 ms"  # 86 cycles after the stop
    fast = why(judged(driven(160, speed_rad_s=4.8), is_dangerous=True))
    assert fast == "not safe: faster by 4.8 rad/s > 1.5 rad/s"
    strong = driven(160)
    strong.motion.current_a[155, 0] = 1.51
    assert why(judged(strong, is_dangerous=True)) == "not safe: current 1.51 A > 1.5 A"
    assert "never off, at rest" in why(judged(driven(CYCLES), is_dangerous=True))


def test_a_cell_that_is_as_it_should_be_has_no_why() -> None:
    assert why(judged(a_run())) == ""
    assert why(judged(driven(190), is_dangerous=True)) == ""


def test_the_why_is_in_the_list_the_page_and_the_table() -> None:
    cell = cells_of(CELL, ["joint2.tachometer stuck"])[0]
    row = Row.of(cell, judged(driven(238), is_dangerous=True))
    matrix = Matrix("title", (row,), 0, ())
    for text in (as_text(matrix), as_html(matrix), as_csv(matrix.rows)):
        assert "not safe: off only after 215 ms" in text


def test_what_cannot_be_detected_has_to_be_safe_all_the_same() -> None:
    cell = cells_of(CELL, ["adc.channel3 drift"])[0]
    unseen = dataclasses.replace(driven(CYCLES), notices=(), is_running=True)
    unseen.motion.angle_rad[150:, 0] = 4 * LSB_RAD
    row = Row.of(cell, judged(unseen, is_dangerous=True))
    assert (row.verdict, row.is_safe, row.passes) == (Verdict.UNDETECTABLE, False, False)
    assert dataclasses.replace(row, is_safe=True).passes


def a_notice(detector: str, cycle: int) -> Notice:
    return Notice(detector, "", cycle, detector, stops=True)


def test_what_the_twin_does_at_the_same_time_is_no_reaction() -> None:
    twin = a_run((a_notice("outputs-zero", 200), a_notice("process-ended", 380)))
    run = a_run((a_notice("outputs-zero", 204), a_notice("process-ended", 378)), is_running=False)
    cleaned = beside_twin(run, twin)
    assert (cleaned.notices, cleaned.is_running) == ((), True)
    early = a_run((a_notice("process-ended", 300),), is_running=False)
    assert beside_twin(early, twin).notices == early.notices
    assert not beside_twin(early, twin).is_running


@pytest.mark.parametrize("end", ["process-ended", "silent", "nmt-stop"])
def test_a_controller_that_ends_by_itself_while_it_is_watched_is_refused(end: str) -> None:
    with pytest.raises(UsageError, match=rf"after 3 s \({end}\).* longer run, 6 s"):  # 1200 cycles of 2.5 ms
        require_whole(a_run((a_notice(end, 1199),)), Scenario(), CELL, "./mine")


def test_a_controller_that_rests_for_a_while_is_not_refused() -> None:
    require_whole(a_run((a_notice("outputs-zero", 1199),)), Scenario(), CELL, "./mine")


def test_rows_after_the_last_watched_cycle_are_left_out(tmp_path: Path) -> None:
    truth = tmp_path / "robot.csv"
    rows = [f"{tick},{tick * CYCLE_S},{tick * CYCLE_S}," + ",".join(["0"] * 12) for tick in (0, 1, 2, 2, 3)]
    truth.write_text("\n".join(["header", *rows, ""]))
    motion = foreign_run._motion(truth, 2, last_cycle=2)
    assert motion is not None
    assert motion.cycle.tolist() == [0, 1, 2]


def test_the_controller_has_seen_the_last_tpdo_that_came_before_the_next_sync() -> None:
    low, high = (Frame(0x294, (code << 7).to_bytes(2, "little") * 4) for code in (100, 200))
    frames = [Received(0.0006, low), Received(0.0026, high), Received(0.0027, high._replace(data=b"\0"))]
    seen = seen_by_controller(CELL, frames, np.array([0.0, 0.0025, 0.005]))
    step_rad = LSB_RAD
    assert seen[Quantity.POSITION][:, 0] == pytest.approx(np.array([-27.5, 72.5, 72.5]) * step_rad)


def test_zero_outputs_and_nmt_stop_are_seen_on_the_bus() -> None:
    cycle = np.arange(50)
    on, off = Frame(0x312, bytes((0, 1, 0, 0))), Frame(0x312, bytes(4))
    frames = [Received(tick * CYCLE_S + 1e-4, off if tick == 10 or tick >= 20 else on) for tick in range(30)]
    frames.append(Received(40 * CYCLE_S, nmt_frame(NmtCommand.STOP)))
    found = [(each.detector, each.cycle) for each in reactions(CELL, frames, cycle, cycle * CYCLE_S)]
    assert found == [("outputs-zero", 20), ("nmt-stop", 40)]
