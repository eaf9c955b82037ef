"""A run as its folder tells of it: configuration, summary, signals, frames and events, as far as they can be read.

Nothing is written here, and nothing that a folder names is loaded or run.
"""

import math
import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from canarm_controller.bus.assessment import JointFigures
from canarm_controller.run.recording import SIGNALS_FILE as CONTROLLER_FILE
from canarm_emulator.serving.recording import POWER_ON_S, SCRIPT
from canarm_emulator.serving.recording import SIGNALS_FILE as ROBOT_FILE
from canarm_protocol.canopen.frames import ERROR_FLAG
from canarm_protocol.cell.cell_file import recorded_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import CanarmError
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.run_events import event_lines
from canarm_protocol.runs.run_folder import (
    BENCH_LOG_FILE,
    CAN_LOG_FILE,
    EVENTS_FILE,
    RUN_FILE,
    SIGNALS_FOLDER,
    SUMMARY,
    RunFolderError,
    read_run_file,
    why_no_folder,
)
from canarm_protocol.shown import printable, printable_lines, quoted

from ..libraries import check_library, data_frame
from ..notebook import display
from ..recording import FAILED_RECORDING
from ..rig.findings import Noticed, begun_of
from ..rig.picture import Picture
from ..rig.recorded import DETECTION, RecordedHistory, fault_events, noticed, recorded_joints
from ..rig.run_plot import plot_run
from ..signal_table import JOINED_BY, Columns, joined, read_table
from ..summary import after_emergency_stop
from ..usage import UsageError

PARTS = (RUN_FILE, CAN_LOG_FILE, EVENTS_FILE, SIGNALS_FOLDER)
"""A folder without any of these is no run folder."""
EMULATOR_SUMMARY = "emulator_summary"
SCRIPT_TEXT = "toml"
"""The key of an event that has the text of a fault file."""
_QUOTED_KEY = re.compile(r'^"([a-z_]+)"(?= = )', re.MULTILINE)
TOLD = ("time_s", "cycle", "source", "event", POWER_ON_S)
"""What every event says."""
MAKERS = ("controller", "rig", "emulator")
"""Sections of `run.json` that say how a run was made."""


def open_run(path: Path | str, library: str = "pandas") -> "Run":
    """The run in the folder `path`; `library`, "pandas" or "polars", is that of its DataFrames.

    Raises `RunFolderError` if there is no run, and `UsageError` for what is no path or library. What cannot be read of
    a run is left out, and stands in `Run.complaints`.
    """
    if not isinstance(path, str | Path):
        raise UsageError(f"open_run: {quoted(path)}: must be the path of a run folder")
    return Run(Path(path), check_library(library))


