"""Declarations of faults as a user writes them: sets with a trigger and a duration, in TOML.

Modelled on the error configurations of ASAM XIL's EES port: an ordered list of error sets, each with its trigger. Taps
and kinds of fault are not known here; the emulator refuses what it does not support.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from ..cell.cell_messages import nearest
from ..errors import FaultError
from ..shown import quoted
from ..text_file import parse_toml, read_text

ParameterValue = float | int | str | bool

LARGEST_TEXT = 100_000
"""Most characters of a text; in a file each takes at most four bytes."""
MOST_SETS = 1000
MOST_FAULTS = 100
LONGEST_NAME = 80
LONGEST_S = 1e6
LARGEST_WHOLE = (1 << 31) - 1
IDENTIFIER = "cob_id"
"""A parameter of this name is shown in hexadecimal."""
_TRIGGERS = ("at", "cycle", "when", "manual")
_SET_KEYS = ("name", *_TRIGGERS, "duration", "repeat", "period", "fault")
_SCRIPT_KEYS = ("set", "parallel", "clear", "trigger")


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """One fault at one tap, with the parameters that were given."""

    tap: str
    fault: str
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Trigger:
    """What makes a set active: whichever is not None. Without any, it becomes active as soon as its turn has come.

    `at_s` and `cycle` count from the first SYNC after NMT start, `when` is a condition over true signals, `is_manual`
    waits for a command.
    """

    at_s: float | None = None
    cycle: int | None = None
    when: str | None = None
    is_manual: bool = False


def trigger_text(trigger: Trigger) -> str:
    """The trigger in words; empty for none."""
    if trigger.at_s is not None:
        return f"at {trigger.at_s:g} s"
    if trigger.cycle is not None:
        return f"in cycle {trigger.cycle}"
    return f"when {trigger.when}" if trigger.when is not None else "by hand" * trigger.is_manual


@dataclass(frozen=True, slots=True)
class FaultSet:
    """Faults that become active together. Without a duration they last until cleared, or until the next set's turn.

    There are `repeat` activations in all. They begin `period_s` apart or, if that is None, whenever the trigger allows.
    """

    name: str
    faults: tuple[FaultSpec, ...]
    trigger: Trigger = Trigger()
    duration_s: float | None = None
    repeat: int = 1
    period_s: float | None = None


@dataclass(frozen=True, slots=True)
class FaultScript:
    """What one text asks for: sets, one after the other or in parallel; or clearing sets; or triggering one by hand.

    `clear` is the name of a set, or "" for all of them.
    """

    sets: tuple[FaultSet, ...] = ()
    is_parallel: bool = False
    clear: str | None = None
    trigger: str | None = None


def parse_faults(text: str, source: str = "fault file") -> FaultScript:
    """Read the TOML `text`; `source` names it in error messages. Raises `FaultError`: what, where, what would be right.

    ```toml
    [[set]]
    name = "tachometer dies"
    at = 1.0                    # s; or cycle = 400, when = "joint2.angle_deg > 30", manual = true
    duration = 0.5              # s

    [[set.fault]]
    tap = "joint2.tachometer"
    fault = "stuck"             # its parameters stand beside it
    ```
    """
    if len(text) > LARGEST_TEXT:
        raise FaultError(f"{source}: {len(text)} characters; must have at most {LARGEST_TEXT}")
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise FaultError(f"{source}: {' '.join(str(error).split())[:200]}") from None
    return script_of(table, source)


def read_faults(path: Path) -> FaultScript:
    """Read the TOML file `path`. Raises `FaultError`: file, what is wrong, what would be right."""
    try:
        text = read_text(path, 4 * LARGEST_TEXT, "a fault file")
    except (OSError, ValueError) as error:
        why = f"cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error)
        raise FaultError(f"fault file {path}: {why}") from None
    return parse_faults(text, str(path))


def limits_text(name: str, minimum: float, maximum: float, unit: str = "") -> str:
    """The range of the parameter `name`: `0 to 5 V`, or `0x0 to 0x7FF` for an identifier."""
    low, high = (f"0x{int(each):X}" if name == IDENTIFIER else f"{each:g}" for each in (minimum, maximum))
    return f"{low} to {high} {unit}".rstrip()


def clearing(name: str | None = None) -> FaultScript:
    """The script that clears the set `name`, or all sets where that is None.

    Raises `FaultError` for an empty name: an unset variable of a shell is not to clear everything.
    """
    if name == "":
        raise FaultError("clear: the name of the set is empty; leave it out to clear all sets")
    return FaultScript(clear=name or "")


def script_of(table: Mapping[str, Any], source: str = "faults") -> FaultScript:
    """The script that `table`, a parsed TOML text, declares; numbers may be numpy's. Raises `FaultError`."""
    _check_keys(table, _SCRIPT_KEYS, source)
    parallel, clear, trigger = table.get("parallel", False), table.get("clear"), table.get("trigger")
    if not isinstance(parallel, bool):
        raise FaultError(f"{source}: parallel = {quoted(parallel)}: must be true or false")
    for key, value, others in (("clear", clear, ', or "" for all sets'), ("trigger", trigger, "")):
        if value is not None and not isinstance(value, str):
            raise FaultError(f"{source}: {key} = {quoted(value)}: must be the name of a set{others}")
    entries = _array(table, "set", source)
    if len(entries) > MOST_SETS:
        raise FaultError(f"{source}: {len(entries)} sets; must be at most {MOST_SETS}")
    asked = (bool(entries) or parallel, clear is not None, trigger is not None)
    if sum(asked) > 1:
        raise FaultError(f"{source}: 'clear' and 'trigger' stand alone; sets go into a text of their own")
    if not entries and clear is None and trigger is None:
        raise FaultError(f'{source}: holds no set; to clear all, write clear = ""')
    sets = tuple(_set(entry, f"{source}: set {number}", number) for number, entry in enumerate(entries, start=1))
    names = [each.name for each in sets]
    for name in names:
        if names.count(name) > 1:
            raise FaultError(f"{source}: {names.count(name)} sets are named {quoted(name)}; names must differ")
    return FaultScript(sets, parallel, clear, trigger)


