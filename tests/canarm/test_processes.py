"""Emulator and controller as processes of their own: who joins, leaves, is stopped or killed, and what the other does.

Numbers are the cell's. On the wall clock it is a patient one (conftest.py), so that a busy machine does no harm.
"""

import contextlib
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

import canarm_protocol

EDS = Path(canarm_protocol.__file__).parent / "eds"
CARDS = (0x12, 0x13, 0x14)
CONTROLLER_HEARTBEAT = 0x701
HEARTBEAT_TIMEOUT_S = {"sync": 0.1, "wall": 2.0}
PRE_OPERATIONAL = 0x7F
FRAMES_A_CYCLE = 6
"""SYNC, two RPDOs, two TPDOs, TIME."""
LAST_FRAME = (0x000, bytes((0x80, 0x14)))
"""Of a run: the last card is sent back to PRE-OPERATIONAL."""
CLOCKS = pytest.mark.parametrize("clock", ["sync", "wall"])
EITHER_CLOCK = pytest.mark.parametrize("clock", ["sync", pytest.param("wall", marks=pytest.mark.slow)])
"""Where what is asked hardly depends on the clock."""


def identify(message: can.Message) -> tuple[int, bytes]:
    return message.arbitration_id, bytes(message.data)


@CLOCKS
def test_a_run_leaves_a_folder_that_everybodys_tools_read(canarm, run_folder, clock):
    emulator = canarm.emulator(clock, "--out", "run")
    controller = canarm.controller(emulator, clock, "--seconds", "1", "--out", "run")
    assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0, emulator
    folder = run_folder(canarm.folder / "run").check()
    assert controller.json["state"] == "done"
    assert controller.json["ticks"] == 400
    assert folder.run["summary"] == controller.json
    assert folder.run["cell"]["name"] == "konkuk1"
    assert folder.run["controller"]["law"] == "mras"
    assert folder.run["controller"]["cell"]["control"]["damping_ratio"] == 1.0
    assert folder.run["emulator"]["clock"] == clock
    assert len(folder.signals("controller")["cycle"]) == 400
    states = [event["state"] for event in folder.events() if event["event"] == "state"]
    assert states == ["BRINGING_UP", "RUNNING", "STOPPING", "DONE"]


@CLOCKS
def test_the_cards_protect_the_robot_when_the_controller_is_killed(canarm, run_folder, clock):
    emulator = canarm.emulator(clock, "--out", "robot")
    controller = canarm.controller(emulator, clock, "--out", "control")
    controller.wait_for("1 s, ")
    controller.send(signal.SIGKILL)
    assert controller.wait() == -signal.SIGKILL
    if clock == "sync":
        emulator.wait_for("sender of SYNC has left the bus: virtual time ran on by")
    else:
        with open_bus(emulator) as bus:
            wait_for_heartbeats(bus, PRE_OPERATIONAL, 10)
    emulator.send(signal.SIGINT)
    assert emulator.wait() == 0, emulator

    run_folder(canarm.folder / "control").check()
    folder = run_folder(canarm.folder / "robot").check()
    frames = folder.frames()
    last_heartbeat_s = max(frame.timestamp for frame in frames if frame.arbitration_id == CONTROLLER_HEARTBEAT)
    lost_s = last_heartbeat_s + HEARTBEAT_TIMEOUT_S[clock]
    emergencies = {frame.arbitration_id: frame for frame in frames if 0x80 < frame.arbitration_id < 0x100}
    assert sorted(emergencies) == [0x80 + node_id for node_id in CARDS]
    for frame in emergencies.values():
        assert int.from_bytes(frame.data[:2], "little") == 0x8130
        assert frame.timestamp == pytest.approx(lost_s, abs=2e-6)
    signals = folder.signals("robot")
    before = signals["power_on_s"] < lost_s
    # Five electrical time constants L/R = 1.25 mH / 2.5 ohm, and the emulator's idle step: well within 50 ms.
    after = signals["power_on_s"] > lost_s + 0.05
    assert after.sum() > 5
    for joint in ("joint2", "joint3"):
        assert abs(signals[f"{joint}.motor_current_a"][before][-1]) > 0.02
        assert abs(signals[f"{joint}.motor_current_a"][after]).max() < 1e-3


