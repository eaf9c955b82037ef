"""`canarm jog` as its users start it: against an emulator process, one-shot, from a pipe and at a terminal."""

import math
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import time

import pytest

from canarm_protocol.cell.bench_objects import CYCLE, PEAK_CURRENT, TRUE_ANGLE, sdo_channel
from canarm_protocol.transport.port import open_port
from canarm_protocol.transport.sdo_session import SdoSession

DEADLINE_S = 120.0
BENCH, DAC, LATCH = 0x70, 0x12, 0x13
CODE_A = 1.5 / 255
LSB_DEG = 270 / 255


def address(emulator) -> list[str]:
    return ["--connect", f"127.0.0.1:{emulator.port}"]


def truth(emulator, index: int, joint: int = 0, format_: str = "<f") -> float:
    """An object of the bench node, on its own bus."""
    with open_port("canarm", "bench", host="127.0.0.1", port=emulator.port) as port:
        data = SdoSession(port, *sdo_channel(BENCH, 3), limit_s=10.0).upload(index, joint)
    return struct.unpack(format_, data)[0]


def outputs(emulator) -> tuple[int, int]:
    """Joint 2's value at the DAC, and all direction bits."""
    with open_port("canarm", "can0", host="127.0.0.1", port=emulator.port) as port:
        dac = SdoSession(port, 0x600 + DAC, 0x580 + DAC, limit_s=10.0).upload(0x6411, 1)
        latch = SdoSession(port, 0x600 + LATCH, 0x580 + LATCH, limit_s=10.0).upload(0x6200, 1)
    return int.from_bytes(dac, "little"), latch[0]


def piped(canarm, *arguments: str, text: str) -> subprocess.CompletedProcess[str]:
    process = canarm.piped(text, "jog", *arguments)
    status = process.wait()
    stdout, stderr = ("".join(f"{line}\n" for line in lines) for lines in (process.stdout, process.stderr))
    return subprocess.CompletedProcess(process.command, status, stdout, stderr)


def test_one_shot_commands_set_step_and_read_in_lockstep(canarm):
    emulator = canarm.emulator("sync")
    jog = canarm("jog", "--clock", "sync", *address(emulator), "--do", "current joint2 0.57; step 40; read")
    assert jog.wait() == 0, jog
    assert jog.complaint == ""
    assert jog.stdout[1].startswith("cycle 39, 97.5 ms: joint2 ")
    # Time stands still since the last step: the bench knows what was true then. 0.57 A are 97 codes.
    assert truth(emulator, CYCLE, 0, "<I") == 39
    assert truth(emulator, PEAK_CURRENT, 1) == pytest.approx(97 * CODE_A)
    shown = {line.split()[0]: float(line.split()[2]) for line in jog.stdout[2:]}
    for joint in (1, 2):
        measured_deg = shown[f"joint{joint + 1}.potentiometer"]
        # half a step, 0.3 LSB of noise (three times that), and the time between SYNC and conversion
        assert measured_deg == pytest.approx(math.degrees(truth(emulator, TRUE_ANGLE, joint)), abs=2 * LSB_DEG)
    assert shown["joint2.current_sense"] == pytest.approx(0.57, abs=3 * CODE_A)
    assert outputs(emulator) == (0, 0)


def test_one_shot_commands_work_with_the_wire_model_in_lockstep(canarm):
    emulator = canarm.emulator("sync", "--wire")
    commands = "current joint2 0.57; step 10; read; state; step 3; read"
    jog = canarm("jog", "--clock", "sync", *address(emulator), "--do", commands)
    assert jog.wait() == 0, jog
    assert jog.complaint == emulator.complaint == ""
    assert truth(emulator, CYCLE, 0, "<I") == 12
    assert truth(emulator, PEAK_CURRENT, 1) == pytest.approx(97 * CODE_A)
    assert outputs(emulator) == (0, 0)


