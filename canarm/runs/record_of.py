"""A run folder as the dashboard is given it: rows of both tables, events, how it ended. Nothing is drawn here."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.bench_objects import INTERNALS
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad
from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import EMERGENCY_STOP, StopEvent
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.run_folder import CAN_LOG_FILE, MEMORY_FILE, RUN_FILE, RunFolderError
from canarm_tui.bus.memory_mirror import BANK_BYTES, BANK_JOINTS
from canarm_tui.faults import Faults
from canarm_tui.history import COLUMNS, Column, History
from canarm_tui.notices import Kind, Notice
from canarm_tui.outcome import Outcome
from canarm_tui.record import Record

from ..rig.findings import Noticed
from ..signal_table import Columns
from .run import Run

MOST_ROWS = 1_000_000
"""More cycles than that, 40 minutes at 400 Hz, are thinned out."""
_TRUE = (
    (Column.ANGLE, "true_angle_rad"),
    (Column.SPEED, "true_speed_rad_s"),
    (Column.CURRENT, "motor_current_a"),
    (Column.COMMAND, "command_a"),
)
_REPORTED = (
    (Column.REFERENCE, "reference_rad"),
    (Column.MEASURED, "measured_rad"),
    (Column.MEASURED_SPEED, "measured_rad_s"),
    (Column.ASKED, "command_a"),
    (Column.FEEDFORWARD, "feedforward_nm"),
)
_OTHERS = {"reference_rad_s", "measured_a", *(name for _, name in _REPORTED)}


def record_of(run: Run, otherwise: Callable[[], Cell] | None = None) -> Record:
    """All that the dashboard shows of `run`; what could not be read is complained of.

    A run whose record has no cell is shown with the cell of `otherwise`, if its joints are those of the signals.
    Raises `RunFolderError` if there is none.
    """
    cell = _cell(run, otherwise)
    names = inner_names(run.controller, cell.joint_names)
    said = run.summary
    log = run.path / CAN_LOG_FILE
    history, faults, noticed = _history(run, cell, names), _faults(run), _noticed(run)
    how = run.headline if run.configuration else "how it went cannot be read"
    verdict = Outcome(how, said.get("state") == "done", [f"recorded in {run.path}", *run.complaints])
    return Record(
        cell=cell,
        where=str(run.path),
        history=history,
        faults=faults,
        noticed=noticed,
        outcome=verdict,
        law=str(said.get("law") or run.made_by.get("law") or ""),
        internal_names=names,
        frames=(lambda: log_frames(log)) if log.is_file() else None,
        memory=_memory(run, cell),
        complaints=tuple(run.complaints),
    )


def _cell(run: Run, otherwise: Callable[[], Cell] | None) -> Cell:
    try:
        return run.cell
    except RunFolderError as error:
        if otherwise is None:
            raise
        cell = otherwise()
        first = next(name for _, name in _TRUE)
        joints = [name.removesuffix(f".{first}") for name in run.robot if name.endswith(f".{first}")]
        if joints != list(cell.joint_names):
            known = f"its signals are of {', '.join(joints)}" if joints else "it has no signals of the robot either"
            raise RunFolderError(f"{error}; {known}; --cell names the cell that it was made with") from None
        run.complaints.append(f"{RUN_FILE} has no cell; shown with that of --cell, {cell.name}, as it is now")
        return cell


def _memory(run: Run, cell: Cell) -> bytes | None:
    """The memory image, if the run has one of the size that the cell's joints take."""
    path = run.path / MEMORY_FILE
    size = -(-len(cell.joints) // BANK_JOINTS) * BANK_BYTES
    try:
        return path.read_bytes() if path.is_file() and path.stat().st_size == size else None
    except OSError:
        return None


def inner_names(controller: Columns, joints: Sequence[str]) -> tuple[str, ...]:
    """What the law calls its own values: the columns of the first joint that every controller does not have."""
    first = f"{joints[0]}."
    own = (name.removeprefix(first) for name in controller if name.startswith(first))
    return tuple(name for name in own if name not in _OTHERS)[:INTERNALS]


def _history(run: Run, cell: Cell, inner: Sequence[str]) -> History:
    robot, controller = run.robot, run.controller
    base = robot if len(robot.get("cycle", ())) else controller
    if not len(base.get("cycle", ())):
        return History(np.zeros(0, dtype=np.int64), np.zeros((0, len(cell.joints), COLUMNS), dtype=np.float32))
    cycles = np.unique(base["cycle"].astype(np.int64))
    cycles = cycles[:: max(1, -(-len(cycles) // MOST_ROWS))]
    values = np.full((len(cycles), len(cell.joints), COLUMNS), np.nan, dtype=np.float32)
    own = tuple((Column.INTERNAL + place, name) for place, name in enumerate(inner))
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged row may hold any number
        for table, columns in ((robot, _TRUE), (controller, (*_REPORTED, *own))):
            _fill(values, cycles, table, columns, cell.joint_names)
    lsb_rad = np.array(position_steps_rad(cell))
    with np.errstate(invalid="ignore", over="ignore"):
        error = (values[:, :, Column.ANGLE] - values[:, :, Column.REFERENCE].astype(np.float64)) / lsb_rad
    values[:, :, Column.ERROR] = error
    for array in (cycles, values):
        array.flags.writeable = False
    return History(cycles, values)


def _fill(
    values: NDArray[np.float32],
    cycles: NDArray[np.int64],
    table: Columns,
    columns: Sequence[tuple[int, str]],
    joints: Sequence[str],
) -> None:
    """Write the columns of a table into the rows of their cycles."""
    if not len(table.get("cycle", ())):
        return
    own, rows = np.unique(table["cycle"].astype(np.int64), return_index=True)
    place = np.searchsorted(own, cycles).clip(max=len(own) - 1)
    there = own[place] == cycles
    for joint, name in enumerate(joints):
        for column, leaf in columns:
            found = table.get(f"{name}.{leaf}")
            if found is not None:
                values[there, joint, column] = found[rows[place[there]]]


def _faults(run: Run) -> Faults:
    return Faults(
        events=tuple(sorted(run.faults, key=lambda event: event.time_ns, reverse=True)),
        detections=tuple(_event(each, run.begin_s) for each in reversed(run.detections)),
        stops=tuple(
            StopEvent(round((each["time_s"] + run.begin_s) * 1e9), each["cycle"], each.get("state") == "on")
            for each in reversed(run.event_list)
            if each["event"] == EMERGENCY_STOP and math.isfinite(each["time_s"])
        ),
    )


def _noticed(run: Run) -> tuple[Notice, ...]:
    """The states of the controller."""
    found = []
    for each in run.event_list:
        if each["event"] == "state" and math.isfinite(each["time_s"]):
            state, reason = str(each.get("state")).lower().replace("_", " "), each.get("reason")
            what = f"controller {state}" + (f": {reason}" if reason else "")
            time_ns = round((each["time_s"] + run.begin_s) * 1e9)
            found.append(Notice(time_ns, each["cycle"], Kind.CONTROLLER, what, state == "failed"))
    return tuple(found)


def _event(each: Noticed, begin_s: float) -> DetectionEvent:
    found = each.detection
    time_ns = round((each.time_s + begin_s) * 1e9)
    return DetectionEvent(found.tick, found.detector, found.where, found.detail, found.reaction.value, time_ns)
