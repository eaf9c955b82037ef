"""Reads a study file: TOML to a `Study`. Whether its names and values exist in a cell is checked elsewhere.

Every complaint says where in the file, what is wrong, and what would be right.
"""

import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.shown import printable, quoted
from canarm_protocol.text_file import parse_toml, read_text

from ..draws import Choice, Span, Value, Whole
from ..usage import UsageError, value_text
from .objective import Objective, parse_objective
from .plan import LARGEST_WHOLE, SET, TRUTH, Axis, Sample, Settings, Study

LARGEST_BYTES = 1_000_000
MOST_RUNS = 1_000_000
MOST_AXES = 32
LONGEST_S = 1e6
TOP = ("title", "sample", "draws", "draw_seed", "run", "vary", "tune")
PLAIN = ("cell", "law", "trajectory", "feedforward", "seed", "faults")
"""What of a run can vary, beside the keys of `--set` and `--truth`."""
TEXTS = ("cell", "law", "trajectory", "feedforward", "faults")
OF_A_RUN = (*PLAIN, "seconds", "wire", "set", "truth")
OF_A_SPAN = ("from", "to", "count", "scale")
SCALES = ("linear", "log")
DEFAULT_COUNT = 5


class _Problem(UsageError):
    """A complaint that does not name the file yet."""


def read_study(path: Path) -> tuple[Study, Objective]:
    """The study in the file `path`, and what tuning would look for. Raises `UsageError`."""
    source = printable(str(path))
    try:
        table = parse_toml(read_text(path, LARGEST_BYTES, "a study"))
        return _study(table, path.stem), parse_objective(_table(table, "tune"))
    except OSError as error:
        raise UsageError(f"{source}: cannot be read: {error.strerror}") from None
    except ValueError as error:  # a `UsageError` is one
        raise UsageError(f"{source}: {printable(str(error), 500)}") from None


def _study(table: Mapping[str, Any], stem: str) -> Study:
    _known(table, TOP, "")
    title = table.get("title", stem)
    if not isinstance(title, str):
        raise _Problem(f"title = {quoted(title)}: must be a text")
    base = _settings(_table(table, "run"))
    vary = _table(table, "vary")
    sample = _sample(table)
    found = list(_axes(vary, sample is Sample.GRID))
    if not found:
        raise _Problem(
            "[vary]: is missing or empty; name what varies, as law = ['pd', 'mras'] or seed = {from=0, to=9}"
        )
    if len(found) > MOST_AXES:
        raise _Problem(f"[vary]: {len(found)} axes; at most {MOST_AXES}")
    axes, steps = tuple(axis for axis, _ in found), tuple(count for _, count in found)
    draws = _whole(table, "draws", 100, 1, MOST_RUNS)
    if sample is Sample.GRID and "draws" in table:
        raise _Problem('draws: is for sample = "random" or "latin-hypercube"; a grid takes every combination')
    study = Study(title, base, axes, steps, sample, draws, _whole(table, "draw_seed", 0, 0, LARGEST_WHOLE))
    if (size := math.prod(steps)) > MOST_RUNS and sample is Sample.GRID:
        raise _Problem(f"[vary]: a grid of {size} runs; at most {MOST_RUNS}: take fewer values, or a sample of draws")
    return study


def _sample(table: Mapping[str, Any]) -> Sample:
    name = table.get("sample", Sample.GRID.value)
    try:
        return Sample(name)
    except ValueError:
        known = [each.value for each in Sample]
        hint = nearest(str(name), known)
        raise _Problem(f"sample = {quoted(name)}: must be one of {', '.join(known)}{hint}") from None


def _settings(run: Mapping[str, Any]) -> Settings:
    _known(run, OF_A_RUN, "run.")
    plain = {name: _plain(name, value, "run.") for name, value in run.items() if name in PLAIN}
    seconds, wire = run.get("seconds", Settings().seconds), run.get("wire", False)
    is_number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
    if not is_number or not 0.0 < seconds <= LONGEST_S:
        raise _Problem(f"run.seconds = {quoted(seconds)}: must be a number of seconds above 0, at most {LONGEST_S:g}")
    if not isinstance(wire, bool):
        raise _Problem(f"run.wire = {quoted(wire)}: must be true or false")
    pairs = {
        key: tuple((name, value_text(_value(value, f"run.{key}.{name}"))) for name, value in _leaves(_table(run, key)))
        for key in ("set", "truth")
    }
    return Settings(**plain, seconds=float(seconds), wire=wire, settings=pairs["set"], truth=pairs["truth"])


