"""What all rigs share, in one process or over a bus: their arguments, and questions about faults and detections.

How a run is carried out is not known here.
"""

import warnings
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from canarm_controller.laws.loading import law_name
from canarm_controller.reference.trajectory import trajectory_name
from canarm_controller.run.state import State
from canarm_controller.supervision.detection import Detection
from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.runs.tentative import Tentative
from canarm_protocol.shown import printable

from ..libraries import data_frame
from ..notebook import display
from ..session import DEFAULT_CELL, DEFAULT_LAW
from .arguments import (
    RigWarning,
    Unused,
    as_text,
    checked_feedforward,
    checked_folder,
    checked_seed,
    checked_switch,
    known_arguments,
)
from .findings import Begun, Detected, Noticed, ask_detected, begun_of, check_question
from .picture import Picture
from .rig_faults import FaultControl, FaultSource
from .rig_joint import SIGNALS, Joints
from .run_plot import plot_run


class AnyRig(FaultControl):
    """The arguments of every rig, kept for `_open`."""

    cell: Cell
    joints: Joints
    unused: Unused | None = None
    """What warns of a rig that is never run."""

    @known_arguments
    def __init__(
        self,
        cell: str | Path | Cell = DEFAULT_CELL,
        law: object = DEFAULT_LAW,
        trajectory: object = None,
        *,
        feedforward: str | None = None,
        seed: int = 0,
        wire: bool = False,
        truth: Mapping[str, object] | None = None,
        settings: Mapping[str, object] | None = None,
        faults: FaultSource | None = None,
        history_s: float = 60.0,
        out: Path | str | None = None,
    ) -> None:
        super().__init__()
        self._law, self._trajectory, self._feedforward = law, trajectory, checked_feedforward(feedforward)
        self._seed, self._wire = checked_seed(seed), checked_switch("wire", wire)
        self._true_settings = as_text("truth", truth)
        self._history_s, self._out = history_s, checked_folder(out)
        self.fault_events: list[FaultEvent] = []
        """Beginnings and ends of faults; oldest first."""
        self.noticed: list[Noticed] = []
        """Detections with their times; oldest first."""
        self._made = Tentative()
        try:
            self._open(cell, settings)
            if faults is not None:
                self.inject_file(faults)
        except Exception:
            self._used()
            self._close_files()
            self._made.take_back()
            raise
        self._made.keep()

    @abstractmethod
    def _open(self, cell: str | Path | Cell, settings: Mapping[str, object] | None) -> None:
        """Build what a run needs, with `settings` applied to the cell."""

    def _used(self) -> None:
        if self.unused is not None:
            self.unused.is_used()

    @abstractmethod
    def _close_files(self) -> None:
        """Let go of the run folder, of which nothing stays: the arguments were wrong."""

    @property
    @abstractmethod
    def state(self) -> State:
        """The controller's state."""

    @property
    def begun(self) -> list[Begun]:
        """Beginnings of faults; oldest first."""
        return begun_of(self.fault_events)

    @property
    def detections(self) -> list[Detection]:
        """The controller's detections; oldest first."""
        return [each.detection for each in self.noticed]

    def detected(self, name: str | None = None, joint: str | None = None, *, since: float | None = None) -> Detected:
        """What detector `name` has detected at `joint` (None: any); true if there is anything.

        `.within(0.025)` asks whether the first detection after the latest fault began came no later than that; with
        `since`, in s of virtual time, only later detections count, from that time. `joint` may be a card or node
        ("0x14"). Raises `UsageError` for an unknown detector, joint or node.
        """
        __tracebackhide__ = True
        check_question(self.cell, name, joint, since)
        return ask_detected(self.noticed, self.begun, name, joint, since)

    def to_dataframe(self, library: str = "pandas") -> Any:
        """The histories as a DataFrame of pandas or polars: `cycle`, `time_s`, `joint2.true_angle_rad`, …

        A row per controlled cycle that is kept. Raises `MissingLibraryError` where the library is not installed.
        """
        __tracebackhide__ = True
        columns: dict[str, Any] = {}
        for name, joint in self.joints.items():
            for signal in SIGNALS:
                span = joint.span(signal)
                size = len(joint.reference_rad)
                columns.setdefault("cycle", span.cycle[:size])
                columns.setdefault("time_s", span.time_s[:size])
                columns[f"{name}.{signal}"] = span.value[:size]
        return data_frame(columns, library)

    def plot(self, title: str = "") -> Picture:
        """The figure of the pytest plugin, as SVG text, which notebooks show: angles, speeds, currents of every joint.

        Around faults and detections if there are any, else the whole run.
        """
        return plot_run(title or repr(self).strip("<>"), self.joints, self.begun, self.noticed)

    def _warn_unwritten(self, text: str) -> None:
        warnings.warn(text if self._out is None else self._out.said(text), RigWarning, 2)

    def _repr_html_(self) -> str:
        """A small display for notebooks: what it is, the figures of the joints so far, and its figure."""
        joints = {name: joint.known_figures() for name, joint in self.joints.items()}
        events = sorted(
            [(each.time_s, f"fault: {each.text}") for each in self.begun]
            + [(each.time_s, f"detected: {each.text}") for each in self.noticed]
        )
        reason = getattr(self, "reason", None)  # a property of one rig, an attribute of the other
        lines = [*([str(reason)] if reason else []), *(text for _, text in events)]
        return display(repr(self).strip("<>"), lines, joints, self.plot())

    def __repr__(self) -> str:
        what = f"{self.cell.name}, {law_name(self._law)} on {trajectory_name(self._trajectory)}, seed {self._seed}"
        cycles = next((len(joint.reference_rad) for joint in self.joints.values()), 0)
        return printable(f"<{type(self).__name__} {what}: {self.state.name.lower()}, {cycles} cycles kept>")

    def __enter__(self) -> Self:
        return self
