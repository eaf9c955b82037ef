"""Reading a cell: a shipped name or a TOML file, with keys of the command line laid over it."""

import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from .cell import Cell
from .cell_checks import problems
from .cell_messages import explain, keys_at, nearest
from .errors import CellError

SETTABLE = ("control", "supervision")
"""The tables whose keys `--set` takes."""


def shipped_cells() -> dict[str, str]:
    """Name and TOML text of every cell that ships with canarm."""
    folder = resources.files(__package__) / "cells"
    return {
        Path(item.name).stem: item.read_text(encoding="utf-8")
        for item in sorted(folder.iterdir(), key=lambda item: item.name)
        if item.name.endswith(".toml")
    }


def load_cell(name_or_path: str, settings: Mapping[str, str] | None = None) -> Cell:
    """Load and validate a cell.

    `name_or_path` is the name of a shipped cell ("konkuk1") or the path of a TOML file. `settings` are keys laid over
    it, dotted as on the command line ("control.mras.gamma_bias" → "10").

    Raises `CellError`, one line a problem: file, key, value, and what would be right.
    """
    shipped = shipped_cells()
    if name_or_path in shipped:
        return parse_cell(shipped[name_or_path], f"cell {name_or_path}", settings)
    try:
        text = Path(name_or_path).read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = nearest(name_or_path, shipped)
        raise CellError(f"{name_or_path}: no such file, and no cell of that name{hint}") from None
    except OSError as error:
        raise CellError(f"{name_or_path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise CellError(f"{name_or_path}: is not a text in UTF-8; a cell is a TOML file") from None
    return parse_cell(text, name_or_path, settings)


def parse_cell(text: str, source: str, settings: Mapping[str, str] | None = None) -> Cell:
    """Validate the TOML `text` of a cell; `source` names it in error messages. Raises `CellError`."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CellError(f"{source}: not valid TOML: {error}") from None
    settings = settings or {}
    for key, value in settings.items():
        _lay_over(table, key, value)
    table = _frozen(table)
    try:
        cell = Cell.model_validate(table)
    except ValidationError as error:
        found = [explain(problem, table) for problem in error.errors() if not _is_echo(problem)]
    else:
        found = list(problems(cell))
        if not found:
            return cell
    raise CellError("\n".join(f"{_source(line, source, settings)}: {line}" for line in found))


def setting_keys(cell: Cell) -> dict[str, object]:
    """Every key that `--set` takes, with its nominal value: the leaves of `[control]` and `[supervision]`."""
    keys: dict[str, object] = {}

    def walk(prefix: str, table: Mapping[str, Any]) -> None:
        for name, value in table.items():
            if isinstance(value, Mapping):
                walk(f"{prefix}.{name}", value)
            elif value is not None:
                keys[f"{prefix}.{name}"] = value

    for name in SETTABLE:
        walk(name, getattr(cell, name).model_dump())
    return keys


def _frozen(value: Any) -> Any:
    """TOML arrays as tuples, which is what the strict schema takes."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _lay_over(table: dict[str, Any], key: str, value: str) -> None:
    where = f"--set {key}={value}"
    *parents, leaf = key.split(".")
    if not parents or parents[0] not in SETTABLE:
        raise CellError(f"{where}: keys begin with 'control.' or 'supervision.'; see `canarm check --keys`")
    known = keys_at(tuple(parents))
    if leaf not in known:
        raise CellError(f"{where}: no such key (see `canarm check --keys`){nearest(leaf, known)}")
    below = keys_at((*parents, leaf))
    if below:
        raise CellError(f"{where}: is a table; set one of its keys, {', '.join(below)}")
    target: Any = table
    for parent in parents:
        target = target.setdefault(parent, {}) if isinstance(target, dict) else {}
    try:
        (target[leaf],) = tomllib.loads(f"value = {value}").values()
    except ValueError:
        raise CellError(f"{where}: {value!r} is not a value such as {target.get(leaf, 1.0)}") from None


def _source(line: str, source: str, settings: Mapping[str, str]) -> str:
    """Where a problem came from: the file, or a key laid over it."""
    key = line.split(" = ")[0]
    return f"{source} with --set" if key in settings else source


def _is_echo(problem: Any) -> bool:
    """Whether a problem only repeats that an element of an array, reported by itself, is wrong."""
    return problem["type"] == "too_short" and len(problem["input"]) > 0
