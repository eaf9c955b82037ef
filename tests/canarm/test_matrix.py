"""The fault matrix: its definitions on made-up runs, its files, its command, and the golden copy of konkuk1's."""

import dataclasses
import importlib
import json
import os
import shlex
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from canarm.cli import run
from canarm.matrix import foreign_run
from canarm.matrix.bus_reactions import beside_twin, reactions
from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.evidence import SENSORS, Evidence, Motion, Notice, Received, seen_by_controller
from canarm.matrix.files import claimed, write
from canarm.matrix.foreign_run import require_whole
from canarm.matrix.golden import differences, golden_text, read_golden
from canarm.matrix.html_report import as_html
from canarm.matrix.judgement import Findings, Verdict, judge
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.reasons import why
from canarm.matrix.table import Matrix, Row, Tally, as_csv
from canarm.matrix.text_report import as_text
from canarm.matrix.undetectable import DECLARED_UNDETECTABLE, HIGHEST_SHARE
from canarm.usage import UsageError
from canarm.workers.progress import Progress
from canarm_emulator.faults.catalogue import catalogue_of
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell, Quantity

CELL: Cell = load_cell("konkuk1", {})
CYCLE_S = 0.0025  # konkuk1.toml
CYCLES, INJECTED = 400, 100
GOLDEN = Path(__file__).parent / "golden" / "matrix-konkuk1.csv"
ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs" / "fault-matrix.md"
sys.path.append(str(ROOT / "scripts"))
script = importlib.import_module("fault_matrix")
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


def test_the_plan_has_every_fault_at_every_tap() -> None:
    cells = cells_of(CELL)
    assert [(each.tap, each.fault) for each in cells] == [
        (tap.name, fault.name) for tap, fault, _ in catalogue_of(CELL)
    ]
    assert {each.family for each in cells_of(CELL, ["bus"])} == {"bus"}
    assert [each.name for each in cells_of(CELL, ["joint2.wire wire-broken"])] == ["joint2.wire wire-broken"]


@pytest.fixture(scope="module")
def some() -> tuple[Campaign, Matrix]:
    cells = cells_of(CELL, ["joint2.tachometer stuck", "node.0x14 sdo-abort", "can0.wire error-frames"])
    campaign = Campaign((Scenario(),), tuple(cells), fault_free_runs=2)
    return campaign, run_campaign(campaign, jobs=1)


@pytest.mark.slow
def test_several_processes_give_the_same_matrix_as_one(some: tuple[Campaign, Matrix]) -> None:
    campaign, matrix = some
    progress: list[tuple[int, int]] = []
    again = run_campaign(campaign, jobs=2, on_progress=lambda done, total: progress.append((done, total)))
    assert again == matrix
    assert progress == [(done, 6) for done in range(7)]  # three faults, their twin, two more without a fault


def test_an_sdo_abort_in_a_running_robot_changes_nothing(some: tuple[Campaign, Matrix]) -> None:
    row = next(each for each in some[1].rows if each.fault == "sdo-abort")
    assert (row.verdict, row.clock_ms, row.detector) == (Verdict.TOLERATED, None, "")


def test_a_run_that_breaks_off_is_a_row_and_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = tuple(dataclasses.replace(each, fault="gone") for each in cells_of(CELL, ["joint2.motor open-load"]))
    matrix = run_campaign(Campaign((Scenario(),), cells, fault_free_runs=0))
    assert matrix.rows[0].verdict is Verdict.BROKEN
    assert "gone" in matrix.rows[0].note
    assert not matrix.passes


def test_the_page_needs_nothing_from_elsewhere_and_has_every_cell(some: tuple[Campaign, Matrix]) -> None:
    page = as_html(some[1])
    assert "http" not in page
    assert " src=" not in page
    assert "<link" not in page
    assert page.count("<tr data-verdict") == len(some[1].rows) + len(some[1].counts)


ROW = Row("joint2.tachometer", "stuck", "signal", True, Verdict.DETECTED, "tachometer-stuck", "joint2", 20.0)


