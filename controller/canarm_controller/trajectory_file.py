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

from .errors import TrajectoryError

TIME_COLUMN = "time_s"


def read_trajectory_csv(path: Path, joint_names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) in s and positions (n, joints) in rad, joints in the order of `joint_names`.

    Raises `TrajectoryError` naming file, row and column: unreadable file, missing, repeated or unknown column, not a
    finite number, fewer than 2 rows, times that do not begin at 0 or do not increase.
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
    if late := np.flatnonzero(np.diff(time_s) <= 0).tolist():
        number = numbered[late[0] + 1][0]
        raise TrajectoryError(
            f"{path}: row {number}: {TIME_COLUMN} = {time_s[late[0] + 1]:g}; "
            f"must be later than the row before it, {time_s[late[0]]:g}"
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
                f"{path}: row {number}, column {header[column]}: {row[column]!r} is not a finite number"
            )
        values.append(value)
    return values
