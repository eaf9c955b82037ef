"""A path from a CSV file: what its header says, and what can be wrong with it.

Columns are `time_s` and `x_m`, `y_m`, `z_m` (or `x_mm` …, `x_in` …), in any order; one row per point.
"""

import csv
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from canarm_protocol.shown import printable
from canarm_protocol.text_file import RowError, csv_rows, finite, read_text

from ..errors import CooperationError
from .paths import INCH_M, PERIOD_S, Path, through

LARGEST_BYTES = 64 * 1024 * 1024
UNITS = {"m": 1.0, "mm": 1e-3, "in": INCH_M}


def read_path(file: str | FilePath, *, period_s: float = PERIOD_S, from_start: bool = False) -> Path:
    """The path in a CSV file: straight lines through its points, every `period_s` seconds.

    Points are positions in the master's base, or with `from_start` displacements from the tip's start. Raises
    `CooperationError` naming file, row and column: unreadable file, missing, repeated or unknown column, not a finite
    number, fewer than 2 rows, times that do not begin at 0 or do not increase.
    """
    source = printable(str(file))
    try:
        header, rows = csv_rows(read_text(FilePath(file), LARGEST_BYTES, "a path", "CSV"))
        scale = _scale(source, header)
        names = ["time_s", *(f"{axis}_{scale}" for axis in "xyz")]
        places = [(header.index(name), name) for name in names]
        found = [(number, [finite(number, name, row[place]) for place, name in places]) for number, row in rows]
    except RowError as error:
        raise CooperationError(f"{source}: {error}") from None
    except (OSError, ValueError, csv.Error) as error:
        raise CooperationError(f"{source}: cannot be read as a CSV file: {error}") from None
    table = np.array([values for _, values in found]).reshape(-1, 4)
    if len(table) < 2:
        raise CooperationError(f"{source}: {len(table)} rows of values; a path needs at least 2")
    if table[0, 0] != 0.0:
        raise CooperationError(f"{source}: row {found[0][0]}: time_s = {table[0, 0]:g}; the first must be 0")
    try:
        return through(table[:, 1:] * UNITS[scale], table[:, 0], period_s=period_s, from_start=from_start)
    except CooperationError as error:
        raise CooperationError(f"{source}: {error}") from None


def _scale(source: str, header: Sequence[str]) -> str:
    """The unit of the header's three coordinates."""
    for unit in UNITS:
        if sorted(header) == sorted(["time_s", *(f"{axis}_{unit}" for axis in "xyz")]):
            return unit
    found = printable(", ".join(header)) or "none"
    raise CooperationError(f"{source}: row 1 has the columns {found}; must be time_s, x_m, y_m, z_m (or _mm, or _in)")
