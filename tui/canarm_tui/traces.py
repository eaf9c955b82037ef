"""The traces of all joints in rows and columns: which lines each of them shows. Draws what it is given."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import VerticalScroll

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable

from .drawn import Drawing
from .event_texts import marks_of
from .events import Happening
from .signals import Signal
from .snapshot import Snapshot
from .timeline import Timeline
from .trace import PARTS, Shown, Trace, TraceScene

MOST_COLUMNS = 3
SHARING_TRACES = 3
"""Traces of up to this many joints share the space; more have a fixed height and scroll."""
LONGEST_NAME = 24


class Traces(VerticalScroll, Drawing):
    """A row of traces per joint, a column per signal."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"trace--{name}" for name in PARTS}
    DEFAULT_CSS = """
    Traces { layout: grid; grid-size: 1; grid-rows: 1fr; grid-gutter: 0; height: 1fr; width: 1fr; }
    Traces.-many { grid-rows: 8; }
    Traces .trace--first { color: $text-primary; }
    Traces .trace--second { color: $text-warning; }
    Traces .trace--limit { color: $text-error 70%; }
    Traces .trace--scale { color: $foreground 60%; }
    Traces .trace--cursor { background: $foreground 25%; text-style: bold; }
    Traces .trace--good { color: $text-success; }
    Traces .trace--warning { color: $text-warning; text-style: bold; }
    Traces .trace--bad { color: $text-error; text-style: bold; }
    """

    def __init__(self, cell: Cell) -> None:
        super().__init__(id="traces", can_focus=False)
        self._cell, self._names = cell, cell.joint_names
        self._traces: list[list[Trace]] = []

    def compose(self) -> ComposeResult:
        """All traces that there may be."""
        self._traces = [[Trace(name, place) for place in range(MOST_COLUMNS)] for name in self._names]
        for row in self._traces:
            yield from row

    def set_out(self, columns: int, only: int | None) -> None:
        """So many columns, and one row if `only` one joint is to be seen."""
        self.styles.grid_size_columns = columns
        self.set_class(len(self._names) > SHARING_TRACES and only is None, "-many")
        for joint, row in enumerate(self._traces):
            for place, trace in enumerate(row):
                trace.display = place < columns and only in (None, joint)

    def show(
        self,
        snapshot: Snapshot,
        timeline: Timeline,
        bounds: tuple[int, int],
        signals: Sequence[Signal],
        happened: tuple[Happening, ...],
        over: tuple[int, int] | None,
    ) -> None:
        """Show the cycles of `bounds`, a signal per column; `over` are two joints that are shown over each other."""
        first, last = bounds
        names = [printable(name, LONGEST_NAME) for name in self._names]
        for joint, row in enumerate(self._traces):
            marks = marks_of(happened, self._names[joint], self._names)
            for signal, trace in zip(signals, row, strict=False):
                if not trace.display:
                    continue
                if over is None:
                    shown = tuple(Shown(joint, names[joint], line) for line in signal.lines)
                else:
                    shown = tuple(Shown(each, names[each], signal.lines[0]) for each in over)
                trace.show(
                    TraceScene(
                        *(snapshot.history, snapshot.error_lsb, first, last, timeline.cursor, self._cell.bus.cycle_s),
                        *(signal, shown, signal.limits(self._cell.joints[joint]), snapshot.joints[joint], marks),
                        has_axis=over is not None or joint == len(self._names) - 1 or self.has_class("-many"),
                    )
                )

    def reveal(self, joint: int) -> None:
        """Scroll to the traces of `joint`."""
        self._traces[joint][0].scroll_visible(animate=False)
