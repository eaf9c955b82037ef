"""Runs in Python and on the command line: opened, listed, shown, pruned; also damaged and hostile ones."""

import csv
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from canarm import Rig, Run, open_run, signal_table
from canarm.cli import run as canarm
from canarm.libraries import MissingLibraryError
from canarm.runs.record_of import record_of
from canarm.runs.report.page import report_page
from canarm.runs.run import RunFolderError
from canarm_protocol.cell import load_cell
from canarm_protocol.runs.run_folder import LOG_START_S
from canarm_tui.history import Column

ESCAPE = "\x1b]0;owned\x07"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of 2 s with a fault that is detected."""
    folder = tmp_path_factory.mktemp("opened") / "run"
    with Rig(law="mras", seed=3, out=folder) as rig:
        rig.inject("joint2.tachometer", "stuck", at=1.0, duration=0.5)
        rig.run(2.0)
    return folder


@pytest.fixture
def copy(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "run"))


@pytest.fixture(params=["pandas", "polars"])
def opened(request: pytest.FixtureRequest, recorded: Path) -> Run:
    pytest.importorskip(request.param)
    return open_run(recorded, request.param)


def csv_column(path: Path, name: str) -> list[float]:
    with path.open(newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]


def test_signals_are_those_of_both_files_joined_by_cycle(opened: Run, recorded: Path) -> None:
    table, cycles = opened.signals, 800
    robot, controller = (recorded / "signals" / f"{name}.csv" for name in ("robot", "controller"))
    assert list(table["cycle"]) == csv_column(robot, "cycle")
    assert list(table["joint2.true_angle_rad"]) == csv_column(robot, "joint2.true_angle_rad")
    assert list(table["joint3.reference_rad"])[:cycles] == csv_column(controller, "joint3.reference_rad")
    assert list(table["controller.joint2.command_a"])[:cycles] == csv_column(controller, "joint2.command_a")
    assert np.isnan(list(table["joint3.reference_rad"])[cycles:]).all(), "no reference during the stop"


def test_frames_are_those_that_python_can_reads(opened: Run, recorded: Path) -> None:
    with can.CanutilsLogReader(recorded / "can0.log") as reader:
        messages = list(reader)
    table = opened.frames
    assert list(table["id"]) == [message.arbitration_id for message in messages]
    assert list(table["data"]) == [bytes(message.data) for message in messages]
    assert list(table["time_s"]) == pytest.approx([message.timestamp - LOG_START_S for message in messages], abs=2e-6)


def test_events_and_what_they_mean(opened: Run) -> None:
    assert "fault-begins" in list(opened.events["event"])
    (begins, _) = opened.faults
    assert (begins.cycle, begins.tap, begins.fault) == (400, "joint2.tachometer", "stuck")
    assert opened.detections[0].detection.where == "joint2"
    assert 1.0 < opened.detections[0].time_s < 1.1
    assert opened.complaints == []


def test_a_run_says_what_it_is_and_has_the_figure_of_the_rig(recorded: Path) -> None:
    run = open_run(recorded)
    assert repr(run) == f"<Run {recorded}: konkuk1, mras on sine, seed 3: done, 800 cycles>"
    assert run.summary["joints"].keys() == {"joint2", "joint3"}
    picture = run.plot()._repr_svg_()
    assert picture.startswith("<svg")
    assert "fault: joint2.tachometer stuck" in picture
    assert picture.count("<polyline") == 2 * (3 + 1 + 2)


def test_a_rig_is_a_dataframe_and_a_figure_too() -> None:
    pandas = pytest.importorskip("pandas")
    with Rig(law="pd", seed=1) as rig:
        rig.run(0.25)
        table = rig.to_dataframe()
        assert isinstance(table, pandas.DataFrame)
        assert table["joint2.true_angle_rad"].tolist() == rig.joints["joint2"].true_angle_rad.tolist()
        assert table["cycle"].tolist() == list(range(100))
        assert repr(rig) == "<Rig konkuk1, pd on sine, seed 1: running, 100 cycles kept>"
        assert rig.plot()._repr_svg_().count("<polyline") == 2 * (3 + 1 + 2)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_library_that_is_not_there_is_named_with_its_extra(
    recorded: Path, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingLibraryError, match=rf"needs {library}, which .*pip install 'canarm\[{library}\]'"):
        _ = open_run(recorded, library).signals
    assert len(open_run(recorded).columns["cycle"]) > 800, "arrays need no library"


def cut(folder: Path) -> None:
    for path in (folder / "signals" / "robot.csv", folder / "can0.log", folder / "events.jsonl", folder / "run.json"):
        os.truncate(path, path.stat().st_size // 2 + 7)


def empty(folder: Path) -> None:
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        os.truncate(path, 0)


def noise(folder: Path) -> None:
    for seed, path in enumerate(path for path in folder.rglob("*") if path.is_file()):
        path.write_bytes(np.random.default_rng(seed).bytes(3000))


def hostile(folder: Path) -> None:
    for name in ("events.jsonl", "can0.log", "signals/robot.csv"):
        with (folder / name).open("a") as file:
            file.write(f'{ESCAPE}\n{{"event": "{"x" * 9999}", "time_s": 1e999}}\n' + "[" * 99999 + "\n")
    events = [{"event": "fault-begins", "time_s": 1}, {"event": ESCAPE, "time_s": 2, ESCAPE: [ESCAPE]}]
    with (folder / "events.jsonl").open("a") as file:
        file.write("".join(json.dumps(event) + "\n" for event in events))
    document = json.loads((folder / "run.json").read_text())
    document["summary"] |= {"cell": ESCAPE, "reason": ESCAPE, "joints": {ESCAPE: {"rms_lsb": 10**400}, "b": ESCAPE}}
    document["cell"] = {ESCAPE: [ESCAPE]}
    document["rig"] |= {"law": f"{folder}/evil.py:Law", "trajectory": ESCAPE, ESCAPE: ESCAPE}
    (folder / "run.json").write_text(json.dumps(document))
    (folder / "evil.py").write_text("raise SystemExit('executed')")
    (folder / ESCAPE.replace("/", "")).write_text("")


def linked(folder: Path) -> None:
    for name in ("run.json", "signals/robot.csv"):
        (folder / name).unlink()
        (folder / name).mkdir()
    (folder / "events.jsonl").unlink()
    os.mkfifo(folder / "events.jsonl")


@pytest.mark.parametrize("damage", [cut, empty, noise, hostile, linked])
def test_of_a_damaged_run_is_shown_what_can_be_read(
    copy: Path, damage: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copy)
    assert canarm(["runs", "show", str(copy)]) == 1
    told = capsys.readouterr()
    assert "not whole: " in told.out
    assert told.err == ""
    assert "executed" not in told.out
    assert all(line.isprintable() for line in told.out.splitlines())
    assert canarm(["runs", "show", "--json", str(copy)]) == 1
    assert "\x1b" not in capsys.readouterr().out
    assert canarm(["runs", "list", str(copy.parent)]) == 0
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("words", [["identify"], ["replay", "--check"]], ids=" ".join)
def test_whatever_needs_the_cell_says_why_there_is_none(
    copy: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    def told() -> str:
        assert canarm([words[0], str(copy), *words[1:]]) == 2
        return capsys.readouterr().err

    file = copy / "run.json"
    document = json.loads(file.read_text())
    for cell, why in ((None, "is missing; the"), ("konkuk1", "is no table; the"), ({}, "name: is missing")):
        file.write_text(json.dumps(document | {"cell": cell}))
        assert f"{file}: cell: {why}" in told()
    file.unlink()
    assert f"{file}: cannot be read: No such file or directory\n" in told()


@pytest.mark.parametrize(
    "field",
    [
        '"time_s": null',
        '"time_s": Infinity',
        '"time_s": 1e999',
        f'"time_s": {10**400}',
        '"time_s": 1e12',
        f'"cycle": {10**400}',
        f'"detail": [{{"a": -1{"0" * 400}}}]',
        '"time_s": null, "cycle": -1',
    ],
)
def test_an_event_with_a_number_that_no_run_has_is_left_out_and_said(
    copy: Path, field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    detections = len(open_run(copy).detections)
    good = '"event": "detection", "time_s": 1.5, "cycle": 600, "detector": "d", "detail": "", "reaction": "continue"'
    with (copy / "events.jsonl").open("a") as file:
        file.write(f"{{{good}}}\n{{{good}, {field}}}\n")
    run = open_run(copy)
    assert len(run.detections) == detections + 1
    assert any("is no event and left out" in each or "is not what it is called" in each for each in run.complaints)
    assert len(record_of(run).faults.detections) == detections + 1
    assert canarm(["runs", "show", str(copy)]) in (0, 1)
    assert canarm(["report", str(copy), "--out", str(copy / "page.html")]) in (0, 1)
    assert "should not happen" not in capsys.readouterr().err


@pytest.mark.filterwarnings("error")
def test_numbers_that_no_robot_has_are_shown_without_a_warning(copy: Path, tmp_path: Path) -> None:
    for table in ("robot", "controller"):
        path = copy / "signals" / f"{table}.csv"
        head, *rows = path.read_text().splitlines()
        for place, value in enumerate(("1e308", "nan", "inf", "-inf", "-1e308"), start=100):
            cycle, time_s, *values = rows[place].split(",")
            rows[place] = ",".join((cycle, time_s, *(value for _ in values)))
        path.write_text("\n".join((head, *rows)) + "\n")
    run = open_run(copy)
    assert "joint2: current, A" in report_page([run])
    assert len(record_of(run).history.cycles) == len(run.robot["cycle"])
    assert run.plot()._repr_svg_().startswith("<svg")


def test_what_is_whole_of_a_run_that_was_cut_off_is_there(copy: Path) -> None:
    whole = open_run(copy).robot["joint2.true_angle_rad"].tolist()
    cut(copy)
    run = open_run(copy)
    left = run.robot["joint2.true_angle_rad"].tolist()
    assert 350 < len(left) < 450
    assert left == whole[: len(left)]
    assert "robot.csv: its last row is cut off and left out" in run.complaints


def test_a_recording_that_broke_off_is_said_wherever_the_run_is_looked_at(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A disk that was full: the run went on, and its record did not (`canarm demo` under `ulimit -f 300`)."""
    record = json.loads((copy / "run.json").read_text())
    record["emulator_summary"] = {"state": "failed", "reason": f"{copy}: recording failed: File too large"}
    (copy / "run.json").write_text(json.dumps(record))
    for log in (copy / "can0.log", copy / "signals" / "robot.csv"):
        lines = log.read_text().splitlines(keepends=True)
        log.write_text("".join(lines[: len(lines) // 2]))
    said = "the recording broke off: File too large"
    run = open_run(copy)
    assert run.summary["state"] == "done"
    assert said in run.complaints
    assert canarm(["runs", "show", str(copy)]) == 1
    assert said in capsys.readouterr().out
    assert said in report_page([open_run(copy)])
    assert canarm(["replay", str(copy), "--check"]) == 0
    assert "up to where its recording broke off" in capsys.readouterr().out


def test_what_is_missing_of_a_run_is_said(copy: Path) -> None:
    """Parts that were lost, and files of others in their place."""
    robot = copy / "signals" / "robot.csv"
    robot.write_text(robot.read_text().partition("\n")[0] + "\n")
    (copy / "can0.log").unlink()
    run = open_run(copy)
    assert len(run.frames) == 0
    assert len(run.columns["cycle"]) == 800
    assert "robot.csv: has no row of the run's 800 cycles; a part may be missing" in run.complaints
    assert "can0.log: is missing" in run.complaints
    (copy / "signals" / "controller.csv").write_text("cycle,time_s,joint2.measured_a\n")
    assert report_page([open_run(copy)])


def test_a_packed_table_is_refused_by_what_it_says_of_its_size(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros pack a thousandfold: 3e7 rows of 12 columns are 1.5 MB, and 3 GB in memory."""
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(signal_table, "MOST_NUMBERS", 1199)
    rows, packed = len(open_run(copy).robot["cycle"]), copy / "signals" / "robot-0001.parquet"
    for table, said in (
        (
            dict.fromkeys(("cycle", "time_s", "x", "y"), np.zeros(300)),
            "300 rows of 4 columns are more than 1199 numbers",
        ),
        ({"x": [1, 2, 3]}, "has no columns cycle and time_s"),
    ):
        parquet.write_table(pa.table(table), packed)
        run = open_run(copy)
        assert len(run.robot["cycle"]) == rows
        assert run.complaints == [f"robot-0001.parquet: cannot be read: {said}"]


def test_what_is_no_run_is_said(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match=r"nowhere: there is no such folder; a run is a folder with run\.json$"):
        open_run(tmp_path / "nowhere")
    with pytest.raises(RunFolderError, match=r"is no run folder: it has none of run\.json, can0\.log, "):
        open_run(tmp_path)
    with pytest.raises(RunFolderError, match=r"x…x+: cannot be read: File name too long$"):
        open_run("x" * 5000)


def test_old_runs_are_pruned_and_nothing_else(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = tmp_path / "runs"
    for number in range(4):
        shutil.copytree(recorded, base / f"run{number}")
        os.utime(base / f"run{number}" / "run.json", (1e9 + number, 1e9 + number))
    shutil.copytree(recorded, base / "run0" / "run-2")
    (base / "run1" / "notes.txt").write_text("mine")
    (base / "run1" / "can0.log").unlink()
    (base / "run1" / "can0.log").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").write_text("precious")
    assert canarm(["runs", "prune", str(base)]) == 2
    assert "give --keep NUMBER, --older-than DAYS" in capsys.readouterr().err
    assert canarm(["runs", "prune", str(base), "--keep", "2"]) == 0
    assert "3 runs" in capsys.readouterr().out.splitlines()[-1]
    assert sorted(path.name for path in base.iterdir()) == ["run0", "run1", "run2", "run3"]
    assert canarm(["runs", "prune", str(base), "--keep", "2", "--older-than", "1", "--yes"]) == 0
    assert "removed " in capsys.readouterr().out
    assert sorted(path.name for path in base.iterdir()) == ["run0", "run1", "run3"], "run-2 is the newest"
    assert (base / "run0" / "run-2" / "run.json").exists()
    assert [path.name for path in (base / "run1").iterdir()] == ["notes.txt"]
    assert (tmp_path / "elsewhere").read_text() == "precious"
    assert canarm(["runs", "list", str(base), "--json"]) == 0
    assert [Path(each["path"]).name for each in json.loads(capsys.readouterr().out)] == ["run3", "run-2"]


def test_what_is_somebodys_own_is_not_pruned(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = tmp_path / "runs"
    mine = {
        "of-a-run/signals/notes.csv": "by hand",
        "of-a-run/signals/sub/notes.txt": "mine",
        "of-a-run/can0-by-me.log": "mine",
        "no-record/run.json": '{"mine": 1}',
        "another-robots/can0.log": "my log",
        "measured/signals/by-hand.csv": "a,b",
    }
    shutil.copytree(recorded, base / "of-a-run")
    for name, text in mine.items():
        (base / name).parent.mkdir(parents=True, exist_ok=True)
        (base / name).write_text(text)
    for left in (".draft-can0.blf", "can0-0001.log", "signals/robot-12345.csv", ".draft-can0-0002.blf"):
        (base / "of-a-run" / left).write_bytes(b"")
    assert canarm(["runs", "prune", str(base), "--keep", "0", "--yes"]) == 0
    said = capsys.readouterr().out
    assert {path.relative_to(base).as_posix() for path in base.rglob("*") if path.is_file()} == set(mine)
    assert "of-a-run; left: can0-by-me.log, signals/notes.csv, signals/sub" in said
    for name in ("no-record", "another-robots", "measured"):
        assert f"left {base / name}: neither run.json nor signals say that a run has left it" in said
    assert "\n1 run, " in said


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of folders there")
def test_a_run_that_goes_on_is_not_pruned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Rig(out=tmp_path / "runs" / "live") as rig:
        rig.run(0.05)
        assert canarm(["runs", "prune", str(tmp_path / "runs"), "--keep", "0", "--yes"]) == 0
        assert f"left {tmp_path / 'runs' / 'live'}: a run goes on in it" in capsys.readouterr().out
    assert canarm(["runs", "prune", str(tmp_path / "runs"), "--keep", "0", "--yes"]) == 0
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_list_of_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert canarm(["runs", "list", str(tmp_path)]) == 0
    assert "no runs" in capsys.readouterr().out
    assert canarm(["runs", "list", str(tmp_path / "nowhere")]) == 2


def test_the_dashboard_is_given_the_rows_of_both_files_and_the_events(recorded: Path) -> None:
    record = record_of(open_run(recorded))
    robot, controller = (recorded / "signals" / f"{name}.csv" for name in ("robot", "controller"))
    history, joint = record.history, record.cell.joint_names.index("joint3")
    assert history.cycles.tolist() == csv_column(robot, "cycle")
    for column, path, name in (
        (Column.ANGLE, robot, "joint3.true_angle_rad"),
        (Column.CURRENT, robot, "joint3.motor_current_a"),
        (Column.REFERENCE, controller, "joint3.reference_rad"),
        (Column.MEASURED, controller, "joint3.measured_rad"),
        (Column.INTERNAL + 1, controller, "joint3.beta"),
    ):
        expected = csv_column(path, name)
        np.testing.assert_allclose(history.values[: len(expected), joint, column], expected, rtol=1e-6)
    # One step of the potentiometer is 270 degrees over 255 codes.
    error = np.subtract(
        csv_column(robot, "joint3.true_angle_rad")[:800], csv_column(controller, "joint3.reference_rad")
    )
    np.testing.assert_allclose(
        history.values[:800, joint, Column.ERROR], error / np.radians(270.0 / 255.0), rtol=1e-3, atol=1e-4
    )
    assert record.internal_names == ("alpha", "beta", "bias_a", "model_rad")
    assert [(event.is_begin, event.cycle) for event in record.faults.events] == [(False, 600), (True, 400)]
    assert record.faults.detections[-1].detector.startswith("tachometer-")
    assert (record.law, record.outcome is not None and record.outcome.is_well) == ("mras", True)


def test_a_run_whose_run_json_is_damaged_is_played_and_complained_of(copy: Path) -> None:
    os.truncate(copy / "run.json", 3000)
    record = record_of(open_run(copy), lambda: load_cell("konkuk1"))
    assert len(record.history.cycles) == len(csv_column(copy / "signals" / "robot.csv", "cycle"))
    assert [event.cycle for event in record.faults.events] == [600, 400]
    assert any("run.json: cannot be read" in each for each in record.complaints)
    assert any("shown with that of --cell, konkuk1" in each for each in record.complaints)
    with pytest.raises(RunFolderError, match="signals are of joint2, joint3; --cell names the cell"):
        record_of(open_run(copy), lambda: load_cell("rhino-pair"))


def test_a_record_of_a_controller_alone_is_shown_as_far_as_it_goes(copy: Path) -> None:
    (copy / "signals" / "robot.csv").unlink()
    record = record_of(open_run(copy))
    assert len(record.history.cycles) == 800
    assert np.isnan(record.history.values[:, :, Column.ANGLE]).all()
    assert np.isfinite(record.history.values[:, :, Column.MEASURED]).all()
    (copy / "signals" / "controller.csv").unlink()
    assert not len(record_of(open_run(copy)).history.cycles)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "there is no such folder"),
        (["/dev/zero"], "/dev/zero: is no folder; a run is a folder with run.json"),
        (["run/run.json"], "run/run.json: is no folder"),
        (["run", "-i", "virtual"], "a recorded run is played, and no bus is opened"),
        (["run", "--web", "--web-port", "70000"], "must be a port, 0 to 65535"),
        (["run"], "is no terminal, and the dashboard needs one"),
    ],
)
def test_a_run_that_cannot_be_played_is_said_why(
    copy: Path, words: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(copy.parent)
    monkeypatch.setattr(sys, "__stdin__", None)
    assert canarm(["tui", *words]) != 0
    assert said in capsys.readouterr().err
