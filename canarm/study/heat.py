"""Two settings against each other: the mean of a figure over all runs of a field. How it looks is not known here."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..draws import Choice, Whole
from .findings import JUDGED, Findings, Floats
from .plan import Axis

MOST_FIELDS = 12
"""Of an axis with more values, neighbours share a field."""


@dataclass(frozen=True)
class HeatMap:
    """`means`, `lost` (the share of runs that did not end as planned) and `counts` are (down, across)."""

    title: str
    across: tuple[str, ...]
    down: tuple[str, ...]
    means: Floats
    lost: Floats
    counts: NDArray[np.int64]


def heat_map(across: Axis, down: Axis, found: Findings, metric: str = JUDGED) -> HeatMap:
    """The map of two axes; of one axis with itself there is a single row."""
    columns, of_column = _fields(across, found.columns[across.name])
    rows, of_row = _fields(down, found.columns[down.name])
    if across is down:
        rows, of_row = ("",), np.zeros_like(of_column)
    values = found.columns[metric]
    is_known = found.is_done & np.isfinite(values)
    field = of_row * len(columns) + of_column
    size, shape = len(rows) * len(columns), (len(rows), len(columns))
    counts = np.bincount(field, minlength=size)
    known = np.bincount(field[is_known], minlength=size)
    total = np.bincount(field[is_known], values[is_known], minlength=size)
    done = np.bincount(field[found.is_done], minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        means, lost = total / known, 1.0 - done / counts
    title = across.name if across is down else f"{down.name} over {across.name}"
    return HeatMap(title, columns, rows, means.reshape(shape), lost.reshape(shape), counts.reshape(shape))


def _fields(axis: Axis, values: Floats) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """The names of the fields of an axis, and in which field each run is."""
    known = np.unique(values[np.isfinite(values)])
    if isinstance(axis, Choice):
        names = tuple(str(axis.values[int(place)]) for place in known)
        return names, np.searchsorted(known, np.nan_to_num(values)).clip(0, len(known) - 1)
    if len(known) <= MOST_FIELDS:
        return tuple(f"{value:.6g}" for value in known), np.searchsorted(known, values).clip(0, len(known) - 1)
    is_log = not isinstance(axis, Whole) and axis.is_factor
    space = np.geomspace if is_log else np.linspace
    edges = space(known[0], known[-1], MOST_FIELDS + 1)
    names = tuple(f"{low:.3g} to {high:.3g}" for low, high in pairwise(edges))
    return names, np.searchsorted(edges[1:-1], values, side="right").clip(0, len(names) - 1)
