"""One time in all files of a run: cycle 0 is 0 s, for both programs, for every run of an emulator, on either clock."""

import re
import signal
from typing import Any

import numpy as np
import pytest

from canarm.cli import run as canarm_here
from canarm_protocol.runs.run_events import event_lines, runs_of

CYCLE_S = 0.0025


@pytest.fixture(scope="module")
def session(canarm_of_module, run_folder) -> tuple[Any, Any]:
    """One emulator in lockstep, and three runs of 0.5 s, 1 s and 0.25 s on it."""
    canarm = canarm_of_module
    emulator = canarm.emulator("sync", "--out", "out")
    for out, seconds in (("out", "0.5"), ("out/run-2", "1"), ("out/run-3", "0.25")):
        controller = canarm.controller(emulator, "sync", "--seconds", seconds, "--out", out)
        assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0, emulator
    return [run_folder(path).check() for path in runs_of(canarm.folder / "out")], emulator


def test_every_run_of_an_emulator_has_a_folder_and_begins_at_0_s(session) -> None:
    runs, _ = session
    assert [run.path.name for run in runs] == ["out", "run-2", "run-3"]
    for run, cycles in zip(runs, (200, 400, 100), strict=True):
        robot, controller = run.signals("robot"), run.signals("controller")
        assert controller["cycle"].tolist() == list(range(cycles))
        assert controller["time_s"] == pytest.approx(np.arange(cycles) * CYCLE_S, abs=1e-9)
        assert robot["time_s"][:cycles].tolist() == controller["time_s"].tolist()
        assert robot["cycle"][:cycles].tolist() == controller["cycle"].tolist()
        assert set(run.run) >= {"cell", "emulator", "controller", "summary"}
        assert (run.path / "run.json").read_text().startswith('{\n  "summary"')
    starts = [run.signals("robot")["power_on_s"][0] for run in runs]
    assert starts[0] < starts[1] - 0.5 < starts[2] - 1.5


def test_the_true_angle_is_what_was_measured_in_the_same_row_of_each_run(session) -> None:
    """A shift by one run, or by one cycle of a fast motion, would show: two steps of 260/255 degrees at most."""
    for run in session[0]:
        robot, controller = run.signals("robot"), run.signals("controller")
        cycles = len(controller["cycle"])
        off = controller["joint2.measured_rad"] - robot["joint2.true_angle_rad"][:cycles]
        assert np.abs(off).max() < 2 * np.radians(260 / 255)


def test_the_log_of_a_run_begins_with_its_own_configuration(session) -> None:
    for run in session[0]:
        frames = run.frames()
        start = next(i for i, each in enumerate(frames) if each.arbitration_id == 0 and each.data[0] == 1)
        assert {0x612, 0x613, 0x614} <= {each.arbitration_id for each in frames[:start]}
        syncs, cycles = sum(each.arbitration_id == 0x080 for each in frames), len(run.signals("controller")["cycle"])
        assert cycles <= syncs < cycles + 50, "not the run before as well"


def test_the_first_run_of_several_is_the_same_again(session, capsys: pytest.CaptureFixture[str]) -> None:
    assert canarm_here(["replay", str(session[0][0].path), "--check"]) == 0
    assert "the same: every byte of can0 up to the end of its controller" in capsys.readouterr().out


def test_events_before_the_first_cycle_have_a_time_of_0_or_less(session) -> None:
    for run in session[0]:
        events = event_lines(run.path / "events.jsonl")
        states = [(each["state"], each["time_s"], each["cycle"]) for each in events if each["event"] == "state"]
        assert states[0] == ("BRINGING_UP", 0.0, -1)
        assert states[-1][1] >= 0.25
        assert all(each["time_s"] <= 0 for each in events if each["cycle"] < 0)


def test_on_the_wall_clock_both_programs_count_from_the_same_sync(canarm, run_folder) -> None:
    emulator = canarm.emulator("wall", "--out", "run")
    controller = canarm.controller(emulator, "wall", "--seconds", "1", "--out", "run")
    assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    emulator.wait()
    folder = run_folder(canarm.folder / "run").check()
    robot, known = folder.signals("robot"), folder.signals("controller")
    assert robot["power_on_s"][0] - robot["time_s"][0] > 0.1, "finding the cards takes longer than that"
    cycles = len(known["cycle"])
    ours, theirs = known["time_s"], robot["time_s"][np.searchsorted(robot["cycle"], known["cycle"])]
    # What a SYNC takes from one process to the other differs with the machine; half of all are prompt.
    assert abs(np.median(ours - theirs)) < 0.1
    assert cycles > 100
    early = folder.events()
    brought_up = next(each for each in early if each.get("state") == "BRINGING_UP")
    assert -60.0 < brought_up["time_s"] < -0.1
    attached = next(each for each in early if each["event"] == "attached")
    assert attached["time_s"] < 0.0
    assert re.search(r'"time_s": *null', (folder.path / "events.jsonl").read_text()) is None
