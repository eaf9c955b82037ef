"""The rigs of a test: made as the options say, in this process or over a bus, and finished after it."""

from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pytest

from ..bus_choice import BusChoice
from ..rig.bus_rig import BusRig
from ..rig.recorded import RecordedHistory, recorded_joints
from ..rig.rig import Rig
from ..rig.rig_faults import plainly
from ..rig.run_plot import plot_run
from ..session import DEFAULT_CELL
from .keeping import Keeper, fault_complaints, fault_lines

MOST_EVENTS = 20
"""The first events, nearest to the cause, that the report of a failure shows."""


class RigFactory:
    """The fixture `canarm_rig`: called with the arguments of `canarm.Rig`, it returns a rig of this test.

    With --canarm-bus it is a `canarm.rig.bus_rig.BusRig`.
    """

    def __init__(self, keeper: Keeper, config: pytest.Config) -> None:
        self._keeper = keeper
        self._seed: int = config.getoption("--canarm-seed")
        bus: str | None = config.getoption("--canarm-bus")
        self._kind: type[Rig | BusRig] = Rig if bus is None else BusRig.over(BusChoice.parse(bus))
        self._rigs: list[Rig | BusRig] = []

    def __call__(self, cell: Any = DEFAULT_CELL, *arguments: str, **options: Any) -> Any:
        """A rig. Its seed is --canarm-seed unless given in `options`; its run folder is kept on failure."""
        __tracebackhide__ = True
        words = [*map(repr, (cell, *arguments)), *(f"{name}={value!r}" for name, value in options.items())]
        options = {"seed": self._seed, "out": self._keeper.new_folder(), **options}
        rig = plainly(lambda: self._kind(cell, *arguments, **options))
        self._rigs.append(rig)
        if rig.unused is not None:
            rig.unused.is_used()  # it is finished after the test, which warns
        folder = None if options["out"] is None else Path(options["out"]).absolute()
        self._keeper.watch(_RigRun(rig, folder, f"canarm_rig({', '.join(words)})"))
        return rig

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish every rig; the first error is raised after all are finished."""
        first: Exception | None = None
        for rig in self._rigs:
            try:
                rig.finish()
            except Exception as caught:
                first = first or caught
        if first is not None:
            raise first


class _RigRun:
    """A rig as a run to be kept."""

    def __init__(self, rig: Rig | BusRig, folder: Path | None, label: str) -> None:
        self._rig, self.folder, self.label = rig, folder, label

    def end(self) -> None:
        """Finish the rig."""
        self._rig.finish()

    def plot(self, title: str) -> str:
        """Its joints, with faults and detections, from its folder: a rig's memory is bounded (`history_s`)."""
        assert self.folder is not None
        joints = recorded_joints(self._rig.cell, RecordedHistory(self._rig.cell, self.folder, {}))
        return plot_run(title, joints, self._rig.begun, self._rig.noticed)

    def story(self) -> str:
        """Faults and detections with their times, and the reason of a stop."""
        faults = fault_lines(self._rig.fault_events)
        seen = [(each.time_s, f"detected: {each.detection}") for each in self._rig.noticed]
        lines = [f"{time_s:9.4f} s  {text}" for time_s, text in sorted(faults + seen, key=lambda each: each[0])]
        if len(lines) > MOST_EVENTS:
            lines[MOST_EVENTS:] = [f"and {len(lines) - MOST_EVENTS} more, in events.jsonl"]
        end = [] if self._rig.reason is None else [f"stopped: {self._rig.reason}"]
        never = [f"fault never began: {name}" for name in self._rig.never_begun or ()]
        return "\n".join([*lines, *never, *end]) or "no faults, nothing detected"

    def complaints(self) -> list[str]:
        """Faults that never began, or were themselves faulty."""
        return fault_complaints(self._rig.never_begun or (), self._rig.fault_events)