def _axes(vary: Mapping[str, Any], is_grid: bool) -> Iterable[tuple[Axis, int]]:
    _known(vary, (*PLAIN, "set", "truth"), "vary.")
    named = [(name, value) for name, value in vary.items() if name in PLAIN]
    for prefix in (SET, TRUTH):
        named += [(prefix + name, value) for name, value in _leaves(_table(vary, prefix.rstrip(".")))]
    named.sort(
        key=lambda pair: pair[0] == "faults"
    )  # fastest: runs that differ in their faults alone follow each other
    for name, value in named:
        yield _axis(name, value, is_grid)


def _axis(name: str, value: Any, is_grid: bool) -> tuple[Axis, int]:
    where = f"vary.{name}"
    if isinstance(value, list):
        values = tuple(_plain(name, each, "vary.") if name in PLAIN else _value(each, where) for each in value)
        if not values or len(set(values)) < len(values):
            raise _Problem(f"{where} = {quoted(value)}: must be an array of different values")
        return Choice(name, values), len(values)
    if not isinstance(value, Mapping):
        raise _Problem(f"{where} = {quoted(value)}: must be an array of values, or {{from = 0.3, to = 0.9}}")
    _known(value, OF_A_SPAN, f"{where}.")
    if name in TEXTS:
        raise _Problem(f"{where}: must be an array of names")
    low, high = (_number(value, end, where) for end in ("from", "to"))
    scale = value.get("scale", SCALES[0])
    if scale not in SCALES:
        raise _Problem(f"{where}.scale = {quoted(scale)}: must be {' or '.join(SCALES)}")
    if not low < high or (scale == "log" and low <= 0.0):
        need = "must be above 0 and below" if scale == "log" else "must be below"
        raise _Problem(f"{where}.from = {low:g}: {need} to = {high:g}")
    if "count" in value and not is_grid:
        raise _Problem(f"{where}.count: is for a grid; a sample takes as many values as it has draws")
    if name == "seed":
        return _seeds(value, where)
    return Span(name, float(low), float(high), is_factor=scale == "log"), _whole(
        value, "count", DEFAULT_COUNT, 2, MOST_RUNS, f"{where}."
    )


def _seeds(value: Mapping[str, Any], where: str) -> tuple[Axis, int]:
    low, high = (_whole(value, end, 0, 0, LARGEST_WHOLE, f"{where}.") for end in ("from", "to"))
    return Whole("seed", low, high), _whole(value, "count", high - low + 1, 2, high - low + 1, f"{where}.")


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    """Dotted names and values: `joint3.mass = [...]` is the same as `"joint3.mass" = [...]`."""
    for name, value in table.items():
        if isinstance(value, Mapping) and not set(value) & set(OF_A_SPAN):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def _plain(name: str, value: Any, before: str) -> Any:
    if name == "seed":
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise _Problem(f"{before}seed = {quoted(value)}: must be a whole number, 0 or more")
        if value > LARGEST_WHOLE:
            raise _Problem(f"{before}seed = {quoted(value)}: must be at most {LARGEST_WHOLE}, 64 bits with a sign")
    elif not isinstance(value, str) or not value:
        raise _Problem(f"{before}{name} = {quoted(value)}: must be a text")
    return value


def _value(value: Any, where: str) -> Value:
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        raise _Problem(f"{where} = {quoted(value)}: must be a number of at most 64 bits, or one with a decimal point")
    if isinstance(value, bool):
        return value_text(value)
    if not isinstance(value, int | float | str) or (isinstance(value, float) and not math.isfinite(value)):
        raise _Problem(f"{where} = {quoted(value)}: must be a number or a text")
    return value


def _table(table: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = table.get(name, {})
    if not isinstance(found, Mapping):
        raise _Problem(f"{name} = {quoted(found)}: must be a table, [{name}]")
    return found


def _number(table: Mapping[str, Any], name: str, where: str) -> float:
    value = table.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= sys.float_info.max:
        raise _Problem(f"{where}.{name} = {quoted(value)}: must be a finite number")
    return value


def _whole(table: Mapping[str, Any], name: str, usual: int, low: int, high: int, before: str = "") -> int:
    value = table.get(name, usual)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise _Problem(f"{before}{name} = {quoted(value)}: must be a whole number from {low} to {high}")
    return value


def _known(table: Mapping[str, Any], known: Iterable[str], before: str) -> None:
    for name in table:
        if name not in known:
            raise _Problem(f"{before}{printable(name)}: unknown key{nearest(name, list(known))}")
