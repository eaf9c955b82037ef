"""A plot in characters: lines in braille over dotted limits, signs above, a cursor, labels of both axes.

Arrays and words in, runs of characters with the part that each belongs to out; no widget, no colour, no data of a run.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import texts
from .braille import BLANK, DOTS_X, DOTS_Y, dot_rows, limit_cells, trace_cells
from .texts import Tone, Word

LABEL_WIDTH = 7
MARKED = (Tone.GOOD, Tone.WARNING, Tone.BAD, Tone.PLAIN)
"""Tones of signs at the top of a plot."""
LEAST_BETWEEN_TIMES, LEAST_TIMES = 12, 2
MOST_STEPS = 4
"""Steps that are tried until there are two times: more decimals are wider."""
LEAST_RANGE = 2e-3
"""Share of a value by which the ends of a scale differ at least: as far as its labels can tell."""


class Part(IntEnum):
    """What a run of characters belongs to; signs come after, in the order of `MARKED`."""

    FIRST = 0
    SECOND = 1
    LIMIT = 2
    BLANK = 3
    CURSOR = 4
    SCALE = 5
    SIGN = 6


class Run(NamedTuple):
    """Characters in a row, and their part: a `Part`, or from `Part.SIGN` on the tone of a sign."""

    text: str
    part: int


class Stroke(NamedTuple):
    """A line, as the least and the greatest value of each dot column; NaN where there is none."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Plot:
    """What is to be drawn. `strokes` are at most two: the second is dotted, and the first covers it."""

    strokes: Sequence[Stroke]
    low: float
    high: float
    limits: Sequence[float] = ()
    signs: Mapping[int, Word] = field(default_factory=dict)
    """Signs by the cell in which they stand."""
    cursor: int | None = None
    """Cell of the cursor."""


def plot_rows(plot: Plot, rows: int, cells: int) -> list[list[Run]]:
    """`rows` rows of labels and `cells` cells. Blanks belong to the run before them: fewer runs are drawn faster."""
    middle, half = 0.5 * (plot.low + plot.high), 0.5 * (plot.high - plot.low)
    inside = [each for each in plot.limits if plot.low <= each <= plot.high]
    kinds = np.full((rows, cells), Part.BLANK, dtype=np.int8)
    bits = np.zeros((rows, cells), dtype=np.uint8)
    layers = [(Part.LIMIT, limit_cells(np.array(inside) - middle, half, rows, cells))] if inside else []
    for part, stroke in reversed([*zip((Part.FIRST, Part.SECOND), plot.strokes, strict=False)]):
        layer = trace_cells(stroke.low - middle, stroke.high - middle, half, rows)
        if part is Part.SECOND:
            layer &= 0x47  # only its left dots, so that it is told from the first without a colour
        layers.append((part, layer))
    for part, layer in layers:
        kinds[layer != 0] = part
        bits |= layer
    filled = np.where(kinds != Part.BLANK, np.arange(cells), 0)
    kinds = np.take_along_axis(kinds, np.maximum.accumulate(filled, axis=1), axis=1)
    codes = np.where(bits != 0, BLANK + bits.astype(np.uint32), ord(" ")).astype("<u4")
    if plot.cursor is not None and 0 <= plot.cursor < cells:
        kinds[:, plot.cursor] = Part.CURSOR
        codes[bits[:, plot.cursor] == 0, plot.cursor] = ord("│")
    for cell, sign in plot.signs.items():
        kinds[0, cell], codes[0, cell] = Part.SIGN + MARKED.index(sign.tone), ord(sign.text)
    labels = scale_labels(plot.low, plot.high, rows, inside)
    found = []
    for label, row, row_codes in zip(labels, kinds, codes, strict=True):
        text = row_codes.tobytes().decode("utf-32-le")
        cuts = [0, *(np.flatnonzero(row[1:] != row[:-1]) + 1).tolist(), cells]
        runs = [Run(text[start:end], int(row[start])) for start, end in itertools.pairwise(cuts)]
        found.append([Run(label.rjust(LABEL_WIDTH - 1) + "│", Part.SCALE), *runs])
    return found


def nice_scale(greatest: float) -> float:
    """End of a scale about zero: the smallest of …, 0.2, 0.5, 1, 2, 5, 10, … that contains `greatest`; 2 for NaN."""
    if not greatest > 0.0 or not math.isfinite(greatest):
        return 2.0
    power = 10.0 ** math.floor(math.log10(greatest))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if greatest <= factor * power * (1.0 + 1e-9))


def nice_range(low: float, high: float) -> tuple[float, float]:
    """A scale that contains `low` to `high`, from one round number to another; −1 to 1 without numbers."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1.0, 1.0
    missing = max(LEAST_RANGE * max(abs(low), abs(high)), LEAST_RANGE) - (high - low)
    if missing > 0.0:
        low, high = low - 0.5 * missing, high + 0.5 * missing
    step = nice_scale(high - low) / 10.0
    least, most = math.floor(low / step) * step, math.ceil(high / step) * step
    return (least, most) if most > least else (least - step, least + step)


def scale_labels(low: float, high: float, rows: int, inside: Sequence[float] = ()) -> list[str]:
    """The label of each row: the ends, what is `inside`, and zero if there is room; that named last wins a row."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    values = [*([0.0] if low < 0.0 < high else []), low, high, *sorted(inside)]
    labels = [""] * rows
    decimals = max(0, min(4, 1 - math.floor(math.log10(high - low)))) if high - low < 10.0 else 0
    for value, row in zip(values, dot_rows(np.array(values) - middle, half, rows) // DOTS_Y, strict=True):
        text = next(
            text
            for fewer in range(decimals + 1)
            if len(text := texts.number(value, decimals - fewer)) < LABEL_WIDTH or fewer == decimals
        )
        labels[row] = text.rstrip("0").rstrip(".") if "." in text else text
    return labels


def time_row(first_s: float, last_s: float, cells: int) -> str:
    """The axis of time below the cells: round numbers of seconds, each beginning where it belongs.

    Two at least, where two have room: a single one gives no scale.
    """
    seconds = last_s - first_s
    if cells < LEAST_BETWEEN_TIMES or not seconds > 0.0:
        return " " * cells
    step = nice_scale(seconds * LEAST_BETWEEN_TIMES / cells)
    found = _times(first_s, last_s, cells, step)
    for _ in range(MOST_STEPS):
        if len(found) >= LEAST_TIMES:
            break
        step = nice_scale(0.4 * step)  # the next smaller one of 1, 2, 5, …
        closer = _times(first_s, last_s, cells, step)
        found = next(kept for every in range(1, len(closer) + 2) if not _do_touch(kept := closer[::every])) or found
    line = [" "] * cells
    for cell, label in found:
        line[cell : cell + len(label)] = label
    return "".join(line)


def _times(first_s: float, last_s: float, cells: int, step: float) -> list[tuple[int, str]]:
    """The labels that fit, every `step` seconds, each with the cell of its sign."""
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    found = []
    for number in range(math.ceil(first_s / step - 1e-9), math.floor(last_s / step + 1e-9) + 1):
        label = f"╵{number * step:.{decimals}f} s"
        cell = int((number * step - first_s) / (last_s - first_s) * cells)
        if cell + len(label) <= cells:
            found.append((cell, label))
    return found


def _do_touch(labels: Sequence[tuple[int, str]]) -> bool:
    return any(cell + len(label) >= after for (cell, label), (after, _) in itertools.pairwise(labels))


def columns_of(cells: int, span: int) -> int:
    """Cycles in a dot column, so that `span` of them fit into `cells` cells."""
    return max(1, math.ceil(span / (DOTS_X * cells)))
