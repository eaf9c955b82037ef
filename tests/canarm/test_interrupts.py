"""However far a run has come when a signal ends it: that it was interrupted, and by what, is told and recorded."""

import signal
import socket
from pathlib import Path

import pytest

DEMO = ("demo", "--no-tui", "--json", "--seconds", "3600", "--out", "run")
LINGERING_LAW = """
import time
from canarm_controller.laws.pd import Pd

class Lingering(Pd):
    name = "lingering"

    def update(self, cycle):
        time.sleep(0.001)
        return super().update(cycle)
"""


def child_of(canarm, demo, command: str, until) -> int:
    def found() -> list[int]:
        mark = f"\0{command}\0".encode()
        return [
            pid for pid in canarm.remaining() if pid != demo.pid and mark in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]

    return int(until(found, f"start of the {command}")[0])


@pytest.mark.parametrize(
    ("phase", "number"),
    [
        ("the emulator starts", signal.SIGHUP),
        ("the controller starts", signal.SIGTERM),
        ("the robot moves", signal.SIGINT),
        *(
            pytest.param(phase, number, marks=pytest.mark.slow)
            for phase, number in (
                ("the emulator starts", signal.SIGTERM),
                ("the emulator starts", signal.SIGINT),
                ("the controller starts", signal.SIGHUP),
                ("the controller starts", signal.SIGINT),
                ("the robot moves", signal.SIGHUP),
                ("the robot moves", signal.SIGTERM),
            )
        ),
    ],
)
def test_a_demo_that_a_signal_ends_says_so_and_leaves_a_summary(canarm, run_folder, until, phase, number):
    demo = canarm(*DEMO)
    match phase:
        case "the emulator starts":
            child_of(canarm, demo, "emulator", until)
        case "the controller starts":
            demo.wait_for("to attach to bench")
        case _:
            demo.wait_for("1 of 3600 s")
    demo.send(number)
    assert demo.wait() == 1, demo
    assert canarm.remaining() == []
    assert demo.json["state"] == "interrupted"
    assert demo.json["reason"] == f"interrupted: {number.name}"
    assert "canarm: stopping" in demo.complaint
    recorded = run_folder(canarm.folder / "run").run["summary"]
    assert (recorded["state"], recorded["reason"]) == ("interrupted", f"interrupted: {number.name}")


@pytest.mark.parametrize("phase", ["the emulator starts", "the controller starts"])
def test_ctrl_c_several_times_at_once_is_one(canarm, run_folder, until, phase):
    demo = canarm(*DEMO)
    if phase == "the emulator starts":
        child_of(canarm, demo, "emulator", until)
    else:
        demo.wait_for("to attach to bench")
    demo.send(signal.SIGINT)
    demo.wait_for("canarm: stopping")
    demo.send(signal.SIGINT)
    demo.send(signal.SIGINT)
    assert demo.wait() == 1, demo
    assert canarm.remaining() == []
    assert demo.json["state"] == "interrupted"
    assert run_folder(canarm.folder / "run").run["summary"]["state"] == "interrupted"


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, *(pytest.param(each, marks=pytest.mark.slow) for each in (signal.SIGHUP, signal.SIGINT))]
)
def test_a_controller_that_a_signal_ends_while_it_opens_the_bus_says_so_and_leaves_a_summary(
    canarm, run_folder, number
):
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        controller = canarm("controller", "--connect", address, "--clock", "sync", "--json", "--out", "run")
        connection, _ = silent.accept()
        controller.send(number)
        connection.recv(1)
        connection.close()
        assert controller.wait() == 1, controller
    for summary in (controller.json, run_folder(canarm.folder / "run").run["summary"]):
        assert summary["state"] == "interrupted"
        assert summary["reason"] == f"interrupted: {number.name}, while the bus was opened"


def test_the_code_of_a_law_finds_no_words_of_the_demo_in_its_stdin(canarm):
    (canarm.folder / "laws.py").write_text("import sys\nassert sys.stdin.read() == ''\n" + LINGERING_LAW)
    demo = canarm("demo", "--no-tui", "--json", "--seconds", "0.1", "--law", "laws.py:Lingering", "--out", "run")
    assert demo.wait() == 0, demo
