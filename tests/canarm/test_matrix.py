"""The fault matrix: its definitions on made-up runs, its files, its command, and the golden copy of konkuk1's."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from canarm.cli import run
from canarm.matrix.bus_reactions import reactions
from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.evidence import SENSORS, Evidence, Motion, Notice, Received, seen_by_controller
from canarm.matrix.golden import differences, golden_text, read_golden
from canarm.matrix.html_report import as_html
from canarm.matrix.judgement import Findings, Verdict, judge
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.table import Matrix, Row, as_csv
from canarm.matrix.undetectable import DECLARED_UNDETECTABLE, HIGHEST_SHARE
from canarm_emulator.faults.catalogue import catalogue
from canarm_protocol.cell import Cell, Quantity
from canarm_protocol.cell_file import load_cell
from canarm_protocol.frames import Frame, NmtCommand, nmt_frame

CELL: Cell = load_cell("konkuk1", {})
CYCLE_S = 0.0025  # konkuk1.toml
CYCLES, INJECTED = 400, 100
GOLDEN = Path(__file__).parent / "golden" / "matrix-konkuk1.csv"
DOCS = Path(__file__).parent.parent.parent / "docs" / "fault-matrix.md"
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
        (Quantity.POTENTIOMETER, 3 * LSB_RAD),
        (Quantity.TACHOMETER, 0.125),  # 5 % of 2.5 rad/s
        (Quantity.CURRENT_SENSE, 0.15),  # 10 % of 1.5 A
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
    stepping.seen[Quantity.CURRENT_SENSE][149:, 0] = 0.6  # magnitude, on the way from 0 to 1 A
    stepping.seen[Quantity.CURRENT_SENSE][150:, 0] = 1.0
    twin = dataclasses.replace(a_run(), motion=stepping.motion)
    assert judge(CELL, stepping, twin, False).clock_s is None
    stepping.seen[Quantity.CURRENT_SENSE][149, 0] = 1.2
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


@pytest.mark.parametrize(("off_from", "is_safe"), [(190, True), (191, False)])  # 40 cycles are 100 ms
def test_torque_has_to_be_off_within_the_ftti(off_from: int, is_safe: bool) -> None:
    found = judged(driven(off_from), is_dangerous=True)
    assert (found.safe_by, found.is_safe) == ("off", is_safe)
    assert found.safe_s == pytest.approx((off_from - 150) * CYCLE_S)


def test_the_speed_is_limited_during_the_ftti_and_no_longer() -> None:
    assert not judged(driven(160, speed_rad_s=3.1), is_dangerous=True).is_safe
    falling = driven(160)
    falling.motion.speed_rad_s[192:] = 8.0
    found = judged(falling, is_dangerous=True)
    assert found.is_safe
    assert found.peak_speed_rad_s == 8.0
    falling.motion.speed_rad_s[190:] = 8.0
    assert not judged(falling, is_dangerous=True).is_safe


def test_a_hold_is_safe_once_the_arm_stands_still() -> None:
    holding = driven(CYCLES)
    holding.motion.speed_rad_s[170:] = 0.1
    assert judged(holding, is_dangerous=True).safe_by == "hold"
    holding.motion.speed_rad_s[170:] = 0.2  # above 0.125 rad/s it does not stand
    assert judged(holding, is_dangerous=True).safe_s is None


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


def test_the_controller_has_seen_the_last_tpdo_that_came_before_the_next_sync() -> None:
    low, high = (Frame(0x294, (code << 7).to_bytes(2, "little") * 4) for code in (100, 200))
    frames = [Received(0.0006, low), Received(0.0026, high), Received(0.0027, high._replace(data=b"\0"))]
    seen = seen_by_controller(CELL, frames, np.array([0.0, 0.0025, 0.005]))
    step_rad = LSB_RAD
    assert seen[Quantity.POTENTIOMETER][:, 0] == pytest.approx(np.array([-27.5, 72.5, 72.5]) * step_rad)


def test_zero_outputs_and_nmt_stop_are_seen_on_the_bus() -> None:
    cycle = np.arange(50)
    on, off = Frame(0x312, bytes((0, 1, 0, 0))), Frame(0x312, bytes(4))
    frames = [Received(tick * CYCLE_S + 1e-4, off if tick == 10 or tick >= 20 else on) for tick in range(30)]
    frames.append(Received(40 * CYCLE_S, nmt_frame(NmtCommand.STOP)))
    found = [(each.detector, each.cycle) for each in reactions(CELL, frames, cycle, cycle * CYCLE_S)]
    assert found == [("outputs-zero", 20), ("nmt-stop", 40)]


def test_the_plan_has_every_fault_at_every_tap() -> None:
    cells = cells_of(CELL)
    assert [(each.tap, each.fault) for each in cells] == [(tap.name, fault.name) for tap, fault, _ in catalogue(CELL)]
    assert {each.family for each in cells_of(CELL, ["bus"])} == {"bus"}
    assert [each.name for each in cells_of(CELL, ["joint2.wire wire-broken"])] == ["joint2.wire wire-broken"]


@pytest.fixture(scope="module")
def some() -> tuple[Campaign, Matrix]:
    cells = cells_of(CELL, ["joint2.tachometer stuck", "node.0x14 sdo-abort", "can0.wire error-frames"])
    campaign = Campaign(Scenario(), tuple(cells), fault_free_runs=2)
    return campaign, run_campaign(campaign, jobs=1)


def test_several_processes_give_the_same_matrix_as_one(some: tuple[Campaign, Matrix]) -> None:
    campaign, matrix = some
    progress: list[tuple[int, int]] = []
    again = run_campaign(campaign, jobs=2, on_progress=lambda done, total: progress.append((done, total)))
    assert again == matrix
    assert progress == [(done, 5) for done in range(1, 6)]


def test_an_sdo_abort_in_a_running_robot_changes_nothing(some: tuple[Campaign, Matrix]) -> None:
    row = next(each for each in some[1].rows if each.fault == "sdo-abort")
    assert (row.verdict, row.clock_ms, row.detector) == (Verdict.TOLERATED, None, "")


def test_a_run_that_breaks_off_is_a_row_and_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = tuple(dataclasses.replace(each, fault="gone") for each in cells_of(CELL, ["joint2.motor open-load"]))
    matrix = run_campaign(Campaign(Scenario(), cells, fault_free_runs=0))
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
        "- joint2.tachometer stuck: was detected by tachometer-stuck after 20 ms"
    ]


def test_the_command_writes_its_files_and_ends_with_json(canarm) -> None:
    arguments = ["--only", "node.0x14 sdo-abort", "--jobs", "1", "--out", "new", "--json"]
    matrix = canarm("fault", "matrix", *arguments)
    assert matrix.wait() == 0
    summary = matrix.json
    assert summary["counts"] == {"tolerated": 1}
    assert (summary["fault_free_runs"], summary["false_alarms"]) == (20, [])
    rows = (canarm.folder / "new" / "matrix.csv").read_text().splitlines()
    assert rows[1].startswith("node.0x14,sdo-abort,node,no,tolerated,")
    assert (canarm.folder / "new" / "matrix.html").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["--only", "nosuch"], "nosuch"), (["--law", "nosuch"], "nosuch"), (["--jobs", "0"], "jobs")],
)
def test_what_cannot_be_asked_for_is_status_2(
    arguments: list[str], word: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run(["fault", "matrix", *arguments]) == 2
    assert word in capfd.readouterr().err


def test_csv_has_a_line_a_row_and_words_for_switches() -> None:
    assert as_csv([ROW]).splitlines()[1].startswith("joint2.tachometer,stuck,signal,yes,detected,tachometer-stuck,")


def test_every_declaration_has_its_reason_in_the_docs() -> None:
    page = DOCS.read_text(encoding="utf-8")
    assert all(each.reason in page for each in DECLARED_UNDETECTABLE)


def test_at_most_a_tenth_of_the_cells_is_declared_undetectable() -> None:
    golden = read_golden(GOLDEN.read_text(encoding="utf-8"))
    assert sum(each.verdict == Verdict.UNDETECTABLE.value for each in golden.values()) <= HIGHEST_SHARE * len(golden)


@pytest.mark.slow
def test_our_own_controller_as_a_strange_one_is_judged_from_the_bus() -> None:
    command = f"{sys.executable} -m canarm controller --clock sync --connect {{host}}:{{port}}"
    cells = tuple(cells_of(CELL, ["node.0x12 hang", "node.0x14 sdo-abort"]))
    hang, abort = run_campaign(Campaign(Scenario(), cells, command)).rows
    assert (hang.verdict, hang.detector, hang.safe_by, hang.is_safe) == (Verdict.DETECTED, "outputs-zero", "off", True)
    assert (abort.verdict, abort.clock_ms) == (Verdict.TOLERATED, None)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_whole_matrix_is_as_its_golden_copy_says() -> None:
    cells = tuple(cells_of(CELL))
    matrix = run_campaign(Campaign(Scenario(), cells), jobs=2)
    changed = differences(matrix.rows, read_golden(GOLDEN.read_text(encoding="utf-8")), 1e3 * CYCLE_S)
    assert not changed, "\n".join([*changed, "if this is meant: make matrix ARGS=--update-golden"])
    assert not matrix.false_alarms
