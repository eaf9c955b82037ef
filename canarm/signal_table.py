"""The tables of signals of a run as numpy columns, also of a run that goes on or was cut off.

What the columns mean is not known here.
"""

import csv
import io
import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.errors import CanarmError
from canarm_protocol.runs.packing import SUFFIX
from canarm_protocol.runs.parts import parts_of
from canarm_protocol.runs.run_events import LATEST_S
from canarm_protocol.shown import first_line, printable

from .libraries import load_library

Floats = NDArray[np.float64]
Columns = dict[str, Floats]

LARGEST_TABLE = 4 << 30
"""Bytes; an hour of two joints has one."""
MOST_NUMBERS = 200_000_000
"""In a table that is packed: as many as there are in the largest text."""
LONGEST_HEADER = 1 << 20
LAST_CYCLE = 2**53
"""Up to there a column of numbers tells one cycle from the next."""
JOINED_BY = "cycle"


def read_table(path: Path, complain: Callable[[str], None]) -> Columns:
    """The columns of a CSV file of numbers, by their names; none without a file.

    Its parts come first, and may be Parquet files. What cannot be read is left out, and `complain` is told: a last row
    that is cut off, rows of another length, texts.
    """
    parts = [each for each in (_read_part(part, complain) for part in parts_of(path, SUFFIX)) if each]
    if len(parts) < 2:
        return parts[0] if parts else {}
    names = [name for name in parts[0] if all(name in part for part in parts)]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _read_part(path: Path, complain: Callable[[str], None]) -> Columns:
    if path.suffix == SUFFIX:
        return _read_parquet(path, complain)
    try:
        if not path.exists():
            return {}
        if not path.is_file():
            raise ValueError("is no regular file")
        if not path.stat().st_size:
            complain(f"{path.name}: is empty: the record broke off")
            return {}
        if path.stat().st_size > LARGEST_TABLE:
            raise ValueError(f"is larger than {LARGEST_TABLE} bytes")
        with path.open("rb") as file:
            names = _header(file.readline(LONGEST_HEADER))
            data = file.read()
    except (OSError, ValueError, csv.Error) as error:
        complain(f"{path.name}: cannot be read: {getattr(error, 'strerror', None) or first_line(error)}")
        return {}
    end = data.rfind(b"\n") + 1
    if end < len(data):
        complain(f"{path.name}: its last row is cut off and left out")
    return _placed(
        path.name, dict(zip(names, _rows(path.name, data[:end], len(names), complain).T, strict=True)), complain
    )


def _placed(name: str, found: Columns, complain: Callable[[str], None]) -> Columns:
    """The rows whose cycle and time are numbers that a run can have; NaN and infinity are none."""
    is_placed = (np.abs(found[JOINED_BY]) <= LAST_CYCLE) & (np.abs(found["time_s"]) <= LATEST_S)
    if not is_placed.all():
        complain(f"{name}: rows without cycle or time are left out")
        return {column: values[is_placed] for column, values in found.items()}
    return found


def _read_parquet(path: Path, complain: Callable[[str], None]) -> Columns:
    try:
        parquet = load_library("pyarrow.parquet", path.name)
        size = parquet.read_metadata(path)
        if size.num_rows * size.num_columns > MOST_NUMBERS:
            raise ValueError(f"{size.num_rows} rows of {size.num_columns} columns are more than {MOST_NUMBERS} numbers")
        table = parquet.read_table(path)
        columns = {name: np.asarray(table[name], dtype=np.float64) for name in table.column_names}
    except CanarmError as error:
        complain(str(error))
        return {}
    except Exception as error:  # whatever a damaged file makes of the library
        complain(f"{path.name}: cannot be read: {first_line(error)}")
        return {}
    if not {JOINED_BY, "time_s"} <= columns.keys():
        complain(f"{path.name}: cannot be read: has no columns {JOINED_BY} and time_s")
        return {}
    return _placed(path.name, columns, complain)


def joined(robot: Columns, controller: Columns) -> Columns:
    """Both tables as one, a row for each cycle of either; NaN where one has none.

    Where both have a column of a name, the controller's is called `controller.NAME`. Of several rows with one cycle,
    as of an arm that nobody drives any more, the first counts.
    """
    if not robot or not controller:
        return robot or controller
    firsts = {id(table): np.unique(table[JOINED_BY], return_index=True) for table in (robot, controller)}
    cycles = np.union1d(robot[JOINED_BY], controller[JOINED_BY])
    found: Columns = {}
    for table in (robot, controller):
        known, rows = firsts[id(table)]
        places = np.searchsorted(cycles, known)
        for name, values in table.items():
            column = np.full(len(cycles), math.nan)
            column[places] = values[rows]
            if name in (JOINED_BY, "time_s") and name in found:
                found[name] = np.where(np.isnan(found[name]), column, found[name])
            else:
                found[f"controller.{name}" if name in found else name] = column
    return found


def _header(line: bytes) -> list[str]:
    text = line.decode("utf-8-sig")
    names = [name.strip() for name in next(csv.reader(io.StringIO(text)), [])]
    if not text.endswith("\n") or JOINED_BY not in names or "time_s" not in names:
        raise ValueError("its first row names no columns cycle and time_s")
    if len(set(names)) != len(names):
        raise ValueError(f"two columns have one name: {printable(max(names, key=names.count))}")
    return names


def _rows(name: str, data: bytes, columns: int, complain: Callable[[str], None]) -> Floats:
    if not data.strip():
        return np.empty((0, columns))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            table = np.loadtxt(io.BytesIO(data), delimiter=",", ndmin=2, comments=None, encoding="ascii")
            if table.shape[1] == columns:
                return np.asarray(table, dtype=np.float64)
        except ValueError:
            pass
    rows = [row for row in (_row(line, columns) for line in data.split(b"\n")) if row is not None]
    bad = sum(bool(line.strip()) for line in data.split(b"\n")) - len(rows)
    complain(f"{name}: {bad} {'row is' if bad == 1 else 'rows are'} damaged and left out")
    return np.array(rows, dtype=np.float64).reshape(-1, columns)


def _row(line: bytes, columns: int) -> Sequence[float] | None:
    try:
        row = [float(value) for value in line.split(b",")]
    except ValueError:
        return None
    return row if len(row) == columns else None