class Run:
    """A recorded run. Files are read when they are asked for, once."""

    def __init__(self, path: Path, library: str = "pandas") -> None:
        self.path, self._library = path, library
        self.complaints: list[str] = []
        """What could not be read so far, a line each."""
        self.damaged_events: list[str] = []
        """Those complaints that say that events are lost; known when `event_list` has been read."""
        try:
            is_folder = path.is_dir()
        except OSError as error:
            raise RunFolderError(f"{printable(str(path), 80)}: cannot be read: {error.strerror}") from None
        if not is_folder:
            raise RunFolderError(f"{path}: {why_no_folder(path)}; a run is a folder with {RUN_FILE}")
        if not any((path / part).exists() for part in PARTS):
            raise RunFolderError(f"{path}: is no run folder: it has none of {', '.join(PARTS)}")

    @cached_property
    def configuration(self) -> dict[str, Any]:
        """`run.json`; empty if it cannot be read. A recording that broke off is a complaint."""
        try:
            read = read_run_file(self.path)
            if broke_off(read):
                self._complain(f"the recording broke off: {broke_off(read)}")
            return read
        except RunFolderError as error:
            self._complain(str(error).removeprefix(f"{self.path}/"))
            return {}

    @property
    def summary(self) -> dict[str, Any]:
        """The summary of the run; empty if it has none, as while it goes on."""
        return self._section(SUMMARY)

    @property
    def made_by(self) -> dict[str, Any]:
        """Law, trajectory, seed, truth and so on: what the programs of the run were given."""
        found: dict[str, Any] = {}
        for name in reversed(MAKERS):
            found |= self._section(name)
        return found

    @cached_property
    def cell(self) -> Cell:
        """The cell of the run, as it was when it ran. Raises `RunFolderError`."""
        if not self.configuration:
            read_run_file(self.path)  # says why it cannot be read
        try:
            return recorded_cell(self.configuration.get("cell"), f"{self.path / RUN_FILE}: cell")
        except CanarmError as error:
            raise RunFolderError(str(error)) from None

    @cached_property
    def robot(self) -> Columns:
        """The emulator's table of signals, as numpy columns; empty without one."""
        return self._table(ROBOT_FILE)

    @cached_property
    def controller(self) -> Columns:
        """The controller's table of signals, as numpy columns; empty without one."""
        return self._table(CONTROLLER_FILE)

    def _table(self, name: str) -> Columns:
        found, cycles = read_table(self.path / SIGNALS_FOLDER / name, self._complain), self.summary.get("ticks")
        if found and not len(found[JOINED_BY]) and isinstance(cycles, int) and cycles > 0:
            self._complain(
                f"{name}: has no row of the run's {printable(str(cycles), 20)} cycles; a part may be missing"
            )
        return found

    @cached_property
    def columns(self) -> Columns:
        """Both tables as one, joined by `cycle`: see `canarm.signal_table.joined`."""
        return joined(self.robot, self.controller)

    @property
    def signals(self) -> Any:
        """`columns` as a DataFrame, in which cycles are integers. Raises `MissingLibraryError`."""
        cycles = self.columns.get(JOINED_BY, np.empty(0))
        is_whole = JOINED_BY in self.columns and (cycles == np.floor(cycles)).all()  # not so in a damaged table
        whole = {JOINED_BY: cycles.astype(np.int64)} if is_whole else {}
        return data_frame(self.columns | whole, self._library)

    @cached_property
    def event_list(self) -> list[dict[str, Any]]:
        """The events, in the order of their times."""
        path, damage = self.path / EVENTS_FILE, self.damaged_events
        events = event_lines(path, damage.append)
        if not path.exists():
            damage.append(f"{EVENTS_FILE}: is missing")
        elif not events and not damage and len(self.controller.get(JOINED_BY, ())):  # its states are events
            damage.append(f"{EVENTS_FILE}: has no event")
        for text in damage:
            self._complain(text)
        return events

    @property
    def events(self) -> Any:
        """The events as a DataFrame: time_s, cycle, source, event, and their details as one text."""
        rows = self.event_list
        columns: dict[str, Any] = {
            "time_s": np.array([each["time_s"] for each in rows], dtype=np.float64),
            "cycle": np.array([each["cycle"] for each in rows], dtype=np.int64),
            "source": [str(each.get("source", "")) for each in rows],
            "event": [each["event"] for each in rows],
            "details": [details_of(each, TOLD) for each in rows],
        }
        return data_frame(columns, self._library)

    @property
    def begin_s(self) -> float:
        """When cycle 0 was, after power-on; 0 if not known."""
        table = self.robot
        return float(table[POWER_ON_S][0] - table["time_s"][0]) if table.get(POWER_ON_S, np.empty(0)).size else 0.0

    @property
    def frames(self) -> Any:
        """The frames of can0 as a DataFrame: time_s, id, data (bytes), is_extended, is_remote, is_error."""
        return self._frames_in(CAN_LOG_FILE)

    @property
    def bench_frames(self) -> Any:
        """The frames of the bench's own bus, in the same columns; none unless they were recorded (`--record bench`)."""
        return self._frames_in(BENCH_LOG_FILE)

    def _frames_in(self, log: str) -> Any:
        begin_s = self.begin_s
        if log == CAN_LOG_FILE and not (self.path / log).exists():
            self._complain(f"{log}: is missing")
        found = list(log_frames(self.path / log, self._complain))
        is_error = [frame.can_id >= ERROR_FLAG for _, frame in found]
        columns: dict[str, Any] = {
            "time_s": np.array([time_ns * 1e-9 - begin_s for time_ns, _ in found], dtype=np.float64),
            "id": np.array([frame.can_id & (ERROR_FLAG - 1) for _, frame in found], dtype=np.uint32),
            "data": [frame.data for _, frame in found],
            "is_extended": np.array(
                [frame.is_extended and frame.can_id < ERROR_FLAG for _, frame in found], dtype=bool
            ),
            "is_remote": np.array([frame.is_remote for _, frame in found], dtype=bool),
            "is_error": np.array(is_error, dtype=bool),
        }
        return data_frame(columns, self._library)

    @cached_property
    def faults(self) -> list[FaultEvent]:
        """Beginnings and ends of faults; their times count from power-on."""
        return self._understood(fault_events)

    @cached_property
    def detections(self) -> list[Noticed]:
        """The controller's detections, with times from cycle 0."""
        return self._understood(_noticed_in_time)

    def plot(self, title: str = "") -> Picture:
        """The figure of the pytest plugin: angles, speeds and currents of every joint, faults and detections.

        Raises `RunFolderError` if the record has no cell.
        """
        begin_s = self.begin_s
        seen = [Noticed(each.time_s + begin_s, each.detection) for each in self.detections]
        none = dict.fromkeys(self.cell.joint_names, JointFigures(None, None, 0.0, 0, None))
        joints = recorded_joints(self.cell, RecordedHistory(self.cell, self.path, none, self._complain))
        return plot_run(title or printable(self.path.name), joints, begun_of(self.faults), seen)

    @property
    def reason(self) -> str | None:
        """Why the run has ended, as it was said; after an emergency stop that too. Not safe to print."""
        reason = self.summary.get("reason")
        said = None if reason is None else str(reason)
        if self.summary.get("state") != "failed":
            return said
        pressed = (
            each["time_s"]
            for each in self.event_list
            if each["event"] == "emergency-stop" and each.get("state") == "on" and each["cycle"] >= 0
        )
        stopped_s = next(pressed, None)
        return said if stopped_s is None else after_emergency_stop(stopped_s, said)

    @property
    def headline(self) -> str:
        """The run in a line: what ran, for how long, and how it ended. Safe to print."""
        said, made = self.summary, self.made_by
        cell = said.get("cell") or self._section("cell").get("name") or "an unknown cell"
        law, motion = said.get("law") or made.get("law"), said.get("trajectory") or made.get("trajectory")
        what = f"{law} on {motion}" if law else "no controller of ours"
        cycles = said.get("ticks")
        length = f"{cycles} cycles" if isinstance(cycles, int) else "without a summary"
        said_why = self.reason
        reason = f": {said_why}" if said_why else ""
        end = said.get("state", "unfinished")
        return printable(f"{cell}, {what}, seed {made.get('seed', '?')}: {end}, {length}{reason}", 300)

    def __repr__(self) -> str:
        return f"<Run {printable(str(self.path))}: {self.headline}>"

    def _repr_html_(self) -> str:
        """A small display for notebooks: the verdict of a report, figures, and the plot where the signals are whole."""
        from .report.story import verdict

        try:
            picture = self.plot() if self.columns else None
        except (CanarmError, ArithmeticError, LookupError, ValueError):
            picture = None
        joints = self.summary.get("joints")
        known = joints.items() if isinstance(joints, Mapping) else ()
        figures = {str(name): each for name, each in known if isinstance(each, Mapping)}
        return display(f"Run {self.path}: {self.headline}", verdict(self)[1], figures, picture)

    def _section(self, name: str) -> dict[str, Any]:
        found = self.configuration.get(name)
        return dict(found) if isinstance(found, Mapping) else {}

    def _understood(self, read: Any) -> list[Any]:
        found = []
        for event in self.event_list:
            try:
                found += read([event])
            except (KeyError, TypeError, ValueError, OverflowError):
                self._complain(f"{EVENTS_FILE}: an event {printable(event['event'])} is not what it is called")
        return found

    def _complain(self, text: str) -> None:
        text = printable(text, 400)
        if text not in self.complaints:
            self.complaints.append(text)


