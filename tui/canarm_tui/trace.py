"""One trace: a widget that draws a signal of a joint, or of two joints over each other, against the axis of time.

Only here do plots become styled text. It keeps nothing but the scene it draws.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.segment import Segment
from rich.style import Style
from textual.events import Click
from textual.message import Message
from textual.strip import Strip

from . import texts
from .braille import DOTS_X, decimate
from .drawn import Drawing, Drawn
from .event_texts import Mark
from .history import History
from .plot import LABEL_WIDTH, MARKED, Part, Plot, Stroke, columns_of, nice_range, nice_scale, plot_rows, time_row
from .signals import Line, Signal
from .snapshot import JointNow
from .styles import title_of
from .texts import Tone, Word

ROOM_BEYOND_LIMITS = 1.2
LATE_CYCLES = 64
"""Where a line has no newer value than so many cycles ago, none is given for now."""
PARTS = ("first", "second", "limit", "blank", "cursor", "scale", *(tone.value for tone in MARKED))
"""In the order of `Part`."""
_SIGNS = ("━", "┄")


@dataclass(frozen=True, slots=True)
class Shown:
    """One line of a trace: whose, and which."""

    joint: int
    name: str
    line: Line


@dataclass(frozen=True, slots=True, eq=False)
class TraceScene:
    """What a trace draws: `shown` lines of `signal` in the cycles `first` to `last`.

    It is drawn again when one of its fields is another object; `data` is one as soon as `history` has news.
    """

    history: History
    data: object
    first: int
    last: int
    cursor: int | None
    cycle_s: float
    signal: Signal
    shown: tuple[Shown, ...]
    limits: tuple[float, ...]
    now: JointNow
    marks: tuple[Mark, ...] = ()
    has_axis: bool = False

    def words(self) -> tuple[Word, ...]:
        """The title: values at the cursor, or now."""
        signal, name = self.signal, self.shown[0].name
        is_of_two = self.shown[-1].joint != self.shown[0].joint
        if self.cursor is None and len(self.shown) == 1 and signal.name == "error":
            return texts.trace_words(name, self.now)
        at = self.last if self.cursor is None else self.cursor
        when = () if self.cursor is None else (Word(f"┃ {at * self.cycle_s:.3f} s", Tone.WARNING),)
        values = self.values_at(at if self.cursor is not None else self._last_known())
        labels = [each.name if is_of_two else each.line.label for each in self.shown]
        parts = [
            Word(f"{sign} {label} {texts.number(value, signal.decimals)}")
            for sign, label, value in zip(_SIGNS, labels, values, strict=False)
        ]
        title = signal.name if is_of_two else f"{name} {signal.name}"
        return Word(f"{title} {signal.unit}".strip()), *parts, *when

    def _last_known(self) -> int:
        """The last cycle shown of which every line is known, or the last one: references come a little later."""
        rows = self.history.between(self.last - LATE_CYCLES, self.last)
        known = np.ones(len(rows.cycles), dtype=np.bool_)
        for each in self.shown:
            known &= np.isfinite(rows.values[:, each.joint, each.line.column])
        return int(rows.cycles[np.flatnonzero(known)[-1]]) if known.any() else self.last

    def values_at(self, cycle: int) -> list[float]:
        """The value of each line, in the unit of the signal; NaN where not known."""
        row = self.history.row_at(cycle)
        if row is None:
            return [np.nan] * len(self.shown)
        values = self.history.values[row]
        return [float(values[each.joint, each.line.column]) * self.signal.factor for each in self.shown]

    def is_as(self, other: "TraceScene | None") -> bool:
        """Whether it looks the same."""
        return (
            other is not None
            and all(
                getattr(self, name) is getattr(other, name) or getattr(self, name) == getattr(other, name)
                for name in ("first", "last", "cursor", "signal", "shown", "marks", "has_axis")
            )
            and self.data is other.data
            and self.words() == other.words()
        )

    def goes_on_within_a_dot(self, before: "TraceScene", cells: int) -> bool:
        """Whether it shows what `before` did and a little more, but not a dot column more."""
        a_column = columns_of(cells, self.last - self.first + 1)
        return (
            self.history is before.history
            and self.last > before.last
            and self.last // a_column == before.last // a_column
            and self.last - self.first == before.last - before.first
            and all(
                getattr(self, name) == getattr(before, name)
                for name in ("cursor", "signal", "shown", "limits", "marks", "has_axis")
            )
        )


class Trace(Drawn):
    """A title, a scale, the lines, dotted limits, signs of events, a cursor, and the times below.

    Its colours are those of the widget that it is in: there are many traces, and a colour takes long to look up.
    """

    class Pointed(Message):
        """The user has clicked on a cycle."""

        def __init__(self, cycle: int) -> None:
            super().__init__()
            self.cycle = cycle

    DEFAULT_CSS = "Trace { height: 1fr; margin: 0 1 0 0; }"

    def __init__(self, name: str, place: int) -> None:
        super().__init__(id=f"trace-{name}-{place}")
        self._scene: TraceScene | None = None
        self._plotted: TraceScene | None = None
        self._plot: list[Strip] = []
        self._plot_size = (0, 0)
        self._is_whole = False

    def show(self, scene: TraceScene) -> None:
        """Show `scene`, unless it looks like what is shown.

        While it moves on, the lines are drawn with each dot column, and once it stands, to the end.
        """
        before, self._scene = self._scene, scene
        stands = before is not None and scene.last == before.last
        if stands and self._is_whole and scene.is_as(before):
            return
        if stands:
            self._plotted = None
        self._is_whole = stands
        self.redraw()

    def notify_style_update(self) -> None:
        """The colours have changed."""
        super().notify_style_update()
        self._plotted = None

    def on_click(self, event: Click) -> None:
        """Say which cycle was pointed at."""
        scene, cells = self._scene, self.size.width - LABEL_WIDTH
        offset = event.get_content_offset(self)
        if scene is not None and offset is not None and 0 <= (cell := offset.x - LABEL_WIDTH) < cells:
            a_column = columns_of(cells, scene.last - scene.first + 1)
            column = scene.last // a_column - (DOTS_X * cells - 1 - DOTS_X * cell)
            self.post_message(self.Pointed(column * a_column))

    def style_of(self, name: str) -> Style:
        """The style of a component class of the widget that it is in."""
        parent = self.parent
        assert isinstance(parent, Drawing)
        return parent.style_of(name)

    def draw(self, width: int, height: int) -> list[Strip]:
        """The scene."""
        scene = self._scene
        if scene is None:
            return []
        title = title_of(scene.words(), width - 1)
        blank = self.style_of("trace--blank")
        strips = [
            Strip([Segment(" ", blank), *title.render_segments(self.visual_style)]).adjust_cell_length(width, blank)
        ]
        rows, cells = height - 1 - scene.has_axis, width - LABEL_WIDTH
        if rows < 1 or cells < 1:
            return strips
        before, size = self._plotted, (height - 1, width)
        if before is None or size != self._plot_size or not scene.goes_on_within_a_dot(before, cells):
            self._plotted, self._plot_size = scene, size
            self._plot = list(self._draw_plot(scene, rows, cells))
        return [*strips, *self._plot]

    def _draw_plot(self, scene: TraceScene, rows: int, cells: int) -> Iterator[Strip]:
        width = LABEL_WIDTH + cells
        styles = [self.style_of(f"trace--{name}") for name in PARTS]
        plot, times = plot_of(scene, cells)
        for row in plot_rows(plot, rows, cells):
            yield Strip([Segment(run.text, styles[run.part]) for run in row], width)
        if scene.has_axis:
            yield Strip([Segment(" " * LABEL_WIDTH + times, styles[Part.SCALE])], width)


def plot_of(scene: TraceScene, cells: int) -> tuple[Plot, str]:
    """The plot of `scene` for so many cells, and its axis of time."""
    a_column = columns_of(cells, scene.last - scene.first + 1)
    columns = DOTS_X * cells
    first = (scene.last // a_column - columns) * a_column
    rows = scene.history.between(first, scene.last)
    strokes = []
    for each in scene.shown:
        values = rows.values[:, each.joint, each.line.column] * scene.signal.factor
        strokes.append(Stroke(*decimate(*_filled(rows.cycles, values, a_column), columns, a_column, scene.last)))
    low, high = _range(scene, strokes)
    cursor = None if scene.cursor is None else cell_of(scene.cursor, scene.last, a_column, cells)
    signs = signs_of(scene.marks, scene.last, a_column, cells) if len(rows.cycles) else {}
    begin_s = (first + a_column) * scene.cycle_s
    times = time_row(begin_s, begin_s + columns * a_column * scene.cycle_s, cells)
    return Plot(strokes, low, high, scene.limits, signs, cursor), times


def _filled(
    cycles: NDArray[np.int64], values: NDArray[np.floating], a_column: int
) -> tuple[NDArray[np.int64], NDArray[np.floating]]:
    """With values in between where they are further apart than columns, up to `LATE_CYCLES`."""
    known = np.isfinite(values)
    cycles, values = cycles[known], values[known]
    if not len(cycles) or np.max(np.diff(cycles), initial=0) <= a_column:
        return cycles, values
    wanted = np.arange(cycles[0], cycles[-1] + 1, a_column)
    place = np.searchsorted(cycles, wanted)
    gap = cycles[place] - cycles[np.maximum(place - 1, 0)]
    between = np.where(gap <= LATE_CYCLES, np.interp(wanted, cycles, values), np.nan)
    return wanted, between


def _range(scene: TraceScene, strokes: Iterable[Stroke]) -> tuple[float, float]:
    ends: list[NDArray[np.float64]] = [end for stroke in strokes for end in stroke]
    values = np.concatenate(ends)
    values = values[np.isfinite(values)]
    if not scene.signal.is_about_zero:
        return nice_range(float(values.min()), float(values.max())) if len(values) else (-1.0, 1.0)
    greatest = float(np.abs(values).max()) if len(values) else 0.0
    scale = nice_scale(max([greatest, *(ROOM_BEYOND_LIMITS * each for each in scene.limits)]))
    return -scale, scale


def cell_of(cycle: int, last: int, a_column: int, cells: int) -> int:
    """The cell in which `cycle` is drawn; below 0 or from `cells` on if it is not. Columns are those of `decimate`."""
    return (DOTS_X * cells - 1 - (last // a_column - cycle // a_column)) // DOTS_X


def signs_of(marks: Iterable[Mark], last: int, a_column: int, cells: int) -> dict[int, Word]:
    """The signs by the cell that they stand in, or the next free one; at the end, those before it make room.

    `marks` are newest first; of one cycle too.
    """
    found: dict[int, Word] = {}
    oldest_first = tuple(marks)[::-1]
    for cycle, sign in sorted(oldest_first, key=lambda mark: mark[0]):
        begin = cell_of(cycle, last, a_column, cells)
        if not (0 <= cycle <= last and 0 <= begin < cells):
            continue
        cell = next((each for each in range(begin, cells) if each not in found), None)
        if cell is None:
            free = next((each for each in range(begin - 1, -1, -1) if each not in found), None)
            if free is None:
                continue
            for each in range(free, cells - 1):
                found[each] = found[each + 1]
            cell = cells - 1
        found[cell] = sign
    return found
