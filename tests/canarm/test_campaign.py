"""A campaign over draws: what is drawn, what a cell comes to, right names, and the command that repeats the worst."""

import dataclasses
import importlib
import json
import os
import shlex
import signal
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from canarm.cli import run
from canarm.matrix import campaign as machinery
from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.evidence import Notice
from canarm.matrix.files import claimed, write
from canarm.matrix.golden import draws_of, golden_text, read_golden
from canarm.matrix.html_report import as_html
from canarm.matrix.judgement import Verdict
from canarm.matrix.naming import FITTING, Part, is_named_right, part_of
from canarm.matrix.plan import INJECTED_S, MatrixCell, Scenario, cells_of
from canarm.matrix.scenarios import ONSET, command_of, drawn, one_a_seed
from canarm.matrix.table import Matrix, Row, Tally, cells_csv
from canarm.matrix.text_report import as_text
from canarm.workers.forking import CAN_FORK, in_copy
from canarm.workers.pool import LostWorkerError
from canarm_controller.supervision.detection import DETECTORS
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from tests.resolutions import cell_of_encoders

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "fault-matrix.md"
sys.path.append(str(ROOT / "scripts"))
script = importlib.import_module("fault_matrix")
CELL: Cell = load_cell("konkuk1", {})
BASE = Scenario()
DETECTED = Row("joint2.tachometer", "stuck", "signal", True, Verdict.DETECTED, "tachometer-stuck", "joint2", 20.0)
LATE = dataclasses.replace(DETECTED, verdict=Verdict.LATE, latency_ms=40.0, why="late", draw=2, repeat="again")
forks = pytest.mark.skipif(not CAN_FORK, reason="this system has no fork")


def the_cell(name: str) -> MatrixCell:
    (cell,) = cells_of(CELL, [name])
    return cell


def noticed(detector: str, where: str) -> Notice:
    return Notice(detector, where, 0, "degraded", stops=False)


def test_the_same_draw_seed_draws_the_same_scenarios_and_another_one_others() -> None:
    assert drawn(BASE, CELL, 8, 0) == drawn(BASE, CELL, 8, 0)
    assert drawn(BASE, CELL, 8, 0) != drawn(BASE, CELL, 8, 1)


def test_draws_cover_onsets_laws_motions_and_wires() -> None:
    scenarios = drawn(BASE, CELL, 8, 0)
    eighth_s = (ONSET.high - ONSET.low) / 8
    assert sorted(int((each.at_s - ONSET.low) / eighth_s) for each in scenarios) == list(range(8))
    assert {each.law for each in scenarios} == {"pd", "computed-torque", "mras", "mras-lyapunov", "slotine-li"}
    assert [each.trajectory for each in scenarios].count("sine") == 4
    assert sum("joint3.wire" in dict(each.truth) for each in scenarios) == 4
    assert all({"joint3.mass", "joint2.coulomb", "joint3.viscous"} <= dict(each.truth).keys() for each in scenarios)


def test_an_onset_is_a_whole_number_of_cycles() -> None:
    assert all((each.at_s / 0.0025) % 1.0 == pytest.approx(0.0, abs=1e-6) for each in drawn(BASE, CELL, 8, 3))


def test_what_is_given_is_not_drawn() -> None:
    base = dataclasses.replace(BASE, law="pd", at_s=4.0, truth=(("joint3.mass", "0.7"),))
    scenarios = drawn(base, CELL, 8, 0, {"law", ONSET.name})
    assert {(each.law, each.at_s, dict(each.truth)["joint3.mass"]) for each in scenarios} == {("pd", 4.0, "0.7")}
    free = drawn(BASE, CELL, 8, 0)
    assert [each.seed for each in scenarios] == [each.seed for each in free]


def test_seeds_count_from_the_one_that_is_given() -> None:
    assert [each.seed for each in one_a_seed(dataclasses.replace(BASE, seed=5), 3)] == [5, 6, 7]


