"""`canarm demo` as its users meet it: the summary, Ctrl-C, children that must not be left behind, a terminal."""

import os
import re
import signal
import sys
from pathlib import Path

import pytest

KEYS = {
    "cell": "konkuk1",
    "law": "pd",
    "clock": "sync",
    "seed": 3,
    "state": "done",
    "ticks": 400,
    "missed": 0,
}
"""Of the summary's keys in the design, those whose value is known."""


@pytest.fixture(scope="module")
def recorded(canarm_of_module):
    """One run with options for either process, some of them from the environment, recorded in `run`."""
    options = (
        "--law pd --feedforward online --trajectory trapezoid --set control.damping_ratio=0.9 --truth joint3.mass=0.9"
    )
    demo = canarm_of_module(
        *f"demo --clock sync --no-tui --json --seed 3 --out run {options}".split(),
        env={"CANARM_SECONDS": "1", "CANARM_SYNC_TIMEOUT": "7", "CANARM_PACE": "20"},
    )
    assert demo.wait() == 0, demo
    demo.folder = canarm_of_module.folder / "run"
    return demo


def test_the_last_line_is_the_summary_as_json(recorded, run_folder):
    assert len(recorded.stdout) == 1
    assert {key: recorded.json[key] for key in KEYS} == KEYS
    assert recorded.json["real_time_factor"] > 0.0
    assert recorded.json["out"] == "run"
    for joint in ("joint2", "joint3"):
        assert set(recorded.json["joints"][joint]) >= {"rms_lsb", "max_lsb", "peak_current_a"}
    folder = run_folder(recorded.folder).check()
    assert folder.run["summary"] == recorded.json
    assert folder.run["emulator"]["seed"] == 3
    assert folder.run["controller"]["seconds"] == 1.0


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be kept to two cores here")
def test_a_demo_beside_four_busy_loops_on_two_cores_succeeds_and_accuses_nobody(canarm):
    """Paced lockstep, as on a terminal: a busy machine makes it slower, and nothing else."""
    cores = set(sorted(os.sched_getaffinity(0))[:2])
    kept = {"preexec_fn": lambda: os.sched_setaffinity(0, cores)}
    loops = [canarm.run(sys.executable, "-c", "while True: pass", **kept) for _ in range(4)]
    options = ("--no-tui", "--pace", "1", "--json", "--seconds", "5", "--out", "run")
    demo = canarm.run(sys.executable, "-m", "canarm", "demo", *options, **kept)
    assert demo.wait() == 0, demo
    assert all(loop.is_running for loop in loops)
    assert (demo.json["state"], demo.json["ticks"], demo.json["missed"]) == ("done", 2000, 0)
    assert demo.json["detections"] == []


def test_options_reach_the_process_that_they_are_for(recorded, run_folder):
    run = run_folder(recorded.folder).run
    assert (run["summary"]["law"], run["summary"]["feedforward"], run["summary"]["ticks"]) == ("pd", "online", 400)
    assert run["controller"]["trajectory"] == "trapezoid"
    assert run["controller"]["cell"]["control"]["damping_ratio"] == 0.9
    assert run["emulator"]["truth"] == {"joint3.mass": "0.9"}
    assert run["emulator"]["sync_timeout_s"] == 7.0
    assert run["controller"]["pace"] == "20"


def test_without_json_it_ends_with_a_summary_for_people_and_records_below_runs(canarm, run_folder):
    demo = canarm("demo", "--seconds", "0.5")
    assert demo.wait() == 0, demo
    assert demo.stdout[0].startswith("DONE: konkuk1, mras on sine")
    assert demo.stdout[-1].startswith("recorded in runs/")
    assert "canarm: running" in demo.stderr
    (folder,) = (canarm.folder / "runs").iterdir()
    run_folder(folder).check()