def test_a_silent_controller_is_given_up_and_stops_safely_when_it_comes_back(canarm, run_folder):
    emulator = canarm.emulator("sync", "--out", "robot", "--sync-timeout", "0.5")
    controller = canarm.controller(emulator, "sync")
    controller.wait_for("1 s, ")
    controller.send(signal.SIGSTOP)
    emulator.wait_for(r"no SYNC for 0.5 s: virtual time ran on by \d+ ms")
    controller.send(signal.SIGCONT)
    assert controller.wait() == 1, controller
    assert controller.json["state"] == "failed"
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    frames = run_folder(canarm.folder / "robot").frames()
    codes = [bytes(frame.data[:2]) for frame in frames if 0x80 < frame.arbitration_id < 0x100]
    assert codes[:3] == [(0x8130).to_bytes(2, "little")] * 3


@EITHER_CLOCK
def test_a_controller_whose_emulator_is_killed_says_so(canarm, run_folder, clock):
    emulator = canarm.emulator(clock, "--out", "run")
    controller = canarm.controller(emulator, clock, "--out", "run")
    controller.wait_for("1 s, ")
    emulator.send(signal.SIGKILL)
    emulator.wait()
    assert controller.wait() == 1, controller
    assert controller.json["state"] == "failed"
    assert "closed the connection; was the emulator stopped?" in controller.json["reason"]
    assert controller.json["reason"] in controller.complaint
    folder = run_folder(canarm.folder / "run").check()
    assert folder.run["summary"]["state"] == "failed"
    assert len(folder.signals("controller")["cycle"]) == controller.json["ticks"]


@pytest.mark.parametrize(("clock", "number"), [("sync", signal.SIGINT), ("wall", signal.SIGTERM)])
def test_an_emulator_that_is_asked_to_end_does_so_in_order(canarm, run_folder, clock, number):
    emulator = canarm.emulator(clock, "--out", "run", "--json")
    controller = canarm.controller(emulator, clock)
    controller.wait_for("1 s, ")
    emulator.send(number)
    assert emulator.wait() == 0, emulator
    assert emulator.json["state"] == "done"
    assert emulator.json["cycles"] >= 400
    assert controller.wait() == 1, controller
    folder = run_folder(canarm.folder / "run").check()
    assert len(set(folder.signals("robot")["cycle"])) == emulator.json["cycles"]


@pytest.mark.parametrize(
    ("clock", "number"),
    [
        ("wall", signal.SIGINT),
        *(pytest.param("sync", each, marks=pytest.mark.slow) for each in (signal.SIGTERM, signal.SIGHUP)),
    ],
)
def test_a_controller_of_limited_length_that_is_asked_to_end_stops_safely(canarm, run_folder, clock, number):
    emulator = canarm.emulator(clock)
    controller = canarm.controller(emulator, clock, "--seconds", "3600", "--out", "run")
    controller.wait_for("1 of 3600 s")
    controller.send(number)
    assert controller.wait() == 1, controller
    assert controller.json["state"] == "interrupted"
    assert number.name in controller.json["reason"]
    run_folder(canarm.folder / "run").check()


@EITHER_CLOCK
def test_a_controller_without_a_length_ends_as_planned_on_ctrl_c(canarm, clock):
    emulator = canarm.emulator(clock)
    controller = canarm.controller(emulator, clock)
    controller.wait_for("1 s, ")
    controller.send(signal.SIGINT)
    assert controller.wait() == 0, controller
    assert controller.json["state"] == "done"
    assert controller.json["reason"] is None


@EITHER_CLOCK
def test_a_second_controller_is_refused_and_the_first_goes_on(canarm, clock):
    emulator = canarm.emulator(clock)
    first = canarm.controller(emulator, clock)
    first.wait_for("1 s, ")
    second = canarm.controller(emulator, clock, "--seconds", "1")
    assert second.wait() == 1, second
    assert second.json["ticks"] == 0
    assert "another controller is on the bus" in second.json["reason"]
    seconds_then = max(int(line.split()[1]) for line in first.stderr if " s, " in line)
    first.wait_for(rf"canarm: {seconds_then + 1} s, ")
    first.send(signal.SIGINT)
    assert first.wait() == 0, first
    if clock == "sync":
        assert first.json["missed"] == 0


@pytest.mark.parametrize(("theirs", "ours"), [("wall", "sync"), ("sync", "wall")])
def test_different_clocks_are_refused_with_status_2(canarm, theirs, ours):
    emulator = canarm.emulator(theirs)
    controller = canarm.controller(emulator, ours, "--seconds", "1")
    assert controller.wait() == 2, controller
    assert f"runs on --clock {theirs}, its master on --clock {ours}" in controller.complaint
    assert controller.json["state"] == "failed"


