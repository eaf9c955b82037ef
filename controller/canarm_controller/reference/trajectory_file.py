"""Reading a trajectory from a CSV file: the text and what can be wrong with it.

The columns are `time_s` and then each joint's name, in any order, in degrees. What lies between the rows, and whether
the robot can follow, is decided in `trajectory`.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import TrajectoryError

TIME_COLUMN = "time_s"
LONGEST_S = 86_400.0
SHORTEST_STEP_S = 1e-6
"""Rows closer than this are a slip of the pen: no cycle is that short, and a spline's slopes lose their digits."""
LARGEST_DEG = 1e6
SHOWN = 40
"""Characters of a wrong value that a message repeats."""


def read_trajectory_csv(path: Path, joint_names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) in s and positions (n, joints) in rad, joints in the order of `joint_names`.

    Raises `TrajectoryError` naming file, row and column: unreadable file, missing, repeated or unknown column, not a
    finite number, an angle beyond +-`LARGEST_DEG`, fewer than 2 rows, times that do not begin at 0, increase by less
    than `SHORTEST_STEP_S` or go on beyond `LONGEST_S`.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TrajectoryError(f"{path}: cannot be read as a CSV file: {error}") from None
    header = [cell.strip() for cell in rows[0]] if rows else []
    wanted = [TIME_COLUMN, *joint_names]
    if sorted(header) != sorted(wanted):
        raise TrajectoryError(
            f"{path}: row 1 has the columns {', '.join(header) or 'none'}; must be {', '.join(wanted)}"
        )
    columns = [header.index(name) for name in wanted]
    numbered = [(number, row) for number, row in enumerate(rows[1:], start=2) if any(cell.strip() for cell in row)]
    if len(numbered) < 2:
        raise TrajectoryError(f"{path}: {len(numbered)} rows of values; a trajectory needs at least 2")
    table = np.array([_values(path, number, row, header, columns) for number, row in numbered])
    time_s = table[:, 0]
    if time_s[0] != 0.0:
        raise TrajectoryError(f"{path}: row {numbered[0][0]}: {TIME_COLUMN} = {time_s[0]:g}; the first must be 0")
    steps_s = np.diff(time_s)
    if late := np.flatnonzero(steps_s < SHORTEST_STEP_S).tolist():
        number, is_later = numbered[late[0] + 1][0], steps_s[late[0]] > 0
        raise TrajectoryError(
            f"{path}: row {number}: {TIME_COLUMN} = {time_s[late[0] + 1]:g}; "
            f"must be later than the row before it, {time_s[late[0]]:g}"
            + (f", by at least {SHORTEST_STEP_S:g} s" if is_later else "")
        )
    if time_s[-1] > LONGEST_S:
        raise TrajectoryError(
            f"{path}: row {numbered[-1][0]}: {TIME_COLUMN} = {time_s[-1]:g}; "
            f"a trajectory may last {LONGEST_S:g} s (24 h) at most"
        )
    return time_s, np.radians(table[:, 1:])


def _values(path: Path, number: int, row: list[str], header: list[str], columns: list[int]) -> list[float]:
    if len(row) != len(header):
        raise TrajectoryError(f"{path}: row {number} has {len(row)} values; the header has {len(header)} columns")
    values = []
    for column in columns:
        try:
            value = float(row[column])
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise TrajectoryError(
                f"{path}: row {number}, column {header[column]}: {row[column][:SHOWN]!r} is not a finite number"
            )
        if header[column] != TIME_COLUMN and abs(value) > LARGEST_DEG:
            raise TrajectoryError(
                f"{path}: row {number}, column {header[column]}: {value:g} deg; must be within +-{LARGEST_DEG:g} deg"
            )
        values.append(value)
    return values
