"""One run of the matrix with a foreign controller: the emulator and the controller's command as processes.

The run is in lockstep. The truth comes from the emulator's run folder, reactions from the frames on the bus.
"""

import contextlib
import math
import os
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from canarm_emulator.serving.recording import SIGNALS_FILE
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript, FaultSet, FaultSpec, Trigger
from canarm_protocol.runs.run_folder import CAN_LOG_FILE, LOG_START_S, SIGNALS_FOLDER
from canarm_protocol.shown import first_line

from ..child import END_S, offered_port, running
from ..options import DEFAULT_HOST
from ..stopping import signals_held_back
from ..usage import UsageError
from .bus_reactions import END_OF_DRIVING, ENDED, SILENT, cycle_at, reactions
from .evidence import Evidence, Motion, Notice, Received, motion_of, seen_by_controller
from .plan import OBSERVED_S, MatrixCell, Scenario

FIRST_SYNC_S = 30.0
"""How long a controller may take to its first cycles: it loads libraries and configures three cards."""
SILENT_S = 15.0
"""A run that has not moved for this long is over: the emulator gives a silent sender of SYNC 2 s."""
LOOK_S = 0.05
_TRUE_COLUMNS = 6
_STANDARD_DIGITS = 3


def run_foreign(
    scenario: Scenario, cell: Cell, fault: MatrixCell | None, command: str, with_wire: bool = False
) -> Evidence:
    """One run against `command`, in which {host} and {port} are replaced; CANARM_CONNECT has both, as HOST:PORT.

    Without a reference from the controller, its error is measured against the twin. Raises `UsageError` for a command
    that cannot be started, `BusError` for one that drives no cycle.
    """
    injected_cycle, last_cycle = _watched_cycles(scenario, cell)
    with tempfile.TemporaryDirectory(prefix="canarm-matrix-") as name:
        folder = Path(name) / "run"
        arguments = _emulator_arguments(scenario, folder, with_wire)
        if fault is not None:
            file = Path(name) / "faults.toml"
            file.write_text(as_toml(_script(fault, injected_cycle)), encoding="utf-8")
            arguments += ["--faults", str(file)]
        with running("emulator", arguments, quiet=True) as emulator:
            port = offered_port(emulator)
            truth = folder / SIGNALS_FOLDER / SIGNALS_FILE
            with _started(command, str(port), Path(name) / "said") as process:
                end = _watch(process, truth, last_cycle)
            _settle(truth)
        motion = _motion(truth, len(cell.joints), last_cycle)
        if motion is None:
            said = (Path(name) / "said").read_text(errors="replace").strip().splitlines()
            words = f"; it said: {said[-1]}" if said else ""
            raise BusError(f"--controller {command}: the command drove no cycle: {_no_cycle(end, process)}{words}")
        return _evidence(cell, motion, folder / CAN_LOG_FILE, end, injected_cycle, last_cycle)


def words_of(command: str) -> list[str]:
    """The words of a command line, split as by a shell. Raises `UsageError` if empty or malformed."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"--controller {command}: cannot be read as a shell does: {first_line(error)}") from None
    if not words:
        raise UsageError(f"--controller {shlex.quote(command)}: is empty; write a command")
    return words


def require_whole(twin: Evidence, scenario: Scenario, cell: Cell, command: str) -> None:
    """Refuse a controller whose fault-free run ends before the observation: its end would look like a reaction.

    Raises `UsageError`.
    """
    _, last_cycle = _watched_cycles(scenario, cell)
    end = next((each for each in twin.notices if each.detector in END_OF_DRIVING and each.cycle > 0), None)
    if end is None:
        return
    watched_s, driven_s = last_cycle * cell.bus.cycle_s, (end.cycle + 1) * cell.bus.cycle_s
    raise UsageError(
        f"--controller {command}: without any fault it ends by itself after {driven_s:.3g} s ({end.detector}), but has "
        f"to be watched for more than {watched_s:.3g} s: give the controller a longer run, {math.ceil(watched_s) + 1} s"
    )


def _watched_cycles(scenario: Scenario, cell: Cell) -> tuple[int, int]:
    """The cycle in which the fault begins, and the last one."""
    injected_cycle = round(scenario.at_s / cell.bus.cycle_s)
    return injected_cycle, injected_cycle + round(OBSERVED_S / cell.bus.cycle_s)


def _no_cycle(end: str, process: subprocess.Popen[bytes]) -> str:
    return f"ended with status {process.returncode}" if end == ENDED else f"no SYNC within {FIRST_SYNC_S:g} s"


def _emulator_arguments(scenario: Scenario, folder: Path, with_wire: bool) -> list[str]:
    arguments = ["--cell", scenario.cell, "--clock", "sync", "--seed", str(scenario.seed), "--out", str(folder)]
    arguments += ["--serve", f"{DEFAULT_HOST}:0"]
    for option, pairs in (("--set", scenario.settings), ("--truth", scenario.truth)):
        for key, value in pairs:
            arguments += [option, f"{key}={value}"]
    return [*arguments, "--wire"] if with_wire else arguments


def _script(fault: MatrixCell, cycle: int) -> FaultScript:
    return FaultScript((FaultSet(fault.name, (FaultSpec(fault.tap, fault.fault),), Trigger(cycle=cycle)),))


@contextlib.contextmanager
def _started(command: str, port: str, said: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The controller in its own process group, which is killed on exit."""
    words = [word.replace("{host}", DEFAULT_HOST).replace("{port}", port) for word in words_of(command)]
    environment = {**os.environ, "CANARM_CONNECT": f"{DEFAULT_HOST}:{port}"}
    process: subprocess.Popen[bytes] | None = None
    try:
        try:
            with said.open("wb") as output, signals_held_back():
                process = subprocess.Popen(
                    words,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                    env=environment,
                )
        except OSError as error:
            raise UsageError(f"--controller {command}: cannot be started: {first_line(error)}") from None
        yield process
    finally:
        if process is not None:
            _end_group(process)


