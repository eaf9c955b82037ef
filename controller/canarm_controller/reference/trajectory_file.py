"""Reading a trajectory from a CSV file or a table of columns: what the header says, and what can be wrong with it.

`file_trajectory` interpolates between the rows, and checks whether the robot can follow. docs/trajectory-files.md
describes the format.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.shown import first_line, printable
from canarm_protocol.text_file import RowError, csv_rows, finite, read_text

from ..errors import TrajectoryError
from .limits import real_numbers

Floats: TypeAlias = NDArray[np.float64]

TIME_UNITS = {"time_s": 1.0, "time_ms": 1e-3, "time_us": 1e-6}
ANGLE_UNITS = {"": math.radians(1.0), "_deg": math.radians(1.0), "_rad": 1.0}
"""Suffixes of a column's name after the joint's; without one, degrees."""
RECORDED = ".reference_rad"
"""Suffix of a reference's column in a run folder's signals/controller.csv, which has other columns as well."""
LARGEST_BYTES = 64 * 1024 * 1024
LONGEST_S = 86_400.0
SHORTEST_STEP_S = 1e-6
"""Rows closer than this are a mistake: no cycle is that short, and a spline's slopes lose their digits."""
LARGEST_DEG = 1e6
SLOWEST_DEG_S = 0.1
"""A motion that is nowhere faster, in thousands of seconds, looks like milliseconds: no tachometer can see it."""
LONG_S = 1000.0


@dataclass(frozen=True, slots=True)
class _Columns:
    """Columns of time and of each joint's angle, and their units in s and rad."""

    places: tuple[int, ...]
    scales: tuple[float, ...]
    is_stated: bool
    """Whether the header says in which unit the angles are."""
    is_recorded: bool


def read_trajectory_csv(path: Path, joint_names: Sequence[str]) -> tuple[Floats, Floats]:
    """Times (n,) in s and positions (n, joints) in rad, joints in the order of `joint_names`.

    Raises `TrajectoryError` naming file, row and column: unreadable file, missing, repeated or unknown column, not a
    finite number, an angle beyond +-`LARGEST_DEG`, fewer than 2 rows, times that do not begin at 0, increase by less
    than `SHORTEST_STEP_S` or go on beyond `LONGEST_S`, and values that look like another unit than the header's.
    """
    try:
        header, rows = csv_rows(read_text(path, LARGEST_BYTES, "a trajectory", "CSV"))
        columns = _columns(str(path), header, joint_names)
        found = [(number, _values(number, row, header, columns)) for number, row in rows]
    except RowError as error:
        raise TrajectoryError(f"{path}: {error}") from None
    except (OSError, ValueError, csv.Error) as error:
        raise TrajectoryError(f"{path}: cannot be read as a CSV file: {first_line(error)}") from None
    if len(found) < 2:
        raise TrajectoryError(f"{path}: {len(found)} rows of values; a trajectory needs at least 2")
    table = np.array([values for _, values in found])
    return _checked(str(path), table, columns, header, [number for number, _ in found])


def read_trajectory_columns(table: Mapping[str, Any], joint_names: Sequence[str]) -> tuple[Floats, Floats]:
    """As `read_trajectory_csv`, from columns by their names: a DataFrame, or a dict of arrays."""
    header = [str(name) for name in table]
    columns = _columns("trajectory", header, joint_names)
    try:
        values = np.column_stack([real_numbers(table[header[place]]) for place in columns.places])
    except (TypeError, ValueError, OverflowError) as error:
        raise TrajectoryError(
            f"trajectory: its columns must be numbers, one for each row: {first_line(error)}"
        ) from None
    if len(values) < 2:
        raise TrajectoryError(f"trajectory: {len(values)} rows of values; a trajectory needs at least 2")
    bad = np.argwhere(~(np.abs(values) <= LARGEST_DEG)).tolist()
    if bad:
        row, column = bad[0]
        name = header[columns.places[column]]
        raise TrajectoryError(f"trajectory: row {row}, column {name}: {values[row, column]:g}; must be a finite number")
    return _checked("trajectory", values * np.asarray(columns.scales), columns, header, range(len(values)))