def broke_off(configuration: Mapping[str, Any]) -> str:
    """Why a recording broke off, as `run.json` tells; empty if it did not."""
    for name in (SUMMARY, EMULATOR_SUMMARY):
        section = configuration.get(name)
        reason = section.get("reason") if isinstance(section, Mapping) else None
        if isinstance(reason, str) and FAILED_RECORDING in reason:
            return reason.partition(FAILED_RECORDING)[2]
    return ""


def _noticed_in_time(events: list[dict[str, Any]]) -> list[Noticed]:
    """What only a run that has begun can have: raises `ValueError` for one without a time."""
    found = noticed(events)
    if not all(math.isfinite(each.time_s) for each in found):
        raise ValueError(f"a {DETECTION} before cycle 0")
    return found


def script_lines(event: Mapping[str, Any]) -> list[str]:
    """The fault script that an event holds, as lines that are safe to show; none of any other event."""
    text = event.get(SCRIPT_TEXT)
    if event.get("event") != SCRIPT or not isinstance(text, str):
        return []
    return printable_lines(_QUOTED_KEY.sub(r"\1", text.rstrip("\n"))).split("\n")


def shown_details(event: Mapping[str, Any]) -> tuple[str, list[str]]:
    """What else an event says beside time and name, safe to show: on one line, and a fault script line by line."""
    lines = script_lines(event)
    return details_of(event, (*TOLD, SCRIPT_TEXT) if lines else TOLD), lines


def details_of(event: Mapping[str, Any], plain: tuple[str, ...]) -> str:
    """What else an event says, as `key=value`, made safe to show."""
    said = (f"{key}={value if isinstance(value, str) else _plain(value)}" for key, value in event.items())
    return printable(" ".join(text for text, key in zip(said, event, strict=True) if key not in plain), 500)


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) and math.isfinite(value) else str(value)