def test_the_golden_copy_reads_back_and_allows_one_cycle() -> None:
    golden = read_golden(golden_text([ROW]))
    assert differences([ROW], golden, 2.5) == []
    assert differences([dataclasses.replace(ROW, latency_ms=22.5)], golden, 2.5) == []


@pytest.mark.parametrize(
    ("changed", "sign"),
    [({"latency_ms": 25.0}, "!"), ({"detector": "other"}, "!"), ({"verdict": Verdict.LATE}, "!"), ({"tap": "x"}, "+")],
)
def test_a_change_against_the_golden_copy_is_told(changed: dict[str, object], sign: str) -> None:
    lines = differences([dataclasses.replace(ROW, **changed)], read_golden(golden_text([ROW])), 2.5)
    assert lines[0].startswith(sign)


def test_a_cell_that_is_gone_is_told() -> None:
    assert differences([], read_golden(golden_text([ROW])), 2.5) == [
        "- joint2.tachometer stuck, draw 1: was detected by tachometer-stuck after 20 ms"
    ]


def test_the_command_writes_its_files_and_ends_with_json(canarm) -> None:
    arguments = ["--only", "node.0x14 sdo-abort", "--jobs", "1", "--out", "new", "--json"]
    matrix = canarm("fault", "matrix", *arguments)
    assert matrix.wait() == 0
    summary = matrix.json
    assert summary["counts"] == {"tolerated": 1}
    assert (summary["fault_free_runs"], summary["false_alarms"]) == (1, [])  # the twin
    rows = (canarm.folder / "new" / "matrix.csv").read_text().splitlines()
    assert rows[1].startswith("node.0x14,sdo-abort,node,no,tolerated,")
    assert (canarm.folder / "new" / "matrix.html").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["--only", "nosuch"], "nosuch"), (["--law", "nosuch"], "nosuch"), (["--jobs", "0"], "jobs")],
)
def test_what_cannot_be_asked_for_is_status_2(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fault", "matrix", *arguments]) == 2
    assert word in capsys.readouterr().err


def test_every_pattern_has_to_fit_something(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fault", "matrix", "--only", "node.0x14 sdo-abort", "--only", "slip", "--only", "of pen"]) == 2
    assert "--only slip --only 'of pen': fits no fault" in capsys.readouterr().err


def test_a_folder_that_holds_a_matrix_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "matrix.csv").write_text("precious")
    assert run(["fault", "matrix", "--only", "sdo-abort", "--out", str(tmp_path)]) == 2
    assert "holds a matrix already" in capsys.readouterr().err
    assert (tmp_path / "matrix.csv").read_text() == "precious"


def test_a_folder_that_nothing_was_written_to_can_be_claimed_again(tmp_path: Path) -> None:
    for _ in range(2):
        with claimed(tmp_path / "m"), pytest.raises(UsageError), claimed(tmp_path / "m"):
            pytest.fail("claimed twice")


@pytest.mark.skipif(sys.platform == "win32", reason="flock is POSIX's")
def test_an_empty_claim_that_a_killed_campaign_has_left_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / "matrix.csv").touch()
    with claimed(tmp_path), pytest.raises(UsageError), claimed(tmp_path):
        pytest.fail("claimed twice")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("command", "words"), [("", "'': is empty"), ('"', '": cannot be read as a shell does')])