def test_commands_that_took_so_long_that_the_bench_ran_on_are_a_failure(canarm):
    # less than the 0.1 s after which jog lets itself be heard again
    emulator = canarm.emulator("sync", "--sync-timeout", "0.05")
    with subprocess.Popen(
        [sys.executable, "-m", "canarm", "jog", "--clock", "sync", *address(emulator)],
        cwd=canarm.folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as jog:
        jog.stdin.write("step 2\n")
        jog.stdin.flush()
        emulator.wait_for("virtual time ran on")
        _, complaint = jog.communicate("", timeout=DEADLINE_S)
    assert jog.returncode == 1
    assert "0x8130" in complaint


def test_ctrl_c_ends_a_step_and_not_the_session(canarm):
    emulator = canarm.emulator("sync")
    with Terminal(canarm, "jog", "--clock", "sync", *address(emulator)) as terminal:
        terminal.wait_for("help lists the commands")
        terminal.type("step 100000")
        limit = time.monotonic() + DEADLINE_S
        while not 10 < truth(emulator, CYCLE, 0, "<I") < 100_000:
            assert time.monotonic() < limit
        os.kill(terminal.pid, signal.SIGINT)
        terminal.wait_for("; interrupted after ")
        terminal.type("state")
        terminal.wait_for("card adc (0x14): OPERATIONAL, error register 0x00")
        terminal.type("quit")
        assert terminal.wait() == 0


def test_an_unknown_command_in_a_pipe_says_what_was_done(canarm):
    emulator = canarm.emulator("sync")
    done = piped(canarm, "--clock", "sync", *address(emulator), text="step; step\nfly\nstep 100\n")
    assert done.returncode == 2
    assert "fly: no such command" in done.stderr
    assert done.stderr.endswith("; the 2 commands before it were carried out\n")


def test_a_wrong_command_is_found_before_anything_is_done(canarm):
    jog = canarm("jog", "--do", "current joint2 0.3; step 10; current joint2 9")
    assert jog.wait() == 2
    assert jog.stdout == []
    assert "current 9: must be a number of A from -1.5 to 1.5" in jog.complaint


def test_a_command_that_fails_is_status_1_and_leaves_the_cards_safe(canarm):
    emulator = canarm.emulator("sync")
    commands = "current joint2 0.3; step; sdo write dac 0x1000 0 1; step 100"
    jog = canarm("jog", "--clock", "sync", *address(emulator), "--do", commands)
    assert jog.wait() == 1
    assert len(jog.stdout) == 2
    assert "0x06010002 attempt to write a read-only object" in jog.complaint
    assert truth(emulator, CYCLE, 0, "<I") == 0
    assert outputs(emulator) == (0, 0)


def test_another_clock_than_the_emulators_is_wrong_usage(canarm):
    emulator = canarm.emulator("sync")
    jog = canarm("jog", "--clock", "wall", *address(emulator), "--do", "read")
    assert jog.wait() == 2
    assert "its master on --clock wall: start both with the same --clock" in jog.complaint


def test_without_an_emulator_it_says_how_to_start_one(canarm):
    jog = canarm("jog", "--connect", "127.0.0.1:1", "--do", "read")
    assert jog.wait() == 1
    assert "nobody listens there; start one with: canarm emulator" in jog.complaint


def test_it_refuses_to_start_beside_a_controller_which_goes_on_undisturbed(canarm):
    emulator = canarm.emulator("wall")
    controller = canarm.controller(emulator, "wall")
    controller.wait_for("1 s, ")
    jog = canarm("jog", *address(emulator), "--do", "current joint2 1.5; step 10")
    assert jog.wait() == 1
    assert "another controller is on the bus" in jog.complaint
    assert jog.stdout == []
    controller.send(signal.SIGINT)
    assert controller.wait() == 0, controller


def test_commands_come_from_a_pipe_and_its_end_is_the_end(canarm):
    emulator = canarm.emulator("sync")
    done = piped(canarm, "--clock", "sync", *address(emulator), text="# slowly\ncurrent joint2 0.57\nstep 20\nstate\n")
    assert done.returncode == 0, done.stderr
    assert "card dac (0x12): OPERATIONAL, error register 0x00" in done.stdout
    assert "joint2: code 97, ccw, 0.571 A\n" in done.stdout
    assert outputs(emulator) == (0, 0)


@pytest.mark.parametrize(("line", "status"), [("dac joint2 256", 2), ("sdo read dac 0x5000", 1)])
def test_the_first_error_in_a_pipe_ends_the_session_safely(canarm, line, status):
    emulator = canarm.emulator("sync")
    done = piped(canarm, "--clock", "sync", *address(emulator), text=f"current joint2 0.5\nstep\n{line}\nstep 100\n")
    assert done.returncode == status
    assert len(done.stderr.splitlines()) == 1
    assert truth(emulator, CYCLE, 0, "<I") == 0
    assert outputs(emulator) == (0, 0)


def test_cards_stay_alive_while_the_user_thinks_and_are_left_safe_on_sigterm(canarm):
    emulator = canarm.emulator("wall")
    terminal = Terminal(canarm, "jog", *address(emulator), *canarm.for_clock("wall"))
    with terminal:
        terminal.wait_for("help lists the commands")
        terminal.type("current joint2 0.57; step 4")
        terminal.wait_for("cycle 3: joint2 ")
        before = outputs(emulator)
        # A heartbeat time of the patient cell, watched on the bus itself.
        with open_port("canarm", "can0", host="127.0.0.1", port=emulator.port) as port:
            started_ns = last_ns = None
            while started_ns is None or last_ns - started_ns < 2.5e9:
                for time_ns, frame in port.receive(10.0):
                    assert frame.can_id != 0x80 + DAC
                    if frame.can_id == 0x701:
                        started_ns, last_ns = started_ns or time_ns, time_ns
        assert outputs(emulator) == before == (97 << 7, 0b10)
        terminal.type("dac joint2 256")
        terminal.wait_for("dac 256: CODE must be a whole number from 0 to 255")
        terminal.type("state")
        terminal.wait_for("card adc (0x14): OPERATIONAL, error register 0x00")
        os.kill(terminal.pid, signal.SIGTERM)
        assert terminal.wait() == 1
    assert outputs(emulator) == (0, 0)


def test_a_lost_emulator_ends_a_session_that_waits_for_its_user(canarm):
    emulator = canarm.emulator("wall")
    with Terminal(canarm, "jog", *address(emulator), *canarm.for_clock("wall")) as terminal:
        terminal.wait_for("help lists the commands")
        emulator.send(signal.SIGKILL)
        terminal.wait_for("was the emulator stopped?")
        assert terminal.wait() == 1


class Terminal:
    """`canarm …` with a pseudo-terminal for stdin, stdout and stderr."""

    def __init__(self, canarm, *arguments: str) -> None:
        self._terminal, theirs = pty.openpty()
        self._process = canarm.at_terminal(theirs, *arguments)
        os.close(theirs)
        self.pid = self._process.pid
        self._text = ""

    def type(self, line: str) -> None:
        os.write(self._terminal, f"{line}\n".encode())

    def wait_for(self, text: str) -> None:
        limit = time.monotonic() + DEADLINE_S
        while text not in self._text:
            left_s = limit - time.monotonic()
            assert left_s > 0, f"{text!r} never came: {self._text}"
            if select.select([self._terminal], [], [], left_s)[0]:
                try:
                    self._text += os.read(self._terminal, 4096).decode(errors="replace")
                except OSError:
                    pytest.fail(f"{text!r} never came: {self._text}")

    def wait(self) -> int:
        return self._process.wait(DEADLINE_S)

    def __enter__(self) -> "Terminal":
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.kill()
        self._process.wait(DEADLINE_S)
        os.close(self._terminal)