def test_the_command_of_the_default_scenario_is_short() -> None:
    assert command_of(BASE, the_cell("joint2.motor open-load")) == "canarm fault matrix --only 'joint2.motor open-load'"
    assert BASE.at_s == INJECTED_S


@pytest.fixture(scope="module")
def some() -> Matrix:
    """Two cells, one of them with the wire model, in two draws."""
    cells = tuple(cells_of(CELL, ["joint2.link collision", "can0.wire no-ack"]))
    return run_campaign(Campaign(drawn(BASE, CELL, 2, 0), cells, fault_free_runs=0))


def test_every_cell_meets_every_draw_and_each_draw_has_one_fault_free_run(some: Matrix) -> None:
    assert [(row.fault, row.draw) for row in some.rows] == [
        ("collision", 1),
        ("collision", 2),
        ("no-ack", 1),
        ("no-ack", 2),
    ]
    assert some.fault_free_runs == 2


@pytest.mark.slow
@forks
def test_without_forking_the_matrix_is_the_same(some: Matrix, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machinery, "CAN_FORK", False)
    machinery._twin.cache_clear()
    cells = tuple(cells_of(CELL, ["joint2.link collision", "can0.wire no-ack"]))
    assert run_campaign(Campaign(drawn(BASE, CELL, 2, 0), cells, fault_free_runs=0)) == some


def test_the_command_that_is_told_repeats_the_worst_run(some: Matrix, capsys: pytest.CaptureFixture[str]) -> None:
    worst = some.cells[0].worst
    program, *words = shlex.split(worst.repeat)
    assert program == "canarm"
    run([*words, "--jobs", "1", "--json"])
    (again,) = json.loads(capsys.readouterr().out.splitlines()[-1])["cells"]
    told = worst.as_plain()
    for column in set(told) - {"draw"}:
        assert again[column] == told[column], column


def test_the_worst_of_a_cell_is_the_one_that_is_not_as_it_should_be() -> None:
    slow = dataclasses.replace(DETECTED, latency_ms=25.0, draw=3)
    assert Tally((DETECTED, LATE, slow)).worst is LATE
    assert Tally((DETECTED, slow)).worst is slow
    unsafe = dataclasses.replace(DETECTED, is_safe=False)
    assert Tally((slow, unsafe)).worst is unsafe
    missed = dataclasses.replace(DETECTED, verdict=Verdict.MISSED, dangerous=False)
    assert Tally((missed, dataclasses.replace(missed, dangerous=True), LATE)).worst.dangerous


def test_a_cell_has_its_share_with_bounds_in_table_page_and_text(tmp_path: Path) -> None:
    rows = (DETECTED, LATE)
    matrix = Matrix("title", rows, 0, ())
    line = dict(zip(*(text.split(",") for text in cells_csv(matrix.cells).splitlines()), strict=True))
    # 1 of 2: 1 - 0.975^(1/2) and 0.975^(1/2) (Clopper and Pearson).
    assert (line["draws"], line["passed"], line["share_low"], line["share_high"]) == ("2", "1", "0.0126", "0.9874")
    assert (line["draw"], line["repeat"]) == ("2", "again")
    for text in (as_text(matrix), as_html(matrix)):
        assert "1 of 2, 50.0% (95% bounds 1.3% to 98.7%)" in text
        assert "again" in text
    with claimed(tmp_path):
        names = [path.name for path in write(tmp_path, matrix)]
    assert names == ["matrix.csv", "matrix.html", "matrix-draws.csv"]
    assert len((tmp_path / "matrix-draws.csv").read_text().splitlines()) == 1 + len(rows)