UNWRITABLE = {
    # The controller's disk is full in its last cycles, for events too: the first one tells so.
    "full disk": "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))",
    # Somebody has put something else in the place of run.json, for all three processes.
    "no run.json": "os.replace('run/run.json', 'run/run.json.old'); os.mkdir('run/run.json')",
}
UNWRITING_LAW = """
import os, resource
from canarm_controller.laws.pd import Pd

class Unwriting(Pd):
    name = "unwriting"

    def update(self, cycle):
        if cycle.tick == 195:
            {statement}
        return super().update(cycle)
"""


@pytest.mark.parametrize("trouble", UNWRITABLE)
def test_the_summary_is_printed_also_where_it_cannot_be_recorded(canarm, trouble):
    (canarm.folder / "laws.py").write_text(UNWRITING_LAW.format(statement=UNWRITABLE[trouble]))
    demo = canarm(
        *("demo", "--no-tui", "--json", "--seconds", "0.5", "--law", "laws.py:Unwriting", "--out", "run"),
    )
    assert demo.wait() == 1, demo
    assert len(demo.stdout) == 1
    assert (demo.json["state"], demo.json["ticks"], set(demo.json["joints"])) == ("done", 200, {"joint2", "joint3"})
    assert demo.json["faults"] == 0, "the emulator's own summary was lost"
    assert "recording failed: " in demo.complaint
    said = "File too large" if trouble == "full disk" else "run/run.json: cannot be read: is no regular file"
    assert said in demo.complaint


@pytest.mark.parametrize(
    ("number", "seconds"), [(signal.SIGINT, "1e9"), pytest.param(signal.SIGTERM, "3600", marks=pytest.mark.slow)]
)
def test_ctrl_c_is_a_safe_stop_with_a_summary_however_far_the_end_is(canarm, run_folder, number, seconds):
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--json", "--seconds", seconds, "--out", "run")
    demo.wait_for(f"1 of {float(seconds):g}".removesuffix("+09"))
    demo.send(number)
    assert demo.wait() == 1, demo
    assert demo.json["state"] == "interrupted"
    assert "canarm: stopping" in demo.complaint
    assert canarm.remaining() == []
    run_folder(canarm.folder / "run").check()


def test_ctrl_c_before_the_run_ends_the_emulator_too(canarm):
    demo = canarm("demo", "--clock", "sync", "--no-tui")
    demo.wait_for("to attach to bench")
    demo.send(signal.SIGINT)
    assert demo.wait() == 1, demo
    assert canarm.remaining() == []
    assert demo.complaint


@pytest.mark.slow
def test_children_of_a_demo_that_was_killed_end_by_themselves(canarm, run_folder, until):
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--seconds", "3600", "--out", "run")
    demo.wait_for("1 of 3600 s")
    demo.send(signal.SIGKILL)
    until(lambda: not canarm.remaining(), "end of emulator and controller")
    run_folder(canarm.folder / "run").check()


def test_a_demo_serves_where_it_is_asked_to_and_says_it_before_the_dashboard(canarm):
    refused = canarm("demo", "--serve", "0.0.0.0:0", "--out", "run")
    assert refused.wait() == 2
    assert "a demo is for this machine; canarm emulator has --allow-remote" in refused.complaint
    demo = canarm("demo", *canarm.for_clock("sync"), "--serve", "localhost:0", "--seconds", "0.1", "--out", "run")
    assert demo.wait() == 0, demo
    assert re.search(r"to attach to bench: --bus-kwargs host=localhost port=\d+ -i canarm -c bench", demo.complaint)


def test_an_emulator_that_cannot_start_is_explained(canarm):
    (canarm.folder / "run" / "events.jsonl").mkdir(parents=True)
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--out", "run")
    assert demo.wait() == 2
    assert "canarm: run/events.jsonl: cannot be written: Is a directory" in demo.complaint
    assert "canarm: the emulator has ended with status 2" in demo.complaint


