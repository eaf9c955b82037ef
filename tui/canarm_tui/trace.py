"""The error trace: a widget that draws the window of a snapshot in braille, line by line.

Only here do decimated values become styled text. It keeps nothing but the snapshot it draws.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from textual.widget import Widget

from . import texts
from .braille import BLANK, DOTS_X, DOTS_Y, decimate, dot_rows, limit_cells, trace_cells
from .event_texts import Mark
from .snapshot import JointNow, Snapshot
from .styles import line_of
from .texts import LIMIT_LSB, Tone, Word

MARKED = (Tone.GOOD, Tone.WARNING, Tone.BAD, Tone.PLAIN)
"""Tones of signs at the top of a trace."""


class ErrorTrace(Widget):
    """The error of one joint over the window: a title, a scale in LSB, a braille line, dotted lines at the limits, and
    at the top signs where faults began or ended and detectors answered.
    """

    COMPONENT_CLASSES: ClassVar[set[str]] = {
        "error-trace--line",
        "error-trace--limit",
        "error-trace--scale",
        *(f"error-trace--{tone.value}" for tone in MARKED),
    }
    DEFAULT_CSS = """
    ErrorTrace { height: 1fr; min-height: 6; padding: 0 1; }
    ErrorTrace .error-trace--line { color: $text-primary; }
    ErrorTrace .error-trace--limit { color: $warning 70%; }
    ErrorTrace .error-trace--scale { color: $foreground 60%; }
    ErrorTrace .error-trace--good { color: $text-success; }
    ErrorTrace .error-trace--warning { color: $text-warning; text-style: bold; }
    ErrorTrace .error-trace--bad { color: $text-error; text-style: bold; }
    """
    SCALE_WIDTH = 7

    def __init__(self, name: str, joint: int) -> None:
        super().__init__(id=f"trace-{name}")
        self._joint_name, self._joint = name, joint
        self._snapshot: Snapshot | None = None
        self._marks: tuple[Mark, ...] = ()
        self._drawn: tuple[tuple[Snapshot | None, tuple[Mark, ...], int, int], list[Strip]] | None = None

    def show(self, snapshot: Snapshot, marks: tuple[Mark, ...] = ()) -> None:
        """Show the window of `snapshot`, and `marks`, newest first, unless that is what is shown."""
        before, self._snapshot = self._snapshot, snapshot
        had, self._marks = self._marks, marks
        if before is None or had != marks or self._looks_other(before, snapshot):
            self.refresh()

    def _looks_other(self, before: Snapshot, now: Snapshot) -> bool:
        titles = (texts.trace_words(self._joint_name, each.joints[self._joint]) for each in (before, now))
        return before.error_lsb is not now.error_lsb or len(set(titles)) > 1

    def notify_style_update(self) -> None:
        """The theme has changed: discard everything drawn before."""
        super().notify_style_update()
        self._drawn = None

    def render_line(self, y: int) -> Strip:
        """One line of the widget; all lines of a snapshot are drawn together."""
        key = (self._snapshot, self._marks, self.size.width, self.size.height)
        if self._drawn is None or self._drawn[0] != key:
            self._drawn = (key, self._draw(self.size.width, self.size.height))
        strips = self._drawn[1]
        return strips[y] if y < len(strips) else Strip.blank(self.size.width, self.rich_style)

    def _draw(self, width: int, height: int) -> list[Strip]:
        snapshot = self._snapshot
        joint = JointNow() if snapshot is None else snapshot.joints[self._joint]
        title = line_of(texts.trace_words(self._joint_name, joint))
        # Looking up a style costs more than drawing a row, so each is looked up once.
        plain = self.rich_style
        strips = [Strip(title.render_segments(self.visual_style)).adjust_cell_length(width, plain)]
        rows, cells = height - 1, width - self.SCALE_WIDTH
        if rows < 1 or cells < 1:
            return strips
        scale = nice_scale(joint.max_lsb)
        low = high = np.full(DOTS_X * cells, np.nan)
        signs: dict[int, Word] = {}
        if snapshot is not None and len(snapshot.cycles):
            cycles_a_column = math.ceil(snapshot.window_cycles / (DOTS_X * cells))
            errors = snapshot.error_lsb[:, self._joint]
            low, high = decimate(snapshot.cycles, errors, DOTS_X * cells, cycles_a_column)
            signs = _signs(self._marks, int(snapshot.cycles[-1]), cycles_a_column, cells)
        line = trace_cells(low, high, scale, rows)
        limit = limit_cells(np.array([LIMIT_LSB, -LIMIT_LSB]), scale, rows, cells)
        labels = scale_labels(scale, rows)
        scale_style = self.get_component_rich_style("error-trace--scale")
        styles = (
            self.get_component_rich_style("error-trace--line"),
            self.get_component_rich_style("error-trace--limit"),
            plain,
            *(self.get_component_rich_style(f"error-trace--{tone.value}") for tone in MARKED),
        )
        for row in range(rows):
            label = Segment(labels[row].rjust(self.SCALE_WIDTH - 1) + "│", scale_style)
            strips.append(Strip([label, *_segments(line[row], limit[row], {} if row else signs, styles)], width))
        return strips


def _signs(marks: Iterable[Mark], newest_cycle: int, cycles_a_column: int, cells: int) -> dict[int, Word]:
    """The signs by the cell that they stand in, or the next free one. Columns are those of `decimate`."""
    last = newest_cycle // cycles_a_column
    found: dict[int, Word] = {}
    for cycle, sign in sorted(marks, key=lambda mark: mark[0]):
        column = DOTS_X * cells - 1 - (last - cycle // cycles_a_column)
        if 0 <= cycle <= newest_cycle and column >= 0:
            cell = next((each for each in range(column // DOTS_X, cells) if each not in found), None)
            if cell is not None:
                found[cell] = sign
    return found


def _segments(
    line: NDArray[np.uint8], limit: NDArray[np.uint8], signs: Mapping[int, Word], styles: Sequence[Style]
) -> list[Segment]:
    """One row of the plot, split where the style changes: `styles` are for the line, the limits, the rest, and the
    tones of signs, which stand over all.
    """
    kinds = np.where(line != 0, 0, np.where(limit != 0, 1, 2))
    shown = (BLANK + (line | limit).astype(np.int32)).tolist()
    for cell, sign in signs.items():
        kinds[cell], shown[cell] = 3 + MARKED.index(sign.tone), ord(sign.text)
    text = "".join(map(chr, shown)).replace(chr(BLANK), " ")
    cuts = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist(), len(text)]
    return [Segment(text[start:end], styles[kinds[start]]) for start, end in itertools.pairwise(cuts)]


def nice_scale(greatest_lsb: float) -> float:
    """End of the symmetric scale: the smallest of 2, 5, 10, 20, 50, … LSB that contains `greatest_lsb`; 2 for NaN."""
    scale, step = 2.0, 0
    factors = (2.5, 2.0, 2.0)
    while greatest_lsb > scale:
        scale *= factors[step % 3]
        step += 1
    return scale


def scale_labels(scale: float, rows: int) -> list[str]:
    """The label of each character row of a plot: its ends, the limits, and zero if there is room."""
    values = (0.0, -scale, scale, -LIMIT_LSB, LIMIT_LSB)
    labels = [""] * rows
    for value, row in zip(values, dot_rows(np.array(values), scale, rows) // DOTS_Y, strict=True):
        labels[row] = texts.number(value, 0)
    return labels