def test_the_summary_has_the_latency_and_what_is_dangerous_and_unnoticed() -> None:
    missed = dataclasses.replace(DETECTED, verdict=Verdict.MISSED, detector="", latency_ms=None, draw=3)
    tolerated = dataclasses.replace(DETECTED, verdict=Verdict.BOTH, latency_ms=390.0, draw=4)
    harmless = dataclasses.replace(missed, dangerous=False, draw=5)
    text = as_text(Matrix("title", (DETECTED, LATE, missed, tolerated, harmless), 0, ()))
    assert "dangerous and unnoticed: 1 of 4 dangerous runs" in text
    assert "noticed, where not tolerated: median 30 ms, worst 40 ms (joint2.tachometer stuck)" in text  # of 20 and 40


def test_the_draws_of_a_partial_matrix_are_kept_under_another_name(tmp_path: Path) -> None:
    with claimed(tmp_path):
        write(tmp_path, Matrix("title", (DETECTED, LATE), 0, (), runs_left=1))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "matrix-partial-draws.csv",
        "matrix-partial.csv",
        "matrix-partial.html",
    ]


@pytest.mark.parametrize(
    ("cell", "detector", "where", "is_right"),
    [
        ("joint2.motor winding-open", "current-mismatch", "joint2", True),
        ("joint2.motor winding-open", "current-mismatch", "joint3", False),
        ("joint2.latch reversed-direction", "wrong-direction", "joint2", True),
        ("joint2.potentiometer stuck", "potentiometer-stuck", "joint2", True),
        ("joint2.potentiometer short-to-ground", "impossible-position", "joint2", True),
        ("joint3.tachometer drift", "potentiometer-mismatch", "joint3", False),
        ("joint3.tachometer drift", "tachometer-mismatch", "joint3", True),
        ("adc.channel4 stuck", "tachometer-stuck", "joint3", True),  # konkuk1.toml: joint3.tachometer
        ("joint2.current_sense offset", "current-mismatch", "joint2", False),
        ("joint2.current_sense offset", "current-sense-mismatch", "joint2", True),
        ("joint2.link friction-change", "tachometer-stuck", "joint2", False),
        ("joint2.link friction-change", "acceleration-mismatch", "joint2", True),
        ("joint3.link payload-change", "acceleration-mismatch", "joint2", True),  # joint 2 bears it as well
        ("joint2.link payload-change", "acceleration-mismatch", "joint3", False),
        ("joint2.potentiometer noise", "sensor-noise", "joint2", True),
        ("joint2.potentiometer offset", "sensor-noise", "joint2", False),
        ("node.0x14 hang", "inputs-missing", "", None),
    ],
)
def test_a_name_is_right_where_detector_and_joint_fit_the_fault(
    cell: str, detector: str, where: str, is_right: bool | None
) -> None:
    assert is_named_right(CELL, the_cell(cell), noticed(detector, where)) is is_right


def test_every_part_of_the_robot_has_right_names_and_every_right_name_is_a_detectors() -> None:
    parts = {each: part_of(CELL, each) for each in cells_of(CELL)}
    with_encoders = cell_of_encoders()
    parts |= {each: part_of(with_encoders, each) for each in cells_of(with_encoders)}
    assert {part for part in parts.values() if part is not None} == set(Part)
    for each, part in parts.items():
        if part is not None:
            assert any(row.part is part and fnmatchcase(each.fault, row.fault) for row in FITTING), each.name
        else:
            assert each.tap.startswith(("can0.", "node.", "bench."))
    for row in FITTING:
        assert any(fnmatchcase(each.fault, row.fault) for each, part in parts.items() if part is row.part), row
        for pattern in row.detectors:
            assert any(fnmatchcase(name, pattern) for name in DETECTORS), pattern


def test_wrong_names_are_told_with_what_was_said_instead() -> None:
    right = dataclasses.replace(DETECTED, part="tachometers", named="right")
    wrong = dataclasses.replace(right, fault="drift", named="wrong", detector="potentiometer-mismatch")
    text = as_text(Matrix("title", (right, wrong), 0, ()))
    assert "tachometers     1 of 2, 50.0%" in text
    assert "aim 95%" in text
    assert "1 called potentiometer-mismatch: drift 1" in text