def _columns(source: str, header: Sequence[str], joint_names: Sequence[str]) -> _Columns:
    recorded = [f"{name}{RECORDED}" for name in joint_names]
    if "time_s" in header and all(header.count(name) == 1 for name in recorded):
        return _Columns(
            tuple(header.index(name) for name in ("time_s", *recorded)), (1.0,) * (1 + len(recorded)), True, True
        )
    units = {name + ending: scale for ending, scale in ANGLE_UNITS.items() for name in joint_names}
    times = [name for name in header if name in TIME_UNITS]
    angles = [[name + ending for ending in ANGLE_UNITS if name + ending in header] for name in joint_names]
    if len(times) != 1 or any(len(found) != 1 for found in angles) or len(header) != 1 + len(joint_names):
        raise TrajectoryError(
            f"{source}: row 1 has the columns {printable(', '.join(header)) or 'none'}; must be time_s, "
            f"{', '.join(joint_names)} (degrees; radians as {joint_names[0]}_rad, milliseconds as time_ms)"
        )
    names = [times[0], *(found[0] for found in angles)]
    scales = (TIME_UNITS[names[0]], *(units[name] for name in names[1:]))
    is_stated = not set(names) & set(joint_names)
    return _Columns(tuple(header.index(name) for name in names), scales, is_stated, False)


def _checked(
    source: str, table: Floats, columns: _Columns, header: Sequence[str], numbers: Sequence[int]
) -> tuple[Floats, Floats]:
    """Times and angles, checked for increasing times and plausible units."""
    time_s, position_rad = table[:, 0], table[:, 1:]
    name, scale = header[columns.places[0]], columns.scales[0]
    if columns.is_recorded:
        time_s = time_s - time_s[0]
    if time_s[0] != 0.0:
        raise TrajectoryError(f"{source}: row {numbers[0]}: {name} = {time_s[0] / scale:g}; the first must be 0")
    steps_s = np.diff(time_s)
    if late := np.flatnonzero(steps_s < SHORTEST_STEP_S).tolist():
        number, is_later = numbers[late[0] + 1], steps_s[late[0]] > 0
        raise TrajectoryError(
            f"{source}: row {number}: {name} = {time_s[late[0] + 1] / scale:g}; "
            f"must be later than the row before it, {time_s[late[0]] / scale:g}"
            + (f", by at least {SHORTEST_STEP_S:g} s" if is_later else "")
        )
    if time_s[-1] > LONGEST_S:
        raise TrajectoryError(
            f"{source}: row {numbers[-1]}: {name} = {time_s[-1] / scale:g}; "
            f"a trajectory may last {LONGEST_S:g} s (24 h) at most"
        )
    _ask_about_units(source, time_s, position_rad, columns, header)
    return time_s, position_rad


def _ask_about_units(
    source: str, time_s: Floats, position_rad: Floats, columns: _Columns, header: Sequence[str]
) -> None:
    degrees = np.degrees(position_rad)
    if not columns.is_stated and np.max(np.abs(degrees)) <= math.pi and (degrees % 1.0).any():
        name = header[columns.places[1]]
        raise TrajectoryError(
            f"{source}: no angle is beyond +-{np.max(np.abs(degrees)):.3g} deg: are these radians? Name the columns "
            f"{name}_rad and so on if they are, {name}_deg if they are degrees"
        )
    fastest_deg_s = np.max(np.abs(np.diff(degrees, axis=0)) / np.diff(time_s)[:, None])
    if header[columns.places[0]] == "time_s" and time_s[-1] >= LONG_S and 0.0 < fastest_deg_s < SLOWEST_DEG_S:
        raise TrajectoryError(
            f"{source}: {time_s[-1]:g} s, and nowhere faster than {fastest_deg_s:.2g} deg/s: are these milliseconds? "
            "Name the column time_ms (seconds that are so slow can be given in it as well)"
        )


def _values(number: int, row: list[str], header: list[str], columns: _Columns) -> list[float]:
    values = []
    for place, (column, scale) in enumerate(zip(columns.places, columns.scales, strict=True)):
        value = finite(number, header[column], row[column]) * scale
        if place and abs(math.degrees(value)) > LARGEST_DEG:
            raise RowError(
                f"row {number}, column {header[column]}: {math.degrees(value):g} deg; must be within "
                f"+-{LARGEST_DEG:g} deg"
            )
        values.append(value)
    return values
