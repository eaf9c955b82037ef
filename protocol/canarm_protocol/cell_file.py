"""Reading a cell: a shipped name or a TOML file, with keys of the command line laid over it."""

import difflib
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from .cell import Cell
from .errors import CellError


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

    `name_or_path` is the name of a shipped cell ("konkuk1") or the path of a TOML file. `settings` are keys laid over it,
    dotted as on the command line ("control.mras.gamma_bias" → "10").

    Raises `CellError`, one line a problem: file, key, value, and what would be right.
    """
    shipped = shipped_cells()
    if name_or_path in shipped:
        source, text = f"cell {name_or_path}", shipped[name_or_path]
    else:
        path = Path(name_or_path)
        source = str(path)
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise CellError(
                f"{name_or_path}: no such cell or file; shipped cells: {', '.join(shipped)}"
            ) from None
        except (OSError, UnicodeDecodeError) as error:
            raise CellError(f"{name_or_path}: cannot be read as a cell file: {error}") from None
    return parse_cell(text, source, settings)


def parse_cell(text: str, source: str, settings: Mapping[str, str] | None = None) -> Cell:
    """Validate the TOML `text` of a cell; `source` names it in error messages. Raises `CellError`."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CellError(f"{source}: not valid TOML: {error}") from None
    for key, value in (settings or {}).items():
        _lay_over(table, key, value)
    try:
        return Cell.model_validate(_frozen(table))
    except ValidationError as error:
        raise CellError("\n".join(_explain(source, problem) for problem in error.errors() if not _is_echo(problem))) from None


def setting_keys(cell: Cell) -> dict[str, object]:
    """Every key that `--set` takes, with its nominal value: the leaves of `[control]` and `[supervision]`."""
    keys: dict[str, object] = {}

    def walk(prefix: str, table: Mapping[str, Any]) -> None:
        for name, value in table.items():
            if isinstance(value, Mapping):
                walk(f"{prefix}.{name}", value)
            else:
                keys[f"{prefix}.{name}"] = value

    walk("control", cell.control.model_dump())
    walk("supervision", cell.supervision.model_dump())
    return keys


def _frozen(value: Any) -> Any:
    """TOML arrays as tuples, which is what the strict schema takes."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def _lay_over(table: dict[str, Any], key: str, value: str) -> None:
    *parents, leaf = key.split(".")
    if not parents or parents[0] not in ("control", "supervision"):
        raise CellError(f"--set {key}={value}: keys begin with 'control.' or 'supervision.'; see `canarm check --keys`")
    target = table
    for parent in parents:
        target = target.get(parent, {})
        if not isinstance(target, dict):
            target = {}
    if leaf not in target:
        raise CellError(f"--set {key}={value}: no such key; see `canarm check --keys`{_nearest(leaf, target)}")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        raise CellError(f"--set {key}={value}: {value!r} is not a TOML value such as {target[leaf]!r}") from None
    if isinstance(target[leaf], float) and isinstance(parsed, int) and not isinstance(parsed, bool):
        parsed = float(parsed)
    target[leaf] = parsed


def _is_echo(problem: Any) -> bool:
    """Whether a problem only repeats that an element of an array, reported by itself, is wrong."""
    return problem["type"] == "too_short" and len(problem["input"]) > 0


def _explain(source: str, problem: Any) -> str:
    location, kind, value = problem["loc"], problem["type"], problem["input"]
    key = _dotted(location)
    if kind == "missing":
        return f"{source}: {key}: missing; this key is required"
    if kind == "extra_forbidden":
        return f"{source}: {key} = {value!r}: unknown key{_nearest(str(location[-1]), _fields_at(location[:-1]))}"
    message = problem["msg"].removeprefix("Value error, ")
    if kind == "value_error":
        prefix = f"{source}: {key}: " if key else f"{source}: "
        return "\n".join(prefix + line for line in message.splitlines())
    message = message.replace("valid tuple", "array")
    return f"{source}: {key} = {value!r}: {message[0].lower()}{message[1:]}"


def _dotted(location: tuple[str | int, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _fields_at(location: tuple[str | int, ...]) -> list[str]:
    model: Any = Cell
    for part in location:
        if isinstance(part, int):
            continue
        annotation = model.model_fields[part].annotation
        model = next((arg for arg in getattr(annotation, "__args__", ()) if isinstance(arg, type)), annotation)
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            return []
    return list(model.model_fields)


def _nearest(word: str, known: Any) -> str:
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else f"; known keys: {', '.join(known)}" if known else ""
