"""What goes wrong around a run: buses, cards, laws, disks. A line, an exit status, and a run folder in order."""

import resource
import signal
import socket

import pytest

from canarm_emulator.serving.hub import Hub

SWAPPED = {
    "slot = 2\nnode_id = 0x12": "another slot",
    "slot = 3\nnode_id = 0x13": "slot = 2\nnode_id = 0x12",
    "another slot": "slot = 3\nnode_id = 0x13",
}
FAILING_LAW = """
from canarm_controller.laws.pd import Pd

class Failing(Pd):
    name = "failing"

    def update(self, cycle):
        if cycle.tick == 100:
            raise ArithmeticError("the law has lost its way")
        return super().update(cycle)
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_a_port_in_use_is_said_with_status_1(canarm):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        address = f"127.0.0.1:{other.getsockname()[1]}"
        process = canarm("emulator", "--serve", address, "--out", "run")
        assert process.wait() == 1
    assert (
        process.complaint == f"canarm: {address} is in use; stop the other emulator or choose another --serve HOST:PORT"
    )
    assert not (canarm.folder / "run").exists()


def test_an_address_of_another_machine_is_said_with_status_1(canarm):
    # 192.0.2.0/24 belongs to nobody (RFC 5737).
    process = canarm("emulator", "--serve", "192.0.2.1:0", "--allow-remote")
    assert process.wait() == 1
    assert "192.0.2.1:0 is no address of this machine" in process.complaint


def test_serving_other_machines_has_to_be_allowed_and_is_said(canarm):
    refused = canarm("emulator", "--serve", "0.0.0.0:0")
    assert refused.wait() == 2
    assert "say --allow-remote if that is meant" in refused.complaint
    allowed = canarm("emulator", "--serve", "0.0.0.0:0", "--allow-remote")
    allowed.wait_for(r"0\.0\.0\.0:\d+ is open to other machines: whoever reaches it can drive the robot")
    allowed.send(signal.SIGTERM)
    assert allowed.wait() == 0


@pytest.mark.parametrize("clock", ["sync", "wall"])
def test_without_a_server_the_controller_says_how_to_start_one(canarm, run_folder, clock):
    address = f"127.0.0.1:{free_port()}"
    process = canarm("controller", "--connect", address, "--clock", clock, "--out", "run", "--json")
    assert process.wait() == 1
    assert process.json["state"] == "failed"
    assert "nobody listens there; start one with: canarm emulator" in process.complaint
    assert process.json["out"] is None
    assert not [path for path in (canarm.folder / "run").rglob("*") if path.is_file()]
    emulator = canarm.emulator(clock, "--out", "run")  # in the right order, and into the same folder
    controller = canarm.controller(emulator, clock, "--seconds", "0.1", "--out", "run")
    assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    run_folder(canarm.folder / "run").check()


@pytest.mark.parametrize("clock", ["sync", pytest.param("wall", marks=pytest.mark.slow)])
def test_without_an_emulator_on_the_bus_the_controller_names_the_card_it_waited_for(canarm, run_folder, clock):
    hub = Hub("127.0.0.1", 0)
    try:
        address = f"127.0.0.1:{hub.address[1]}"
        process = canarm("controller", "--connect", address, "--clock", clock, "--out", "run", "--json")
        while process.is_running:
            hub.poll(0.05)
    finally:
        hub.close()
    assert process.wait() == 1
    assert process.json["state"] == "failed"
    assert "node 0x12" in process.complaint
    assert "is an emulator with this cell on this bus?" in process.complaint
    run_folder(canarm.folder / "run").check()


def test_what_is_no_can_server_is_said(canarm):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        address = f"127.0.0.1:{other.getsockname()[1]}"
        process = canarm("controller", "--connect", address)
        connection, _ = other.accept()
        connection.sendall(b"SSH-2.0-OpenSSH_9.2 <hello>\r\n")
        assert process.wait() == 1
        connection.close()
    assert "no socketcand server" in process.complaint


def test_a_missing_card_is_named(canarm):
    cell = canarm.write_cell("moved.toml", {"slot = 4\nnode_id = 0x14": "slot = 5\nnode_id = 0x15"})
    emulator = canarm.emulator("sync")
    controller = canarm.controller(emulator, "sync", "--cell", cell, "--seconds", "1", "--out", "run")
    assert controller.wait() == 1, controller
    assert controller.json["state"] == "failed"
    assert "card 'adc' (node 0x15) does not answer" in controller.complaint


def test_a_card_of_another_identity_is_named_with_what_was_found_and_expected(canarm):
    cell = canarm.write_cell("swapped.toml", SWAPPED)
    emulator = canarm("emulator", "--serve", "127.0.0.1:0", "--clock", "sync", "--cell", cell)
    emulator.port = int(emulator.wait_for(r"^bench .*port=(\d+)\b").group(1))
    controller = canarm.controller(emulator, "sync", "--seconds", "1")
    assert controller.wait() == 1, controller
    assert "card 'dac' (node 0x12) is another device" in controller.complaint
    assert "the cell says dac0808" in controller.complaint


@pytest.mark.parametrize("clock", [pytest.param("sync", marks=pytest.mark.slow), "wall"])
def test_a_law_that_raises_ends_in_a_safe_stop(canarm, run_folder, clock):
    (canarm.folder / "laws.py").write_text(FAILING_LAW)
    emulator = canarm.emulator(clock, "--out", "run")
    controller = canarm.controller(emulator, clock, "--law", "laws.py:Failing", "--seconds", "5", "--out", "run")
    assert controller.wait() == 1, controller
    assert controller.json["state"] == "failed"
    assert controller.json["ticks"] <= 100
    assert "the law has lost its way" in controller.complaint
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    folder = run_folder(canarm.folder / "run").check()
    stopping = [event for event in folder.events() if event.get("state") == "STOPPING"]
    assert stopping[0]["detector"] == "law-failed"
    # Torque off: the last commands of the run are zero.
    signals = folder.signals("robot")
    assert signals["joint2.command_a"][-1] == 0.0
    assert signals["joint3.command_a"][-1] == 0.0


@pytest.mark.parametrize("command", ["demo --clock sync --no-tui", "emulator --serve 127.0.0.1:0", "controller"])
def test_a_folder_that_cannot_be_made_is_said_with_status_2(canarm, command):
    (canarm.folder / "file").touch()
    process = canarm(*command.split(), "--out", "file/run")
    assert process.wait() == 2
    assert process.complaint.startswith("canarm: --out file/run: cannot be made: Not a directory")


def test_a_folder_that_holds_a_run_is_refused_and_stays_as_it_is(canarm, run_folder):
    demo = canarm("demo", "--clock", "sync", "--no-tui", "--seconds", "0.1", "--out", "run")
    assert demo.wait() == 0, demo
    before = {path: path.read_bytes() for path in (canarm.folder / "run").rglob("*") if path.is_file()}
    for command in ("demo --no-tui", "emulator --serve 127.0.0.1:0", "controller"):
        process = canarm(*command.split(), "--out", "run")
        assert process.wait() == 2
        assert "run already; name another folder, or remove it" in process.complaint
    assert before == {path: path.read_bytes() for path in (canarm.folder / "run").rglob("*") if path.is_file()}


@pytest.mark.parametrize("who", ["emulator", "controller"])
def test_a_disk_that_fills_up_ends_the_record_and_not_the_run(canarm, run_folder, who):
    def limit_file_size() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))

    limited = {"preexec_fn": limit_file_size}
    emulator = canarm(
        *("emulator", "--serve", "127.0.0.1:0", "--clock", "sync", "--out", "robot"),
        **(limited if who == "emulator" else {}),
    )
    emulator.port = int(emulator.wait_for(r"^bench .*port=(\d+)\b").group(1))
    controller = canarm(
        *("controller", "--connect", f"127.0.0.1:{emulator.port}", "--clock", "sync", "--json", "--out", "control"),
        *("--seconds", "3"),
        **(limited if who == "controller" else {}),
    )
    assert controller.wait() == (1 if who == "controller" else 0), controller
    assert (controller.json["state"], controller.json["ticks"]) == ("done", 1200)
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == (1 if who == "emulator" else 0), emulator
    folder, unrecorded = ("robot", emulator) if who == "emulator" else ("control", controller)
    assert f"{folder}: recording failed: File too large; the run goes on, unrecorded" in unrecorded.complaint
    assert len(run_folder(canarm.folder / "robot").check().signals("robot")["cycle"]) > 100
    assert len(run_folder(canarm.folder / "control").check().signals("controller")["cycle"]) > 100


def test_a_driver_that_is_not_there_is_said_with_status_1(canarm):
    process = canarm("controller", "-i", "socketcan", "-c", "nocan0")
    assert process.wait() == 1
    assert "-i socketcan -c nocan0: " in process.complaint


def test_an_option_that_the_driver_does_not_take_is_said_with_status_2(canarm):
    process = canarm("controller", "-i", "canarm", "-c", "can0", "port=http")
    assert process.wait() == 2
    assert "port" in process.complaint


def test_options_of_the_bus_can_follow_the_flags_as_python_cans_tools_take_them(canarm):
    emulator = canarm.emulator("sync")
    flags = ["-i", "canarm", "-c", "can0", "--bus-kwargs", "host=127.0.0.1", f"port={emulator.port}"]
    words = ["-i", "canarm", "host=127.0.0.1", f"port={emulator.port}"]
    for way in (flags, words):
        process = canarm("controller", *way, "--clock", "sync", "--seconds", "0.1", "--json")
        assert process.wait() == 0, process
        assert process.json["state"] == "done"
        assert process.json["joints"] == {}
        assert "no bench bus" in process.complaint