@pytest.mark.slow
def test_controllers_come_one_after_the_other_while_the_arm_falls_in_between(canarm, until):
    emulator = canarm.emulator("wall")
    first = canarm.controller(emulator, "wall", "--seconds", "1")
    assert first.wait() == 0, first
    # Joint 2 hangs at -90 degrees when nothing holds it: it has to pass -60 before the next controller comes.
    with adc_of(emulator) as adc:
        until(lambda: angle_deg(adc, 1) < -60.0, "joint 2 below -60 degrees")
    second = canarm.controller(emulator, "wall", "--seconds", "3", "--trajectory", "sine")
    assert second.wait() == 0, second
    assert second.json["state"] == "done"
    assert second.json["joints"]["joint2"]["rms_lsb"] is not None


def test_an_arm_that_still_falls_from_the_last_run_is_no_broken_sensor(canarm):
    """In lockstep the arm hangs in the air between two runs, at the speed at which the last one left it."""
    emulator = canarm.emulator("sync")
    for seconds in ("1.1", "1.2", "1.3"):
        controller = canarm.controller(emulator, "sync", "--trajectory", "sine", "--seconds", seconds)
        assert controller.wait() == 0, controller
        assert controller.json["detections"] == []


def test_stock_python_can_and_our_plugin_listen_during_a_run(canarm, run_folder):
    emulator = canarm.emulator("sync", "--out", "run")
    listeners = [
        can.Bus(interface="socketcand", channel="can0", host="127.0.0.1", port=emulator.port),
        can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=emulator.port),
    ]
    controller = canarm.controller(emulator, "sync", "--seconds", "0.1")
    assert controller.wait() == 0, controller
    heard = []
    for bus in listeners:
        messages = [bus.recv(60.0)]
        while identify(messages[-1]) != LAST_FRAME:
            messages.append(bus.recv(60.0))
        heard.append(messages)
        bus.shutdown()
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    logged = run_folder(canarm.folder / "run").frames()
    expected = logged[len(CARDS) :]  # the boot-ups came before the listeners
    assert len(expected) > 40 * FRAMES_A_CYCLE
    for messages in heard:
        assert [identify(message) for message in messages] == [identify(message) for message in expected]
        assert [message.timestamp for message in messages] == pytest.approx([message.timestamp for message in expected])


def test_a_run_is_recorded_by_can_logger(canarm, run_folder):
    emulator = canarm.emulator("sync", "--out", "run")
    flags = ["-i", "canarm", "-c", "can0", "--bus-kwargs", "host=127.0.0.1", f"port={emulator.port}"]
    logger = canarm.run(sys.executable, "-m", "can.logger", "-f", "theirs.asc", *flags)
    logger.wait_for("Can Logger")
    controller = canarm.controller(emulator, "sync", "--seconds", "0.1")
    assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    logger.wait()
    with can.LogReader(canarm.folder / "theirs.asc") as reader:
        recorded = [identify(message) for message in reader]
    logged = [identify(message) for message in run_folder(canarm.folder / "run").frames()]
    assert recorded == logged[len(CARDS) :]
    assert len(recorded) > 40 * FRAMES_A_CYCLE


@EITHER_CLOCK
def test_the_stock_canopen_master_reads_a_card_of_an_idle_emulator(canarm, clock):
    emulator = canarm.emulator(clock)
    with adc_of(emulator) as adc:
        assert adc.sdo[0x1000].raw & 0xFFFF == 401
        assert adc.sdo[0x1018][2].raw == adc.object_dictionary[0x1018][2].default
        assert angle_deg(adc, 1) == pytest.approx(20.0, abs=2.2)


def open_bus(emulator) -> can.BusABC:
    return can.Bus(interface="canarm", channel="can0", host="127.0.0.1", port=emulator.port)


def wait_for_heartbeats(bus: can.BusABC, state: int, count: int) -> None:
    """Until every card has sent `count` heartbeats with `state`."""
    seen: Counter[int] = Counter()
    while any(seen[node_id] < count for node_id in CARDS):
        message = bus.recv(60.0)
        assert message is not None, f"no more heartbeats after {seen}"
        if bytes(message.data) == bytes((state,)):
            seen[message.arbitration_id - 0x700] += 1


@contextlib.contextmanager
def adc_of(emulator) -> Iterator[Any]:
    """The ADC card by a stock CANopen master with the card's EDS file."""
    network = canopen.Network()
    network.connect(interface="canarm", channel="can0", host="127.0.0.1", port=emulator.port)
    try:
        yield network.add_node(0x14, str(EDS / "adc0809.eds"))
    finally:
        network.disconnect()


def angle_deg(adc: Any, joint: int) -> float:
    """Joint angle from the potentiometer's code: 270 degrees on 255 steps, 2.5 V of 5 V at 0 degrees."""
    return (float(adc.sdo[0x6401][joint].raw >> 7) - 127.5) * 270.0 / 255.0
