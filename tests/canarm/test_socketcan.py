"""Emulator and controller on real SocketCAN interfaces, with everybody's tools listening: candump, python-can.

CANARM_SOCKETCAN names two virtual interfaces that nobody else uses, such as vcan0,vcan1; `make check-socketcan` brings
them along. Everything runs on one CPU: on several, two listeners may see the same frames in different order.
"""

import contextlib
import errno
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import pytest

from canarm import Rig

INTERFACES = [name for name in os.environ.get("CANARM_SOCKETCAN", "").split(",") if name]
CYCLE_S = 0.0025
SCORED_S = 3.5
"""The first 2.56 s are not scored."""
LIMIT_LSB = 0.35
"""What the project promises of mras with the table on the nominal robot, on any bus."""
SYNC, TIME = 0x080, 0x100
CARDS = (0x12, 0x13, 0x14)
MARK = 0x7DF
"""A frame of nobody's, by which the listeners show that they listen."""
BUFFER_BYTES = 1 << 23

Identity = tuple[int, bytes]


def missing() -> str | None:
    """Why these tests cannot run here."""
    if len(INTERFACES) != 2:
        return "CANARM_SOCKETCAN does not name two SocketCAN interfaces; make check-socketcan brings them along"
    if not hasattr(socket, "AF_CAN"):
        return "this Python has no SocketCAN"
    for name in INTERFACES:
        try:
            with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
                raw.bind((name,))
        except OSError as error:
            what = "this kernel has no SocketCAN" if error.errno == errno.EAFNOSUPPORT else f"{name}: {error.strerror}"
            return f"CANARM_SOCKETCAN={','.join(INTERFACES)}: {what}"
    return None if shutil.which("candump") else "candump is not installed; it is part of can-utils"


REASON = missing()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(REASON is not None, reason=REASON or ""),
]


@dataclass
class Recorded:
    """What was heard after the marks, by `python_can` also before them, and what the programs said."""

    emulator_log: list[Identity]
    candump: list[Identity]
    python_can: list[can.Message]
    controller: dict[str, Any]
    announced: list[str]


@contextlib.contextmanager
def on_one_cpu() -> Iterator[None]:
    """This process and those it starts."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def record(canarm, run_folder, until, seconds: float) -> Recorded:
    """One run in lockstep, recorded in the folder "run": bring-up, that much virtual time, stop."""
    robot, bench = INTERFACES
    buses = ["-i", "socketcan", "-c", robot, "--bench-interface", "socketcan", "--bench-channel", bench]
    with Listener(robot) as listener:
        emulator = canarm.emulator("sync", *buses, "--sync-timeout", "600", "--seed", "0", "--out", "run")
        until(lambda: len(listener.messages) == len(CARDS), "boot-up of all cards")
        candump = canarm.run("candump", "-L", "-r", str(BUFFER_BYTES), robot)
        until(lambda: listener.mark() or candump.stdout, "candump listens")
        controller = canarm("controller", *buses, "--clock", "sync", "--seconds", str(seconds), "--json")
        assert controller.wait() == 0, controller
        candump.wait_for(r" 000#8014( T)?$")  # the last card is sent back to PRE-OPERATIONAL
        candump.send(signal.SIGINT)
        candump.wait()
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0, emulator
    return Recorded(
        emulator_log=after_marks([identify(message) for message in run_folder(canarm.folder / "run").frames()]),
        candump=after_marks([parse_candump(line) for line in candump.stdout]),
        python_can=listener.messages,
        controller=controller.json,
        announced=emulator.stdout,
    )


class Listener:
    """python-can's own interface, read in a thread."""

    def __init__(self, channel: str) -> None:
        self._bus = can.Bus(interface="socketcan", channel=channel)
        # The usual buffer holds some 270 frames. More than the system's limit needs a privilege.
        for option in (getattr(socket, "SO_RCVBUFFORCE", 33), socket.SO_RCVBUF):
            try:
                self._bus.socket.setsockopt(socket.SOL_SOCKET, option, BUFFER_BYTES)
                break
            except PermissionError:
                continue
        self.messages: list[can.Message] = []
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._listen)

    def _listen(self) -> None:
        while not self._is_over.is_set():
            while (message := self._bus.recv(0.1)) is not None:
                self.messages.append(message)

    def mark(self) -> None:
        """Send a mark, which this listener itself does not hear."""
        self._bus.send(can.Message(arbitration_id=MARK, is_extended_id=False))

    def __enter__(self) -> "Listener":
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._is_over.set()
        self._thread.join()
        self._bus.shutdown()


