"""Lines in braille: samples to the minimum and maximum of each dot column, and these to characters.

A character cell is 2 dots wide and 4 dots high. Arrays in, arrays out; no widgets, no colours.
"""

import numpy as np
from numpy.typing import NDArray

BLANK = 0x2800
DOTS_X, DOTS_Y = 2, 4
_DOT_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint8)
"""Bit of each dot of a character cell in Unicode's braille patterns (block U+2800), by rows from the top."""


def decimate(
    cycles: NDArray[np.int64],
    values: NDArray[np.floating],
    columns: int,
    cycles_a_column: int,
    last: int | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Minimum and maximum of `values` (n,) in each of `columns` columns; NaN where empty.

    The cycle `last` is in the column at the right; unless given, the newest. `cycles` (n,) do not decrease. Columns
    begin at multiples of `cycles_a_column`, so that a trace keeps its shape while it moves on. Each column
    includes the last value before it, so that the line is connected.
    """
    # One more column at the left, cut off at the end, so that the first one shown is connected too.
    low, high = np.full(columns + 1, np.nan), np.full(columns + 1, np.nan)
    if len(cycles):
        bins = cycles // cycles_a_column
        bins = bins - ((bins[-1] if last is None else last // cycles_a_column) - columns)
        wanted = np.isfinite(values) & (bins >= 0) & (bins <= columns)
        bins, values = bins[wanted], values[wanted]
        starts = np.flatnonzero(np.diff(bins, prepend=-1))
        if len(starts):
            low[bins[starts]] = np.minimum.reduceat(values, starts)
            high[bins[starts]] = np.maximum.reduceat(values, starts)
        joined = starts[1:][bins[starts[1:]] == bins[starts[1:] - 1] + 1]
        before = values[joined - 1]
        low[bins[joined]] = np.minimum(low[bins[joined]], before)
        high[bins[joined]] = np.maximum(high[bins[joined]], before)
    return low[1:], high[1:]


def dot_rows(values: NDArray[np.float64], scale: float, rows: int) -> NDArray[np.int64]:
    """Dot row (0 = top) of finite values between +scale (top) and -scale (bottom) on `rows` character rows; clipped."""
    last = DOTS_Y * rows - 1
    position = np.rint((scale - np.clip(values, -scale, scale)) / (2.0 * scale) * last)
    return position.astype(np.int64)


def trace_cells(low: NDArray[np.float64], high: NDArray[np.float64], scale: float, rows: int) -> NDArray[np.uint8]:
    """Braille bits, (rows, columns // 2), of strokes from `low` to `high`, one per dot column; NaN is left empty."""
    drawn = np.isfinite(low) & np.isfinite(high)
    top = dot_rows(np.where(drawn, high, 0.0), scale, rows)
    bottom = dot_rows(np.where(drawn, low, 0.0), scale, rows)
    y = np.arange(DOTS_Y * rows)[:, np.newaxis]
    return pack_dots(drawn & (top <= y) & (y <= bottom))


def limit_cells(values: NDArray[np.float64], scale: float, rows: int, cells: int) -> NDArray[np.uint8]:
    """Braille bits, (rows, cells), of dotted horizontal lines at `values`: every other dot."""
    dots = np.zeros((DOTS_Y * rows, DOTS_X * cells), dtype=np.bool_)
    dots[dot_rows(values, scale, rows), ::2] = True
    return pack_dots(dots)


def pack_dots(dots: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Braille bits (…, height // 4, width // 2) of pictures of `dots` (…, height, width)."""
    numbers = dots.view(np.uint8)
    *several, height, width = dots.shape
    bits = np.zeros((*several, height // DOTS_Y, width // DOTS_X), dtype=np.uint8)
    for (y, x), bit in np.ndenumerate(_DOT_BITS):
        bits |= numbers[..., y::DOTS_Y, x::DOTS_X] * bit
    return bits