def test_a_command_that_is_none_is_refused_before_anything_runs(
    command: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fault", "matrix", "--only", "sdo-abort", "--controller", command]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"canarm: --controller {words}")


@pytest.mark.parametrize(("size", "left"), [(50, set()), (1000, {"matrix.csv"})])
def test_a_matrix_that_a_full_disk_does_not_take_is_shown_and_no_half_of_it_is_left(
    size: int, left: set[str], tmp_path: Path, capsys, full_at, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hours of runs must not be lost with the file. The page is some 10 kB, the table of one row some 200 bytes."""
    monkeypatch.setattr("canarm.matrix.campaign.run_campaign", lambda *_: Matrix("title", (ROW,), 0, ()))
    monkeypatch.setattr("canarm.commands.fault_matrix.keep_stdout", lambda: print)
    with full_at(size):
        assert run(["fault", "matrix", "--only", "sdo-abort", "--json", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["cells"] == [Tally((ROW,)).as_plain()]
    name = "matrix.html" if left else "matrix.csv"
    assert f"--out {tmp_path}: {name} cannot be written: File too large" in said.err
    assert {path.name for path in tmp_path.iterdir()} == left


def test_a_partial_matrix_says_so_in_name_and_text(tmp_path: Path) -> None:
    partial = Matrix("title", (ROW,), 0, (), runs_left=3)
    with claimed(tmp_path):
        csv, page = write(tmp_path, partial)
    assert (csv.name, page.name) == ("matrix-partial.csv", "matrix-partial.html")
    assert "interrupted after 1 of 4 runs" in page.read_text(encoding="utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == [csv.name, page.name]
    assert not partial.passes


def test_progress_without_a_terminal_is_ten_lines(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress()
    for done in range(374):
        progress(done, 373)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[1] for line in lines] == [str(percent) for percent in range(10, 101, 10)]


def test_what_was_done_before_says_nothing_of_the_time_that_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress()
    progress(25, 100)
    assert capsys.readouterr().err == ""
    progress(31, 100)
    assert capsys.readouterr().err.startswith("canarm: 31 % (31 of 100 runs), ")


@pytest.mark.parametrize(
    ("command", "words"),
    [("sleep 1000", "no SYNC within 0.5 s"), ("sh -c 'echo no arm; exit 3'", "ended with status 3; it said: no arm")],
)
@pytest.mark.filterwarnings("error")
def test_a_command_that_drives_nothing_is_one_line(
    command: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(foreign_run, "FIRST_SYNC_S", 0.5)
    assert run(["fault", "matrix", "--only", "node.0x14 hang", "--controller", command]) == 1
    *before, last = capsys.readouterr().err.splitlines()
    assert last == f"canarm: --controller {command}: the command drove no cycle: {words}"
    assert any("a run without any fault" in line for line in before)


def test_an_interrupt_ends_all_and_keeps_what_there_is(canarm) -> None:
    matrix = canarm("fault", "matrix", "--only", "joint2.potentiometer *", "--jobs", "2", "--out", "m", "--json")
    matrix.wait_for("10 % ")
    os.killpg(matrix.pid, signal.SIGINT)  # as a terminal does: the workers as well
    assert matrix.wait() == 1
    assert "interrupted after" in matrix.stderr[-1]
    assert matrix.stdout == []
    assert all(line.startswith("canarm: ") for line in matrix.stderr), str(matrix)
    assert canarm.remaining() == []
    assert sorted(path.name for path in (canarm.folder / "m").iterdir()) == [
        "matrix-partial.csv",
        "matrix-partial.html",
    ]


@pytest.mark.slow
def test_an_interrupt_ends_a_strange_controller_too(canarm, until) -> None:
    command = "sh -c 'touch begun; exec sleep 1000'"
    matrix = canarm("fault", "matrix", "--only", "node.0x14 hang", "--controller", command, "--out", "m")
    until((canarm.folder / "begun").exists, "start of the command")
    os.killpg(matrix.pid, signal.SIGINT)
    assert matrix.wait() == 1
    assert matrix.stderr[-1] == "canarm: interrupted after 0 of 1 runs"
    assert canarm.remaining() == []
    assert not (canarm.folder / "m").exists()  # it was made for this, and nothing is in it


@pytest.mark.slow
def test_an_interrupt_ends_the_strange_controllers_of_several_processes(canarm, until) -> None:
    ours = shlex.join([sys.executable, "-m", "canarm", "controller", "--clock", "sync", "--connect"])
    command = f"sh -c 'echo >> begun; exec {ours} {{host}}:{{port}}'"
    matrix = canarm("fault", "matrix", "--only", "*.potentiometer *", "--controller", command, "--jobs", "2")
    until(lambda: (canarm.folder / "begun").exists() and (canarm.folder / "begun").stat().st_size >= 3, "two runs")
    os.killpg(matrix.pid, signal.SIGINT)
    assert matrix.wait() == 1
    assert "interrupted after" in matrix.stderr[-1]
    assert all(line.startswith("canarm: ") for line in matrix.stderr), str(matrix)
    assert canarm.remaining() == []


@pytest.mark.parametrize(("changed", "status"), [({}, 0), ({"latency_ms": 30.0}, 1)])
def test_the_script_says_how_to_accept_a_change(
    changed: dict[str, object],
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    golden = tmp_path / "golden.csv"
    golden.write_text(golden_text([ROW]))
    matrix = Matrix("title", (dataclasses.replace(ROW, **changed),), 0, ())  # type: ignore[arg-type]
    monkeypatch.setattr(script, "GOLDEN", golden)
    monkeypatch.setattr(script, "run_campaign", lambda *_: matrix)
    assert script.main([]) == status
    accepts = "make matrix ARGS=--update-golden" in capsys.readouterr().out.splitlines()[-1]
    assert accepts == bool(changed)


def test_an_interrupted_script_leaves_the_golden_copy_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(script, "GOLDEN", tmp_path / "golden.csv")
    monkeypatch.setattr(script, "run_campaign", lambda *_: Matrix("title", (ROW,), 0, (), runs_left=1))
    assert script.main(["--update-golden"]) == 1
    assert not (tmp_path / "golden.csv").exists()


def test_csv_has_a_line_a_row_and_words_for_switches() -> None:
    assert as_csv([ROW]).splitlines()[1].startswith("joint2.tachometer,stuck,signal,yes,detected,tachometer-stuck,")


def test_every_declaration_has_its_reason_in_the_docs() -> None:
    page = DOCS.read_text(encoding="utf-8")
    assert all(each.reason in page for each in DECLARED_UNDETECTABLE)


def test_at_most_a_tenth_of_the_cells_is_declared_undetectable() -> None:
    golden = read_golden(GOLDEN.read_text(encoding="utf-8"))
    assert sum(each.verdict == Verdict.UNDETECTABLE.value for each in golden.values()) <= HIGHEST_SHARE * len(golden)


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "status"), [(5, 2), (6, 0)])
def test_a_master_with_a_planned_end_needs_a_run_that_outlasts_the_matrix(seconds: int, status: int, canarm) -> None:
    assert canarm("export", "dcf", "--out", "dcf").wait() == 0
    master = [sys.executable, str(ROOT / "examples" / "canopen_master.py"), "dcf", "--port", "{port}"]
    command = f"{shlex.join(master)} --seconds {seconds}"
    matrix = canarm("fault", "matrix", "--only", "node.0x14 sdo-abort", "--controller", command, "--json")
    assert matrix.wait() == status, matrix
    if status:
        assert "give the controller a longer run, 6 s" in matrix.stderr[-1]
    else:
        assert matrix.json["cells"][0]["verdict"] == "tolerated"


@pytest.mark.slow
def test_our_own_controller_as_a_strange_one_is_judged_from_the_bus() -> None:
    command = f"{sys.executable} -m canarm controller --clock sync --connect {{host}}:{{port}}"
    cells = tuple(cells_of(CELL, ["node.0x12 hang", "node.0x14 sdo-abort"]))
    hang, abort = run_campaign(Campaign((Scenario(),), cells, command)).rows
    assert (hang.verdict, hang.detector, hang.safe_by, hang.is_safe) == (Verdict.DETECTED, "outputs-zero", "off", True)
    assert (abort.verdict, abort.clock_ms) == (Verdict.TOLERATED, None)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_whole_matrix_is_as_its_golden_copy_says() -> None:
    matrix = run_campaign(Campaign(script.golden_scenarios(), tuple(cells_of(CELL))), jobs=2)
    changed = differences(matrix.rows, read_golden(GOLDEN.read_text(encoding="utf-8")), 1e3 * CYCLE_S)
    assert not changed, "\n".join([*changed, "if this is meant: make matrix ARGS=--update-golden"])
    assert not matrix.false_alarms