def identify(message: can.Message) -> Identity:
    return message.arbitration_id, bytes(message.data)


def parse_candump(line: str) -> Identity:
    found = re.fullmatch(r"\([\d.]+\) \S+ ([0-9A-F]{3})#([0-9A-F]*)(?: [RT])?", line)
    assert found, line
    return int(found[1], 16), bytes.fromhex(found[2])


def after_marks(frames: list[Identity]) -> list[Identity]:
    """What came after the last mark."""
    last = max(place for place, (can_id, _) in enumerate(frames) if can_id == MARK)
    return frames[last + 1 :]


def sender_of(can_id: int) -> int:
    """Node-ID of the card that sends `can_id`, or 0: the controller, and TIME's emulator, by the connection set."""
    is_cards = can_id & 0x780 in (0x080, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700)
    return can_id & 0x7F if is_cards and can_id & 0x7F in CARDS else TIME if can_id == TIME else 0


def by_sender(frames: list[Identity]) -> dict[int, list[Identity]]:
    senders: dict[int, list[Identity]] = {}
    for frame in frames:
        senders.setdefault(sender_of(frame[0]), []).append(frame)
    return senders


def test_everybody_on_socketcan_hears_the_same_run_as_on_the_virtual_bus(canarm, run_folder, until):
    """Lockstep: all hear the same frames, which are those of the virtual bus; the arm follows as it does there."""
    with on_one_cpu():
        recorded = record(canarm, run_folder, until, SCORED_S)
    ticks = round(SCORED_S / CYCLE_S)
    assert recorded.controller["state"] == "done"
    assert (recorded.controller["ticks"], recorded.controller["missed"]) == (ticks, 0)
    robot, bench = INTERFACES
    assert f"can0   -i socketcan -c {robot}" in recorded.announced
    assert f"bench  -i socketcan -c {bench}" in recorded.announced

    heard, logged = by_sender(recorded.candump), by_sender(recorded.emulator_log)
    assert set(CARDS) < heard.keys()
    assert heard == logged
    listened = [identify(message) for message in recorded.python_can]
    assert {can_id for can_id, _ in listened[: len(CARDS)]} == {0x700 + node_id for node_id in CARDS}
    assert listened[len(CARDS) :] == recorded.candump
    # SocketCAN marks what this host sent.
    assert not any(message.is_error_frame or message.is_rx for message in recorded.python_can)
    check_causal_order(recorded.candump, ticks)

    with Rig("konkuk1", law="mras", trajectory="sine", seed=0, out=canarm.folder / "virtual") as rig:
        rig.run(SCORED_S)
        expected = rig.summary().as_json()["joints"]
    truths = [(canarm.folder / run / "signals" / "robot.csv").read_bytes() for run in ("run", "virtual")]
    assert truths[0] == truths[1]
    on_virtual_bus = [identify(message) for message in run_folder(canarm.folder / "virtual").frames()][len(CARDS) :]
    assert logged == by_sender(on_virtual_bus)
    for joint, figures in expected.items():
        for key in ("rms_lsb", "max_lsb"):  # five digits, from 32-bit floats
            assert recorded.controller["joints"][joint][key] == pytest.approx(figures[key], rel=3e-5)
        assert 0.0 < recorded.controller["joints"][joint]["rms_lsb"] <= LIMIT_LSB


FAULT_TEST = """
def test_lost_inputs_stop_the_robot(canarm_rig):
    rig = canarm_rig("konkuk1", law="mras", seed=3)
    rig.inject("can0.tx", "lost", cob_id=0x294, at=0.1)
    rig.run(0.2)
    print("ANSWER", rig.state.name, rig.torque_is_off, rig.detected(), rig.reason, rig.fault_events[0])
"""