def _set(entry: Mapping[str, Any], where: str, number: int) -> FaultSet:
    _check_keys(entry, _SET_KEYS, where)
    name = entry.get("name", f"set {number}")
    if not isinstance(name, str) or not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise FaultError(
            f"{where}: name = {quoted(name)}: must be one line of 1 to {LONGEST_NAME} printable characters"
        )
    where = f"{where} ({quoted(name)})" if "name" in entry else where
    given = [key for key in _TRIGGERS if key in entry]
    if len(given) > 1:
        raise FaultError(f"{where}: has {' and '.join(given)}; must have one trigger: {', '.join(_TRIGGERS)}")
    trigger = Trigger(
        at_s=_seconds(entry, "at", where, least=0.0),
        cycle=_whole(entry, "cycle", where, least=0),
        when=_text(entry, "when", where),
        is_manual=_switch(entry, "manual", where),
    )
    duration_s, period_s = _seconds(entry, "duration", where), _seconds(entry, "period", where)
    repeat = _whole(entry, "repeat", where, least=1) or 1
    if repeat > 1 and duration_s is None:
        raise FaultError(f"{where}: repeat = {repeat}: needs a duration, after which the faults end and come again")
    if period_s is not None and repeat == 1:
        raise FaultError(f"{where}: period = {period_s:g}: needs repeat, 2 or more: how often the faults come in all")
    if period_s is not None and duration_s is not None and period_s <= duration_s:
        raise FaultError(f"{where}: period = {period_s:g}: must be longer than the duration, {duration_s:g} s")
    faults = _array(entry, "fault", where)
    if len(faults) > MOST_FAULTS:
        raise FaultError(f"{where}: {len(faults)} faults; must be at most {MOST_FAULTS}")
    specs = tuple(_fault(each, f"{where}, fault {position}") for position, each in enumerate(faults, start=1))
    return FaultSet(name, specs, trigger, duration_s, repeat, period_s)


def _fault(entry: Mapping[str, Any], where: str) -> FaultSpec:
    for key in ("tap", "fault"):
        if not isinstance(entry.get(key), str):
            raise FaultError(f'{where}: must have {key} = "..."; see `canarm fault list`')
    parameters = {key: _plain(value) for key, value in entry.items() if key not in ("tap", "fault")}
    for key, value in parameters.items():
        if not isinstance(value, float | int | str | bool):
            raise FaultError(f"{where}: {key} = {quoted(value)}: must be a number, a text, or true or false")
    return FaultSpec(entry["tap"], entry["fault"], parameters)


def _plain(value: Any) -> Any:
    """`value`, with numbers of numpy and other types made Python's own."""
    if isinstance(value, bool):
        return value
    return int(value) if isinstance(value, Integral) else float(value) if isinstance(value, Real) else value


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise FaultError(f"{where}: unknown key {quoted(key)}{nearest(key, known)}")


def _array(table: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    value = table.get(key, [])
    if not isinstance(value, list) or not all(isinstance(each, Mapping) for each in value):
        raise FaultError(f"{where}: {quoted(key)} must be tables, each headed [[{'set.' * (key == 'fault')}{key}]]")
    return value


def _seconds(table: Mapping[str, Any], key: str, where: str, least: float | None = None) -> float | None:
    value = _plain(table.get(key))
    if value is None:
        return None
    is_number = isinstance(value, float | int) and not isinstance(value, bool)
    if not is_number or not (value > 0.0 or value == least) or value > LONGEST_S:
        bound = "at least 0" if least == 0.0 else "greater than 0"
        raise FaultError(
            f"{where}: {key} = {quoted(value)}: must be a number of seconds, {bound}, at most {LONGEST_S:g}"
        )
    return float(value)


def _whole(table: Mapping[str, Any], key: str, where: str, least: int) -> int | None:
    value = _plain(table.get(key))
    if value is None:
        return None
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= LARGEST_WHOLE:
        raise FaultError(
            f"{where}: {key} = {quoted(value)}: must be a whole number, at least {least}, at most {LARGEST_WHOLE}"
        )
    return value


def _text(table: Mapping[str, Any], key: str, where: str) -> str | None:
    value = table.get(key)
    if value is not None and not isinstance(value, str):
        raise FaultError(f'{where}: {key} = {quoted(value)}: must be text, such as "joint2.angle_deg > 30"')
    return value


def _switch(table: Mapping[str, Any], key: str, where: str) -> bool:
    value = table.get(key, False)
    if not isinstance(value, bool):
        raise FaultError(f"{where}: {key} = {quoted(value)}: must be true or false")
    return value
