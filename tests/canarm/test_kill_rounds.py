"""Three hundred processes killed at moments drawn by lot: no file is damaged, and outputs go off in time every time.

One emulator serves several controllers, one after the other, each of which is killed while it runs; at the end of a
round the emulator itself is killed under a running controller, which has to notice and to end by itself.
"""

import os
import random
import signal
from pathlib import Path

import can
import numpy as np
import pytest

from canarm_protocol.runs.run_events import runs_of

KILLS = int(os.environ.get("CANARM_KILLS", "300"))
AN_EMULATOR = 10
"""So many of the kills belong to one emulator; the last is its own."""
ROUNDS = max(1, KILLS // AN_EMULATOR)
CARDS = (0x12, 0x13, 0x14)
HEARTBEAT_LOST = 0x8130
TIMEOUT_S, GRAIN_S = 0.100, 0.005
"""Of konkuk1: heartbeat_timeout_ms; and how finely time passes while nobody sends SYNC."""
AFTERWARDS_S = 0.2
"""The emulator lets time run on for longer than this before it waits."""
SYNC, EMCY, CONTROLLER_HEARTBEAT = 0x080, 0x080, 0x701

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


def wait_for_rows(until, path: Path, size: int) -> None:
    """Until the file has grown to `size` bytes: a moment that depends on the run and not on a clock."""
    until(lambda: path.exists() and path.stat().st_size >= size, f"{size} bytes in {path.name}")


def losses(frames: list[can.Message]) -> list[tuple[float, dict[int, float]]]:
    """For each time that the controller fell silent: its last frame, and when each card said that it had lost it."""
    found: list[tuple[float, dict[int, float]]] = []
    last_s, said = None, {}
    for frame in frames:
        if frame.arbitration_id in (SYNC, CONTROLLER_HEARTBEAT):
            if said:
                found.append((last_s, said))
                said = {}
            last_s = frame.timestamp
        elif frame.arbitration_id - EMCY in CARDS and int.from_bytes(frame.data[:2], "little") == HEARTBEAT_LOST:
            said.setdefault(frame.arbitration_id - EMCY, frame.timestamp)
    return [*found, (last_s, said)] if said else found


@pytest.mark.parametrize("number", range(ROUNDS))
def test_nothing_is_damaged_and_outputs_go_off_in_time(number: int, canarm, run_folder, until) -> None:
    choose = random.Random(number)
    emulator = canarm.emulator("sync", "--out", "robot")
    for place in range(AN_EMULATOR):
        folder = canarm.folder / f"control{place}"
        controller = canarm.controller(emulator, "sync", "--seconds", "600", "--out", str(folder))
        wait_for_rows(until, folder / "signals" / "controller.csv", choose.randint(1_000, 300_000))
        victim = controller if place < AN_EMULATOR - 1 else emulator
        victim.send(signal.SIGKILL)
        victim.wait()
        if victim is emulator:
            assert controller.wait() == 1, controller
            assert controller.complaint
        run_folder(folder).check()
    lost, time_s, commands = [], [], []
    for run in runs_of(canarm.folder / "robot"):
        robot = run_folder(run).check()
        signals = robot.signals("robot")
        begun_s = signals["power_on_s"][0]
        lost += losses([frame for frame in robot.frames() if frame.timestamp >= begun_s])[:1]
        time_s.append(signals["power_on_s"])
        commands.append(np.array([signals["joint2.command_a"], signals["joint3.command_a"]]))
    assert len(lost) == AN_EMULATOR - 1
    time_s, commands = np.concatenate(time_s), np.concatenate(commands, axis=1)
    for last_s, said in lost:
        assert set(said) == set(CARDS)
        off_s = last_s + TIMEOUT_S + GRAIN_S
        assert max(said.values()) <= off_s
        after = (time_s > off_s) & (time_s < off_s + AFTERWARDS_S)
        assert after.any()
        assert not commands[:, after].any()
