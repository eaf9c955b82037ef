"""Reading a cell: a shipped name or a TOML file, with keys of the command line laid over it."""

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..errors import CellError
from ..shown import printable
from ..text_file import parse_toml, read_text
from .cell_checks import problems
from .cell_messages import explain, nearest
from .model import Cell
from .old_cells import old_writing
from .settings import key_of, lay_over
from .urdf_robots import resolve_urdf

LARGEST_BYTES = 1_000_000
LONGEST_PROBLEM = 400
"""Longest line about one problem of a cell, which names what there is instead."""
DEEPEST = 20
MOST_PROBLEMS = 20


def shipped_cells() -> dict[str, str]:
    """Name and TOML text of every cell that ships with canarm."""
    folder = resources.files("canarm_protocol") / "cells"
    return {
        Path(item.name).stem: item.read_text(encoding="utf-8")
        for item in sorted(folder.iterdir(), key=lambda item: Path(item.name).stem)
        if item.name.endswith(".toml")
    }


def load_cell(name_or_path: str, settings: Mapping[str, str] | None = None, *, option: str = "--set") -> Cell:
    """Load and validate a cell.

    `name_or_path` is the name of a shipped cell ("konkuk1") or the path of a TOML file. `settings` are keys laid over
    it, dotted as on the command line ("control.mras.gamma_bias" → "10"). `option` names them in errors.

    Raises `CellError` with one line per problem: file, key, value, and what would be right.
    """
    shipped = shipped_cells()
    source = printable(name_or_path) or "''"
    if name_or_path in shipped:
        return parse_cell(shipped[name_or_path], f"cell {name_or_path}", settings, option=option)
    path = Path(name_or_path)
    try:
        text = read_text(path, LARGEST_BYTES, "a cell")
    except FileNotFoundError:
        hint = nearest(name_or_path, shipped)
        raise CellError(f"{source}: no such file, and no cell of that name{hint}") from None
    except OSError as error:
        raise CellError(f"{source}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise CellError(f"{source}: {error}") from None
    return parse_cell(text, source, settings, path.parent, option=option)


def parse_cell(
    text: str,
    source: str,
    settings: Mapping[str, str] | None = None,
    folder: Path = Path(),
    *,
    option: str = "--set",
) -> Cell:
    """Validate the TOML `text` of a cell; `source` names it in error messages. Raises `CellError`.

    URDF files that it names are found from `folder`.
    """
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise CellError(f"{source}: {printable(str(error))}") from None
    settings = settings or {}
    resolve_urdf(table, folder, source)
    for key, value in settings.items():
        lay_over(table, key, value, option)
    table = _frozen(table, source)
    is_old = old_writing(table)
    if is_old is not None:
        raise CellError(f"{source}: {printable(is_old, LONGEST_PROBLEM)}")
    try:
        cell = Cell.model_validate(table)
    except ValidationError as error:
        wrong = [problem for problem in error.errors(include_url=False) if not _is_echo(problem)]
        count, found = len(wrong), [explain(problem, table) for problem in wrong[:MOST_PROBLEMS]]
    else:
        found = list(problems(cell))
        if not found:
            return cell
        count = len(found)
    raise CellError("\n".join(_lines(found[:MOST_PROBLEMS], count, source, settings, option)))


def _lines(found: Sequence[str], count: int, source: str, settings: Mapping[str, str], option: str) -> list[str]:
    """One line per problem in `found`, and how many of `count` are left out."""
    lines = [f"{_source(line, source, settings, option)}: {printable(line, LONGEST_PROBLEM)}" for line in found]
    return [*lines, f"{source}: and {count - len(found)} more"] if count > len(found) else lines


def _frozen(value: Any, source: str, depth: int = 0) -> Any:
    """TOML arrays as tuples, as the strict schema requires. Raises `CellError` for what no cell can hold."""
    if depth > DEEPEST:
        raise _too_deep(source)
    if isinstance(value, dict):
        return {key: _frozen(item, source, depth + 1) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_frozen(item, source, depth + 1) for item in value)
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise CellError(f"{source}: an integer of {value.bit_length()} bits; TOML's have at most 64")
    return value


def _too_deep(source: str) -> CellError:
    return CellError(f"{source}: tables or arrays are nested more than {DEEPEST} deep; those of a cell are not")


def _source(line: str, source: str, settings: Mapping[str, str], option: str) -> str:
    """Where a problem came from: the file, or a key laid over it."""
    return f"{source} with {option}" if key_of(line) in settings else source


def _is_echo(problem: Any) -> bool:
    """Whether a problem only repeats one that is reported for an element of the array."""
    return problem["type"] == "too_short" and len(problem["input"]) > 0


def recorded_cell(table: object, source: str) -> Cell:
    """The cell that a run was recorded with, from its JSON object. No file that it names is read.

    `source` names the record. Raises `CellError`.
    """
    if not isinstance(table, Mapping):
        found = "is missing" if table is None else "is no table"
        raise CellError(f"{source}: {found}; the record of a run has its whole cell")
    plain = _frozen(_without_nulls(table), source)
    try:
        cell = Cell.model_validate(plain)
    except ValidationError as error:
        text = explain(error.errors(include_url=False)[0], plain)
        raise CellError(f"{source}: {printable(text, LONGEST_PROBLEM)}") from None
    for text in problems(cell):
        raise CellError(f"{source}: {printable(text, LONGEST_PROBLEM)}")
    return cell


def _without_nulls(value: object, depth: int = 0) -> object:
    """Without the keys that JSON says are null: in TOML they are absent."""
    if isinstance(value, dict) and depth <= DEEPEST:
        return {key: _without_nulls(item, depth + 1) for key, item in value.items() if item is not None}
    if isinstance(value, list) and depth <= DEEPEST:
        return [_without_nulls(item, depth + 1) for item in value]
    return value