def _end_group(process: subprocess.Popen[bytes]) -> None:
    try:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(END_S)
    finally:  # what is left of the group, also if the wait is interrupted
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _watch(process: subprocess.Popen[bytes], truth: Path, last_cycle: int) -> str:
    """Wait for the last cycle (""), the end of the process (`ENDED`), or a standstill (`SILENT`)."""
    moved_s, limit_s, tick = time.monotonic(), FIRST_SYNC_S, 0
    while tick < last_cycle:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(LOOK_S)
        is_over, before, tick = process.returncode is not None, tick, _last_tick(truth)
        if tick > before:
            moved_s, limit_s = time.monotonic(), SILENT_S
        elif is_over:
            return ENDED
        elif time.monotonic() - moved_s > limit_s:
            return SILENT
    return ""


def _settle(truth: Path) -> None:
    """The emulator lets time run on after the controller has left; wait until it has stopped writing."""
    limit_s, still_s = time.monotonic() + SILENT_S, time.monotonic()
    size = 0
    while time.monotonic() < min(still_s + 10 * LOOK_S, limit_s):
        time.sleep(LOOK_S)
        if truth.exists() and truth.stat().st_size != size:
            size, still_s = truth.stat().st_size, time.monotonic()


def _last_tick(truth: Path) -> int:
    """The last cycle in the file; 0 before there is one."""
    try:
        with truth.open("rb") as file:
            file.seek(max(0, truth.stat().st_size - 4096))
            words = file.read().rsplit(b"\n", 2)[-2].split(b",")
        return int(words[0])
    except (OSError, ValueError, IndexError):
        return 0


def _evidence(cell: Cell, motion: Motion, log: Path, end: str, injected_cycle: int, last_cycle: int) -> Evidence:
    frames = [each for each in _frames(log) if each.time_s < motion.time_s[-1] + cell.bus.cycle_s]
    notices = reactions(cell, frames, motion.cycle, motion.time_s)
    notices = [each for each in notices if each.cycle < last_cycle]
    if end and motion.cycle[-1] < last_cycle:
        notices.append(Notice(end, "", cycle_at(motion.time_s[-1], motion.cycle, motion.time_s), end, stops=True))
    return Evidence(
        motion=motion,
        seen=seen_by_controller(cell, frames, motion.time_s),
        notices=tuple(notices),
        injected_cycle=injected_cycle,
        is_running=not any(each.stops and each.cycle >= injected_cycle for each in notices),
    )


def _motion(truth: Path, joints: int, last_cycle: int) -> Motion | None:
    """The truth up to the last cycle; None if no cycle was driven."""
    lines = truth.read_text(encoding="ascii").splitlines()[1:] if truth.exists() else []
    if not lines:
        return None
    rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    reached = np.flatnonzero(rows[:, 0] >= last_cycle)
    if reached.size:
        rows = rows[: reached[0] + 1]
    true = rows[:, 3:].reshape(len(rows), joints, _TRUE_COLUMNS)
    return motion_of(rows[:, 0].astype(np.int64), rows[:, 2], true, np.full((len(rows), joints), np.nan))


def _frames(log: Path) -> Iterator[Received]:
    """The frames of a candump log, without error frames."""
    for line in log.read_text(encoding="ascii").splitlines():
        stamp, _, text = line.split()
        identifier, _, data = text.partition("#")
        is_extended, is_remote = len(identifier) > _STANDARD_DIGITS, data.startswith("R")
        payload = b"" if is_remote else bytes.fromhex(data)
        yield Received(_log_time_s(stamp), Frame(int(identifier, 16), payload, is_extended, is_remote))


def _log_time_s(stamp: str) -> float:
    """Time since power-on of `(seconds.microseconds)`, the nearest float to it."""
    seconds, _, fraction = stamp.strip("()").partition(".")
    return float(f"{int(seconds) - LOG_START_S}.{fraction}")
