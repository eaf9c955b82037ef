"""The table of a study in one file: Parquet, or CSV where pyarrow is not installed.

A part of it is in memory at a time.
"""

import csv
import importlib.util
import io
import os
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from ..libraries import load_library
from .journal import Journal

PARQUET_FILE, CSV_FILE = "study.parquet", "study.csv"
ROWS_AT_ONCE = 5000


def write_table(journal: Journal) -> Path:
    """Write the rows of `journal` beside it, in the order of the runs. Returns the path. Raises `OSError`.

    A reader sees the table before or after, never half of it.
    """
    kinds = _kinds(journal.rows())
    if importlib.util.find_spec("pyarrow") is None:
        return _replaced(journal.folder / CSV_FILE, lambda path: _write_csv(path, kinds, journal.rows()))
    return _replaced(journal.folder / PARQUET_FILE, lambda path: _write_parquet(path, kinds, journal.rows()))


def _replaced(path: Path, write: Callable[[Path], None]) -> Path:
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(draft)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    return path


def _kinds(rows: Iterable[dict[str, Any]]) -> dict[str, type]:
    """The type of each column, in the order of their first appearance; whole numbers and others make others."""
    kinds: dict[str, type] = {}
    for row in rows:
        for name, value in row.items():
            before, kind = kinds.setdefault(name, type(None)), type(value)
            if kind is before or value is None:
                continue
            if before is type(None):
                kinds[name] = kind
            else:
                kinds[name] = float if {before, kind} == {int, float} else str
    return kinds


def _write_parquet(path: Path, kinds: dict[str, type], rows: Iterator[dict[str, Any]]) -> None:
    arrow, parquet = load_library("pyarrow", path.name), load_library("pyarrow.parquet", path.name)
    types = {bool: arrow.bool_(), int: arrow.int64(), float: arrow.float64()}
    schema = arrow.schema([(name, types.get(kind, arrow.string())) for name, kind in kinds.items()])
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while part := list(islice(rows, ROWS_AT_ONCE)):
            columns = {name: [_as(kind, row.get(name)) for row in part] for name, kind in kinds.items()}
            writer.write_table(arrow.table(columns, schema=schema))


def _write_csv(path: Path, kinds: dict[str, type], rows: Iterator[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerow(kinds)
        while part := list(islice(rows, ROWS_AT_ONCE)):
            text = io.StringIO()
            csv.writer(text).writerows([_plain(row.get(name)) for name in kinds] for row in part)
            file.write(text.getvalue())


def _as(kind: type, value: Any) -> Any:
    if value is None:
        return None
    return str(value) if kind in (str, type(None)) else kind(value)


def _plain(value: Any) -> Any:
    return "" if value is None else value
