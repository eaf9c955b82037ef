"""`canarm replay`: a recorded run once more, on a bus, or checked byte for byte."""

import itertools
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from canarm_protocol.canopen.frames import Cob
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import ExitStatus
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.run_folder import CAN_LOG_FILE, RunFolderError

from ..options import BusOptions, Flag, MoreBusWords, multiple_or_max, named_file
from ..runs.again import emulator_again, untold_faults
from ..runs.decoding import Decoder
from ..runs.replaying import Answers, of_master, replay_lockstep, replay_timed, without_errors
from ..runs.run import Run
from ..usage import UsageError

SLOWEST_SPEED = 1e-3


def replay(
    run: Annotated[Path, Parameter(name="RUN", converter=named_file, help="A run folder, or a candump log.")],
    /,
    *bus_options: MoreBusWords,
    check: Annotated[
        Flag, Parameter(help="Run it again in lockstep, and compare can0 byte for byte; a difference is status 1.")
    ] = False,
    law: Annotated[
        str | None, Parameter(metavar="NAME|FILE.py:CLASS", help="With --check: the law, instead of the recorded one.")
    ] = None,
    trajectory: Annotated[
        str | None, Parameter(metavar="NAME|FILE", help="With --check: the trajectory, instead of the recorded one.")
    ] = None,
    bus: BusOptions = BusOptions(),
    speed: Annotated[
        float,
        Parameter(
            metavar="X|max",
            converter=multiple_or_max("the recorded speed", SLOWEST_SPEED),
            help="So many times as fast as recorded; max waits for nothing.",
        ),
    ] = 1.0,
    master: Annotated[
        Flag,
        Parameter(
            help="Only what the master sent, no frames of cards: it drives an emulator again. In lockstep, each SYNC "
            "waits for its TIME."
        ),
    ] = False,
    cell: Annotated[
        str | None,
        Parameter(metavar="NAME|FILE", help="With --master: the cell whose cards are left out; else the run's own."),
    ] = None,
) -> int:
    """Send the recorded frames of can0 to a bus again, or run the run again and compare.

    --check takes cell, seed, truth, faults, law and trajectory from run.json. A law or trajectory in a file has to be
    named: nothing that a run folder names is executed.
    """
    if check:
        if bus.named(bus_options) is not None or master or cell is not None:
            raise UsageError("replay --check: runs in this process; leave the options of a bus out")
        return _check(Run(run), law, trajectory)
    if law is not None or trajectory is not None:
        raise UsageError("replay: --law and --trajectory are for --check; frames are sent as they were recorded")
    return _send(run, bus, bus_options, speed, master, cell)


def _check(run: Run, law: str | None, trajectory: str | None) -> int:
    from ..provenance import differences
    from ..runs.repeating import check_again

    if not (run.path / CAN_LOG_FILE).is_file():
        raise RunFolderError(f"{run.path}: has no {CAN_LOG_FILE}; there is nothing to compare with")
    with tempfile.TemporaryDirectory() as name:
        found = check_again(run, Path(name) / "again", law, trajectory)
    untold = untold_faults(run)
    for text in (each for each in run.complaints if not untold or each not in run.damaged_events):
        _tell(text)
    if untold:
        _tell(f"{untold}; repeated without them")
    print(found.text)
    if not found.is_same and (others := differences(run.made_by)):
        _tell(f"its numbers may be rounded otherwise here: it was made with {', '.join(others)}")
    return ExitStatus.DONE if found.is_same else ExitStatus.FAILED


def _send(
    path: Path, bus: BusOptions, bus_options: Sequence[str], speed: float, master: bool, cell_name: str | None
) -> int:
    named = bus.named(bus_options)
    if named is None:
        raise UsageError(
            "replay: to which bus? -i canarm -c can0 is that of an emulator here, -i socketcan -c vcan0 another; or "
            "--check, which needs none"
        )
    run = Run(path) if path.is_dir() else None
    log = path / CAN_LOG_FILE if run is not None else path
    if not log.is_file():
        raise RunFolderError(f"{log}: there is no such file; a candump log is what is replayed")
    if next(log_frames(log), None) is None:
        raise RunFolderError(f"{log}: has no frames; is it a candump log?")
    complaints: list[str] = []
    frames = without_errors(log_frames(log, complaints.append))
    decoder = Decoder(_cell(run, cell_name)) if master else None
    if decoder is not None:
        frames = of_master(frames, decoder)
    first = next(frames, None)
    if first is None:
        raise RunFolderError(f"{log}: the master has sent nothing in it")
    frames = itertools.chain([first], frames)
    answers = None
    if decoder is not None and any(frame.can_id == Cob.TIME for _, frame in log_frames(log)):
        answers = Answers(log_frames(log), decoder)
        _tell_what_it_needs(run)
    with named.open() as port:
        done = replay_timed(frames, port, speed) if answers is None else replay_lockstep(frames, port, answers)
    for text in complaints:
        _tell(text)
    if answers is not None and decoder is not None:
        _tell(_compared(answers, decoder))
    late = f"; the last one {done.late_s * 1e3:.0f} ms late" if done.late_s > 0.01 and math.isfinite(speed) else ""
    print(f"{done.frames} frames sent{late}")
    return ExitStatus.DONE


def _tell_what_it_needs(run: Run | None) -> None:
    """Without its seed, truth and faults the emulator answers otherwise, and nobody would know why."""
    again = None if run is None else emulator_again(run)
    if again is None:
        return
    _tell(f"the cards answer the same if their emulator began with what it had then: {again.line}")
    for text in again.remarks:
        _tell(text)


def _compared(answers: Answers, decoder: Decoder) -> str:
    if answers.difference is None:
        return f"the cards have answered as recorded: {answers.same} frames of theirs are the same"
    number, then, now = answers.difference
    return f"frame {number} is the first that differs: recorded {decoder.text(then)}, now {decoder.text(now)}"


def _cell(run: Run | None, name: str | None) -> Cell:
    if name is not None:
        return load_cell(name, {})
    if run is None:
        raise UsageError("replay --master: which cards are not to be sent for? name their cell with --cell")
    return run.cell


def _tell(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr)