def test_a_false_alarm_of_the_twin_is_no_answer_to_a_fault() -> None:
    """An `sdo-abort` changes nothing in a running robot: what is noticed after it, a noisy tachometer has caused."""
    noisy = dataclasses.replace(BASE, truth=(("joint2.tachometer_noise_lsb", "5"),), at_s=0.05)
    matrix = run_campaign(Campaign((noisy,), (the_cell("node.0x14 sdo-abort"),), fault_free_runs=0))
    assert any(alarm.cycle >= 20 for alarm in matrix.false_alarms)  # 0.05 s of 2.5 ms
    assert matrix.rows[0].detector == ""


@forks
def test_what_is_done_in_a_copy_leaves_the_original_alone() -> None:
    numbers = [1]

    def double() -> list[int]:
        numbers.append(2)
        return numbers

    assert in_copy(double) == [1, 2]
    assert numbers == [1]


@forks
def test_a_copy_that_is_killed_is_tried_once_more(tmp_path: Path) -> None:
    def die_at_first() -> str:
        try:
            (tmp_path / "died").touch(exist_ok=False)
        except FileExistsError:
            return "done"
        os.kill(os.getpid(), signal.SIGKILL)
        return "never"

    assert in_copy(die_at_first) == "done"


@forks
def test_a_copy_that_is_killed_every_time_is_given_up() -> None:
    with pytest.raises(LostWorkerError, match="ended from outside"):
        in_copy(lambda: os.kill(os.getpid(), signal.SIGKILL))


@forks
def test_an_interrupt_ends_the_copy_as_well(tmp_path: Path) -> None:
    def interrupt_and_wait() -> None:
        (tmp_path / "pid").write_text(str(os.getpid()))
        os.kill(os.getppid(), signal.SIGINT)
        signal.pause()

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            in_copy(interrupt_and_wait)
    finally:
        signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_the_page_is_given_the_draws_the_shares_and_the_names() -> None:
    named = [dataclasses.replace(row, part="tachometers", named="right") for row in (DETECTED, LATE)]
    page = script.with_figures(PAGE.read_text(encoding="utf-8"), Matrix("title", tuple(named), 3, ()), (BASE,))
    for text in (
        "0 of 3 fault-free runs raised an alarm",
        "runs as they should be: 1 of 2, 50.0% (95% bounds 1.3% to 98.7%)",
        "```\ncanarm fault matrix\n```",
        "| late | 1 | 50.0% | 1.3% to 98.7% |",
        "| tachometers | 2 of 2 | 100.0% | 15.8% to 100.0% | 95% |",  # 0.025^(1/2)
        "| `joint2.tachometer` | stuck | 1 of 2 | late | 2 | late |",
    ):
        assert text in page


def test_the_golden_copy_says_how_many_draws_it_is_of() -> None:
    golden = read_golden(golden_text([DETECTED, LATE]))
    assert draws_of(golden) == 2
    assert len(script.golden_scenarios(3)) == 3
    with pytest.raises(SystemExit):
        script.main(["--draws", "3"])  # a copy of other draws cannot be compared with


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--draws", "0"], "must be 1 to 10000"),
        (["--seeds", "2", "--draws", "2"], "give one of them"),
        (["--draw-seed", "1"], "is for --draws N"),
        (["--at", "0"], "above 0 and at most 600 s"),
        (["--at", "0.0001"], "must be at least one cycle"),
        (["--at", "nan"], "above 0 and at most 600 s"),
        (["--truth", "joint9.mass=1"], "joint9"),
    ],
)
def test_a_campaign_that_cannot_be_is_status_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fault", "matrix", "--only", "sdo-abort", *arguments]) == 2
    assert words in " ".join(capsys.readouterr().err.split())
