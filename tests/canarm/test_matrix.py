"""The fault matrix: its plan, its files, its command, and the golden copy of konkuk1's."""

import dataclasses
import importlib
import json
import os
import shlex
import signal
import sys
from pathlib import Path

import pytest

from canarm.cli import run
from canarm.matrix import foreign_run
from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.files import claimed, write
from canarm.matrix.golden import differences, golden_text, read_golden
from canarm.matrix.html_report import as_html
from canarm.matrix.judgement import Verdict
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.table import Matrix, Row, Tally, as_csv
from canarm.matrix.undetectable import DECLARED_UNDETECTABLE, HIGHEST_SHARE
from canarm.usage import UsageError
from canarm.workers.progress import Progress
from canarm_emulator.faults.catalogue import catalogue_of
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell

CELL: Cell = load_cell("konkuk1", {})
CYCLE_S = 0.0025  # konkuk1.toml
GOLDEN = Path(__file__).parent / "golden" / "matrix-konkuk1.csv"
ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs" / "fault-matrix.md"
sys.path.append(str(ROOT / "scripts"))
script = importlib.import_module("fault_matrix")


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
