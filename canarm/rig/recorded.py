"""A run as recorded in its folder: histories, faults and detections of a run in other processes.

Reads the files of the emulator's and the controller's recorders; nothing is run or written here.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from canarm_controller.bus.assessment import JointFigures
from canarm_controller.run.recording import SIGNALS_FILE as CONTROLLER_FILE
from canarm_controller.supervision.detection import Detection, Reaction
from canarm_emulator.serving.recording import POWER_ON_S
from canarm_emulator.serving.recording import SIGNALS_FILE as ROBOT_FILE
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad
from canarm_protocol.faults.fault_events import FAULT_BEGINS, FAULT_ENDS, FaultEvent, event_from_plain
from canarm_protocol.runs.run_events import event_lines, runs_of
from canarm_protocol.runs.run_folder import EVENTS_FILE, SIGNALS_FOLDER

from ..signal_table import read_table
from .findings import Noticed
from .rig_joint import SIGNALS, TRUE_SIGNALS, Floats, Joints, RigJoint, Span

DETECTION = "detection"
"""Names of fault and detection events in events.jsonl."""
_COLUMNS = {"current_a": "motor_current_a"}
"""Column names that differ from those of the histories."""


class RecordedHistory:
    """The course of a run; see `canarm.rig.rig_joint.Source`. Without a controller's file there is only the truth."""

    def __init__(
        self,
        cell: Cell,
        folder: Path,
        figures: Mapping[str, JointFigures],
        complain: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._names, self._figures = cell.joint_names, figures
        none = {"cycle": np.empty(0), POWER_ON_S: np.empty(0)}
        self._robot = read_table(folder / SIGNALS_FOLDER / ROBOT_FILE, complain) or none
        self._controller = read_table(folder / SIGNALS_FOLDER / CONTROLLER_FILE, complain) or none
        self.controlled = min(len(self._controller["cycle"]), len(self._robot["cycle"]))
        """Number of controlled cycles."""

    def column(self, joint: int, signal: str) -> Floats:
        """One signal over the controlled cycles, oldest first."""
        return self._whole(joint, signal)[: self.controlled]

    def span(self, joint: int, signal: str) -> Span:
        """One signal with cycles and times; a true signal continues through the stop."""
        values = self._whole(joint, signal)
        if SIGNALS.index(signal) >= TRUE_SIGNALS:
            values = values[: self.controlled]
        size = len(values)
        return Span(self._robot["cycle"][:size].astype(np.int64), self._robot[POWER_ON_S][:size], values)

    def figures(self, joint: int) -> JointFigures:
        """The run's figures, as the controller read them from the bench at the end."""
        return self._figures.get(self._names[joint], JointFigures(None, None, 0.0, 0, None))

    def _whole(self, joint: int, signal: str) -> Floats:
        if signal == "time_s":
            return self._robot[POWER_ON_S]
        is_true = SIGNALS.index(signal) < TRUE_SIGNALS
        name = f"{self._names[joint]}.{_COLUMNS.get(signal, signal)}"
        return (self._robot if is_true else self._controller).get(name, np.empty(0))


def recorded_joints(cell: Cell, history: RecordedHistory) -> Joints:
    """The joints of a run, as `Rig.joints`."""
    return Joints(
        (name, RigJoint(history, index, name, step_rad))
        for index, (name, step_rad) in enumerate(zip(cell.joint_names, position_steps_rad(cell), strict=True))
    )


def read_events(folder: Path) -> list[dict[str, Any]]:
    """The events of an emulator's runs, run by run in the order of their times. A run may still be going on."""
    return [event for run in runs_of(folder) for event in event_lines(run / EVENTS_FILE)]


def fault_events(events: list[dict[str, Any]]) -> list[FaultEvent]:
    """Beginnings and ends of faults among `events`; their times count from power-on."""
    return [
        event_from_plain({**event, "time_ns": round(event[POWER_ON_S] * 1e9)})
        for event in events
        if event["event"] in (FAULT_BEGINS, FAULT_ENDS)
    ]


def noticed(events: list[dict[str, Any]]) -> list[Noticed]:
    """Detections among `events`."""
    return [
        Noticed(
            event["time_s"],
            Detection(event["detector"], event.get("at"), event["cycle"], event["detail"], Reaction(event["reaction"])),
        )
        for event in events
        if event["event"] == DETECTION
    ]