def test_a_fault_test_gives_the_same_answers_over_socketcan(tmp_path):
    (tmp_path / "test_lost.py").write_text(FAULT_TEST)
    option = f"--canarm-bus=socketcan:{','.join(INTERFACES)}"
    with on_one_cpu():
        command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", option]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=900)
    assert result.returncode == 0, result.stdout + result.stderr
    with Rig("konkuk1", law="mras", seed=3) as rig:
        rig.inject("can0.tx", "lost", cob_id=0x294, at=0.1)
        rig.run(0.2)
        expected = f"{rig.state.name} {rig.torque_is_off} {rig.detected()} {rig.reason} {rig.fault_events[0]}"
    assert f"ANSWER {expected}\n" in result.stdout
    assert "inputs-missing" in expected


def check_causal_order(frames: list[Identity], ticks: int) -> None:
    """SYNC and TIME take turns; inputs come between a SYNC and its TIME, outputs between a TIME and the next SYNC."""
    cycles = 0
    is_between = False
    for can_id, _ in frames:
        if can_id in (SYNC, TIME):
            assert is_between == (can_id == TIME)
            is_between = can_id == SYNC
            cycles += is_between
        elif can_id & 0x780 in (0x180, 0x280, 0x380, 0x480) and sender_of(can_id) in CARDS:
            assert is_between
        elif can_id & 0x780 in (0x200, 0x300, 0x400, 0x500):
            assert not is_between
    assert cycles >= ticks
    assert not is_between


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler named cc")
def test_a_master_in_plain_c_moves_joint_2_to_its_goal(canarm, tmp_path):
    """examples/c_master: status 0 when the potentiometer says that joint 2 has arrived within 5 degrees."""
    source = Path(__file__).parents[2] / "examples" / "c_master" / "master.c"
    program = tmp_path / "master"
    subprocess.run(["cc", "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-o", program, source], check=True)
    robot = INTERFACES[0]
    with on_one_cpu():
        emulator = canarm.emulator("sync", "--sync-timeout", "600", "-i", "socketcan", "-c", robot)
        master = subprocess.run([program, robot, "2"], capture_output=True, text=True, timeout=900)
        emulator.send(signal.SIGTERM)
        assert emulator.wait() == 0, emulator
    assert master.returncode == 0, master.stdout + master.stderr


def test_the_monitor_decodes_what_others_send_and_sends_nothing_itself(canarm, until):
    """Frames of python-can's own interface, as lines; a second listener hears those and no others."""
    robot = INTERFACES[0]
    sent = [(0x312, "00220000", False), (0x714, "05", False), (0x1ABCDEF, "0102", True)]
    with on_one_cpu(), Listener(robot) as listener:
        words = ["monitor", "-i", "socketcan", "-c", robot, "--cell", "konkuk1", "--bitrate", "1000000"]
        monitor = canarm(*words, "--seconds", "600")
        monitor.wait_for(f"listening on -i socketcan -c {robot}")
        with can.Bus(interface="socketcan", channel=robot) as bus:
            for can_id, data, is_extended in sent:
                bus.send(can.Message(arbitration_id=can_id, data=bytes.fromhex(data), is_extended_id=is_extended))
            bus.send(can.Message(arbitration_id=0x294, is_extended_id=False, is_remote_frame=True, dlc=8))
        monitor.wait_for(r"^\(\d+\.\d{6}\) 312#00220000 +RPDO2 of dac: joint2\.current_command 0\.4000 A")
        monitor.wait_for(r"714#05 +heartbeat of adc: operational$")
        monitor.wait_for(r"01ABCDEF#0102 +29-bit identifier, not CANopen's$")
        monitor.wait_for(r"294#R +remote frame$")
        monitor.send(signal.SIGINT)
        assert monitor.wait() == 0, monitor
        until(lambda: len(listener.messages) == len(sent) + 1, "what was sent")
