"""The traces of all joints in rows and columns: which lines each of them shows. Draws what it is given."""

from collections.abc import Sequence
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.events import Resize

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable

from .drawn import Drawing
from .event_texts import marks_of
from .events import Happening
from .signals import Signal
from .snapshot import Snapshot
from .texts import Tone, Word
from .timeline import Timeline
from .trace import PARTS, Shown, Trace, TraceScene
from .widgets import WordLine

MOST_COLUMNS = 3
SHARING_TRACES = 3
"""Traces of up to this many joints share the space; more have a fixed height and scroll."""
FIXED_ROWS = 8
TITLE, LEAST_PLOT, AXIS = 1, 3, 1
"""Rows of a trace. With fewer of the plot than that, line, limits and signs are the same dots."""
NO_ROOM = Word("no room for traces here: a higher terminal shows them", Tone.DIM)
LONGEST_NAME = 24


class Traces(VerticalScroll, Drawing):
    """A row of traces per joint, a column per signal."""

    COMPONENT_CLASSES: ClassVar[set[str]] = {f"trace--{name}" for name in PARTS}
    DEFAULT_CSS = """
    Traces { layout: grid; grid-size: 1; grid-gutter: 0; height: 1fr; width: 1fr; }
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
        self._columns, self._chosen, self._is_alone = 1, 0, False
        self._rows = range(0)
        self._told: tuple[Any, ...] = ()

    def compose(self) -> ComposeResult:
        """All traces that there may be, and what is said where there is room for none."""
        yield WordLine(id="no-room")
        self._traces = [[Trace(name, place) for place in range(MOST_COLUMNS)] for name in self._names]
        for row in self._traces:
            yield from row

    def set_out(self, columns: int, chosen: int, is_alone: bool) -> None:
        """So many columns, and a row per joint, or one alone: that of the `chosen` one, which is always among them."""
        self._columns, self._chosen, self._is_alone = columns, chosen, is_alone
        self._fit()

    def on_resize(self, event: Resize) -> None:
        """Lines above come and go."""
        self._fit()
        if self._told:
            self.show(*self._told)

    def _fit(self) -> None:
        """As many rows of traces as can be read."""
        room, count = self.size.height, 1 if self._is_alone else len(self._names)
        heights = heights_of(count, room)
        self.styles.grid_size_columns = self._columns
        self.styles.grid_rows = " ".join(map(str, heights or [1]))
        shown = len(heights)
        first = self._chosen if self._is_alone else min(self._chosen, count - shown)
        self._rows = range(first, first + shown)
        no_room = self.query_one(WordLine)
        no_room.show((NO_ROOM,))
        no_room.display = not shown and room > 0
        for joint, row in enumerate(self._traces):
            for place, trace in enumerate(row):
                trace.display = place < self._columns and joint in self._rows

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
        self._told = snapshot, timeline, bounds, signals, happened, over
        first, last = bounds
        names = [printable(name, LONGEST_NAME) for name in self._names]
        for joint, row in enumerate(self._traces):
            marks = marks_of(happened, self._names[joint], self._names)
            for signal, trace in zip(signals, row, strict=False):
                if joint not in self._rows:
                    continue
                if over is None:
                    shown = tuple(Shown(joint, names[joint], line) for line in signal.lines)
                else:
                    shown = tuple(Shown(each, names[each], signal.lines[0]) for each in over)
                trace.show(
                    TraceScene(
                        *(snapshot.history, snapshot.error_lsb, first, last, timeline.cursor, self._cell.bus.cycle_s),
                        *(signal, shown, signal.limits(self._cell.joints[joint]), snapshot.joints[joint], marks),
                        has_axis=joint == self._rows[-1] or len(self._rows) > SHARING_TRACES,
                    )
                )

    def reveal(self, joint: int) -> None:
        """Scroll to the traces of `joint`."""
        self._traces[joint][0].scroll_visible(animate=False)


def heights_of(count: int, room: int) -> list[int]:
    """The rows of each of up to `count` traces over each other in `room` rows; none where not one can be read."""
    if count > SHARING_TRACES:
        return [min(FIXED_ROWS, room)] * count if room >= TITLE + LEAST_PLOT + AXIS else []
    shown = min(count, max(room - AXIS, 0) // (TITLE + LEAST_PLOT))
    if not shown:
        return []
    each, more = divmod(room - AXIS, shown)
    heights = [each + (place < more) for place in range(shown)]
    heights[-1] += AXIS
    return heights