def test_an_emulator_that_is_killed_is_reported(canarm, run_folder):
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--json", "--seconds", "3600", "--out", "run")
    demo.wait_for("1 of 3600 s")
    (emulator,) = [pid for pid in canarm.remaining() if b"\0emulator\0" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    os.kill(emulator, signal.SIGKILL)
    assert demo.wait() == 1, demo
    assert demo.json["state"] == "failed"
    assert "canarm: the emulator has ended with status -9" in demo.complaint
    run_folder(canarm.folder / "run").check()


IN_LOCKSTEP = ("demo", "--clock", "sync", "--no-tui")
PRINTING_LAW = """
import atexit, os, sys, threading, time
from canarm_controller.laws.pd import Pd

print("read by the controller, and by the demo before it")
atexit.register(print, "the law's last words", end="")

class Printing(Pd):
    name = "printing"

    def update(self, cycle):
        if cycle.tick == 5:
            threading.Thread(target=time.sleep, args=(3600,)).start()
        sys.stdout.write("no line end")
        os.write(1, b"x" * 2000)
        return super().update(cycle)
"""
LOOPING_LAW = """
from canarm_controller.laws.pd import Pd

class Looping(Pd):
    name = "looping"

    def update(self, cycle):
        while cycle.tick == 100:
            pass
        return super().update(cycle)
"""


def test_what_a_law_prints_and_starts_stays_out_of_the_summary(canarm):
    (canarm.folder / "laws.py").write_text(PRINTING_LAW)
    demo = canarm(*IN_LOCKSTEP, "--json", "--seconds", "1", "--law", "laws.py:Printing", "--out", "run")
    assert demo.wait() == 0, demo.stderr[-3:]
    assert len(demo.stdout) == 1
    assert (demo.json["law"], demo.json["ticks"]) == ("laws.py:Printing", 400)


@pytest.mark.slow
def test_a_law_that_loops_for_ever_ends_the_demo_with_a_hint(canarm):
    # Six seconds of it: asleep, they cost no processor.
    (canarm.folder / "laws.py").write_text(f"import time\n{LOOPING_LAW.replace('pass', 'time.sleep(0.01)')}")
    options = ("--seconds", "3600", "--law", "laws.py:Looping", "--sync-timeout", "6", "--out", "run")
    demo = canarm(*IN_LOCKSTEP, *options)
    assert demo.wait() == 1, demo
    assert "the controller sent nothing after cycle 100 for 6 s (does the law loop for ever? " in demo.complaint
    assert "--sync-timeout sets how long it may take): ended without a safe stop" in demo.complaint
    assert canarm.remaining() == []


@pytest.mark.slow
def test_a_controller_whose_law_loops_ends_at_the_second_ctrl_c(canarm, until):
    (canarm.folder / "laws.py").write_text(LOOPING_LAW)
    emulator = canarm.emulator("sync")
    controller = canarm.controller(emulator, "sync", "--law", "laws.py:Looping")
    emulator.wait_for("SYNC")  # the emulator misses it

    def interrupt() -> bool:
        if controller.is_running:
            controller.send(signal.SIGINT)
        return not controller.is_running

    until(interrupt, "end of the controller")
    assert controller.wait() == 1
    expected = "canarm: interrupted twice: ended without a safe stop; the cards protect themselves"
    assert controller.complaint.endswith(expected)


def test_a_wait_beyond_reason_is_refused(canarm):
    emulator = canarm("emulator", "--sync-timeout", "1e300")
    assert emulator.wait() == 2
    assert "must be a number of seconds above 0 and at most 1e+06 s, or none." in emulator.complaint


def test_of_two_demos_started_together_into_one_folder_one_is_refused(canarm, run_folder):
    demos = [canarm(*IN_LOCKSTEP, "--json", "--seconds", "1", "--out", "run") for _ in range(2)]
    assert sorted(demo.wait() for demo in demos) == [0, 2], demos
    (refused,) = [demo for demo in demos if demo.wait() == 2]
    assert "canarm: --out run: holds a run already; name another folder, or remove it" in refused.complaint
    run_folder(canarm.folder / "run").check()
