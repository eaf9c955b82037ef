"""The line that makes a recorded run again: pasted, it makes the same frames; and it says what it cannot repeat."""

import json
import shlex
import shutil
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm_here
from canarm.runs.again import demo_again, fault_file_of
from canarm.runs.report.page import report_page
from canarm_protocol.faults.script import parse_faults

SETTINGS = {"control.natural_frequency_rad_s": 10.0, "control.joint2.damping_ratio": 0.8}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which nothing is what it usually is, with two faults that were declared before it."""
    folder = tmp_path_factory.mktemp("again") / "run"
    with Rig(*("konkuk1", "pd", "trapezoid"), settings=SETTINGS, truth={"joint3.mass": 0.9}, seed=4, out=folder) as rig:
        rig.inject("joint2.tachometer", "stuck", at=0.1, duration=0.05)
        rig.inject("joint3.tachometer", "offset", value=0.1, at=0.12)
        rig.run(0.25)
    return folder


@pytest.fixture
def copy(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "run"))


def said_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    canarm_here(["runs", "show", str(folder)])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("again: canarm")]
    return shlex.split(line.removeprefix("again: canarm"))


@pytest.mark.slow
def test_who_pastes_the_line_has_the_same_frames(
    recorded: Path, canarm: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    words = said_again(recorded, capsys)
    assert canarm_here(["runs", "show", str(recorded), "--faults"]) == 0
    (canarm.folder / "faults.toml").write_text(capsys.readouterr().out)
    process = canarm(*words, "--out", "pasted")
    assert process.wait() == 0, process
    before, after = (path / "can0.log" for path in (recorded, canarm.folder / "pasted"))
    assert before.read_bytes() == after.read_bytes()
    again = said_again(canarm.folder / "pasted", capsys)
    assert again == words, "of the pasted run it is the same line"
    assert "--with-parent" not in report_page([open_run(canarm.folder / "pasted")]).partition("<details>")[0]


def test_the_report_has_the_line_too_with_all_that_was_chosen(recorded: Path) -> None:
    again = demo_again(open_run(recorded))
    assert again is not None
    assert again.line == (
        "canarm demo --no-tui --clock sync --pace max --seconds 0.25 --law pd --trajectory trapezoid "
        "--feedforward none --seed 4 --faults faults.toml --set control.natural_frequency_rad_s=10.0 "
        "--set control.joint2.damping_ratio=0.8 --truth joint3.mass=0.9"
    )
    assert f"<code>{again.line}</code>" in report_page([open_run(recorded)])
    assert f"runs show {recorded} --faults &gt; faults.toml" in report_page([open_run(recorded)])


def test_the_faults_of_a_run_are_one_file(recorded: Path, tmp_path: Path) -> None:
    script = parse_faults(fault_file_of(open_run(recorded)))
    assert script.is_parallel
    assert [(each.trigger.at_s, each.faults[0].tap) for each in script.sets] == [
        (0.1, "joint2.tachometer"),
        (0.12, "joint3.tachometer"),
    ]
    with Rig(out=tmp_path / "whole") as rig:
        rig.run(0.05)
    assert canarm_here(["runs", "show", str(tmp_path / "whole"), "--faults"]) == 2


def test_what_came_on_the_way_is_said_to_be_missing(tmp_path: Path) -> None:
    with Rig(out=tmp_path / "run") as rig:
        rig.run(0.1)
        rig.inject("joint2.tachometer", "stuck")
        rig.change_truth("joint3.mass", 0.7)
        rig.run(0.1)
    again = demo_again(open_run(tmp_path / "run"))
    assert again is not None
    assert "--faults" not in again.line
    assert again.remarks == ("not in it, for it came on the way: 1 fault scripts, the truth was changed",)


def test_of_another_masters_run_the_line_is_that_of_its_emulator(copy: Path) -> None:
    document = json.loads((copy / "run.json").read_text())
    made = document.pop("rig")
    document["emulator"] = {key: made[key] for key in ("seed", "truth", "wire")} | {"clock": "sync"}
    document.pop("summary")
    (copy / "run.json").write_text(json.dumps(document))
    again = demo_again(open_run(copy))
    assert again is not None
    words = shlex.split(again.line)
    assert words[:4] == ["canarm", "emulator", "--clock", "sync"]
    assert words[words.index("--truth") + 1] == "joint3.mass=0.9"


def test_a_hostile_folder_writes_no_other_command(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads((copy / "run.json").read_text())
    evil = "x.py:A; rm -rf ~ `id` $(id)\n\x1b[2J'"
    document["rig"] |= {"law": evil, "trajectory": evil, "seed": evil, "truth": {evil: evil}, "seconds": 10**400}
    document["summary"] |= {"trajectory": evil, "feedforward": evil, "ticks": 100, "approach_s": 1e300}
    document["emulator"] = {"command_line": ["canarm", "--cell", evil, "--set", 7, None]}
    document["cell"] |= {"name": "mine"}
    (copy / "run.json").write_text(json.dumps(document))
    again = demo_again(open_run(copy))
    assert again is not None
    assert again.line.isprintable()
    words = shlex.split(again.line)
    shown = evil.replace("\n", "\\n").replace("\x1b", "\\x1b")
    assert words[:2] == ["canarm", "demo"]
    assert words[words.index("--law") + 1] == shown
    assert any("read it before you run it" in each for each in again.remarks)
    assert any("its seed is none that canarm takes" in each for each in again.remarks)
    page = report_page([open_run(copy)])
    assert "\x1b" not in page


@pytest.mark.parametrize(
    "changes",
    [{"rig": None}, {"summary": None}, {"cell": 7}, {"rig": {"law": 3}}, {"rig": {"law": "pd", "truth": 4}}],
    ids=str,
)
def test_of_half_a_record_there_is_a_line_or_none(changes: dict[str, object], copy: Path) -> None:
    document = json.loads((copy / "run.json").read_text()) | changes
    (copy / "run.json").write_text(json.dumps(document))
    canarm_here(["runs", "show", str(copy)])
    again = demo_again(open_run(copy))
    assert again is None or again.line.startswith("canarm ")


def test_a_master_replayed_to_an_emulator_without_the_faults_is_told_where_it_departs(
    recorded: Path, canarm: Any, run_folder: Any
) -> None:
    emulator = canarm.emulator("sync", "--seed", "4", "--truth", "joint3.mass=0.9", "--out", "second")
    replayed = canarm("replay", str(recorded), "--master", "-i", "canarm", "-c", "can0", f"port={emulator.port}")
    assert replayed.wait() == 0, replayed
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    assert "canarm emulator --clock sync --seed 4 --faults faults.toml --set" in replayed.complaint
    assert f"canarm runs show {recorded} --faults > faults.toml" in replayed.complaint
    logs = [(path / "can0.log").read_text().splitlines() for path in (recorded, canarm.folder / "second")]
    first = next(number for number, pair in enumerate(zip(*logs, strict=False), start=1) if pair[0] != pair[1])
    texts = [log[first - 1].split()[2] for log in logs]
    said = next(line for line in replayed.complaint.splitlines() if "is the first that differs" in line)
    assert f"frame {first} is the first that differs: recorded {texts[0]} (" in said
    assert f"now {texts[1]} (" in said
    assert float(logs[0][first - 1].split()[0].strip("()")) - 1.0 >= 0.1, "not before the first fault"


def test_a_master_replayed_to_the_emulator_that_the_line_makes_is_answered_the_same(
    recorded: Path, canarm: Any, run_folder: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert canarm_here(["runs", "show", str(recorded), "--faults"]) == 0
    (canarm.folder / "faults.toml").write_text(capsys.readouterr().out)
    given = ["--seed", "4", "--truth", "joint3.mass=0.9", "--faults", "faults.toml"]
    emulator = canarm.emulator("sync", *given, "--out", "second")
    replayed = canarm("replay", str(recorded), "--master", "-i", "canarm", "-c", "can0", f"port={emulator.port}")
    assert replayed.wait() == 0, replayed
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    assert "the cards have answered as recorded: " in replayed.complaint
    assert (recorded / "can0.log").read_bytes() == (canarm.folder / "second" / "can0.log").read_bytes()


def test_a_motion_that_was_given_in_python_is_no_file_that_the_line_could_name(tmp_path: Path) -> None:
    table = tmp_path / "motion.csv"
    table.write_text("time_s,joint2_deg,joint3_deg\n0,20,0\n1,21,1\n2,21,1\n")
    for trajectory, named in (
        (lambda t: (0.35, 0.0), "MOTION.csv"),
        (np.tile([0.35, 0.0], (400, 1)), "MOTION.csv"),
        (table, str(table)),
        ("trapezoid", "trapezoid"),
    ):
        folder = tmp_path / f"of {type(trajectory).__name__}"
        with Rig(law="pd", trajectory=trajectory, out=folder) as rig:
            rig.run(0.02)
        again = demo_again(open_run(folder))
        assert again is not None
        words = shlex.split(again.line)
        assert words[words.index("--trajectory") + 1] == named
        assert any("its motion was given in Python, a" in each for each in again.remarks) is (named == "MOTION.csv")


def without(folder: Path) -> None:
    (folder / "events.jsonl").unlink()


def unreadable(folder: Path) -> None:
    without(folder)
    (folder / "events.jsonl").mkdir()


def emptied(folder: Path) -> None:
    (folder / "events.jsonl").write_text("")


def cut_short(folder: Path) -> None:
    """Within the first line, which declares the faults."""
    (folder / "events.jsonl").write_text((folder / "events.jsonl").read_text()[:40])


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (without, "events.jsonl: is missing"),
        (unreadable, "events.jsonl: cannot be read: "),
        (emptied, "events.jsonl: has no event"),
        (cut_short, "events.jsonl: its last line is cut off and left out"),
    ],
)
def test_where_no_event_tells_of_faults_nobody_says_that_there_were_none(
    copy: Path, damage: Any, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads((copy / "run.json").read_text())
    document["emulator"] = {"command_line": ["canarm", "emulator", "--faults", "stuck.toml"]}
    (copy / "run.json").write_text(json.dumps(document))
    damage(copy)
    untold = f"which faults were declared cannot be told: {why}"
    assert canarm_here(["runs", "show", str(copy), "--faults"]) != 0
    said = capsys.readouterr()
    assert said.out == ""
    assert untold in said.err
    assert "its command line has --faults stuck.toml" in said.err
    assert canarm_here(["runs", "show", str(copy)]) == 1
    assert untold in capsys.readouterr().out
    assert canarm_here(["replay", str(copy), "--check"]) == 1, "the faults are missing in the repetition"
    said = capsys.readouterr()
    assert untold in said.err
    assert "differs first" in said.out


def test_faults_that_are_told_by_damaged_events_may_not_be_all(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (copy / "events.jsonl").open("a") as file:
        file.write("no event\n")
    assert canarm_here(["runs", "show", str(copy), "--faults"]) == 1
    said = capsys.readouterr()
    assert len(parse_faults(said.out).sets) == 2
    assert "which others were declared cannot be told: events.jsonl: 1 line is no event and left out" in said.err
