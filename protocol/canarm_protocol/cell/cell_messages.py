"""What is wrong with a value of a cell file, in terms of TOML: key, value, and what would be right."""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from ..canopen.frames import HIGHEST_NODE_ID
from ..cards import KINDS
from .brakes import BRAKE_TYPES, Brake
from .model import CARD_TYPES, Card, Cell

Location = tuple[str | int, ...]

_NAME = "must be lower-case letters, digits, '-' and '_', beginning with a letter, at most 32"
_SEPARATORS = re.compile("[._-]")
CARD_DEPTH = 2
"""Parts of the location of a card: `card`, and its place."""
SHORTEST_NAME, MOST_MEANT = 3, 4
SIMILAR = 0.6
"""How alike two words must be for one to be taken for the other, as `difflib` has it."""
LONGEST_NODE_ID = 3
"""Digits of a node-ID in decimal, 1 to 127; names have them in hexadecimal, node.0x12."""
_SIGNAL = 'must be "<joint>.<command or sensor>", such as "joint2.potentiometer"'

_RULES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "greater_than": lambda limits: f"must be greater than {limits['gt']:g}",
    "greater_than_equal": lambda limits: f"must be at least {limits['ge']}",
    "zero": lambda limits: f"must not be 0, but at least {limits['least']:g} either way",
    "too_small": lambda limits: f"must be at least {limits['least']:g}",
    "less_than": lambda limits: f"must be less than {limits['lt']:g}",
    "less_than_equal": lambda limits: f"must be at most {limits['le']}",
    "finite_number": lambda _: "must be a finite number",
    "int_type": lambda _: "must be a whole number",
    "float_type": lambda _: "must be a number",
    "bool_type": lambda _: "must be true or false",
    "string_type": lambda _: 'must be text in "quotes"',
    "string_too_long": lambda _: _NAME,
    "literal_error": lambda allowed: f"must be {allowed['expected']}",
    "enum": lambda allowed: f"must be {allowed['expected']}",
    "too_short": lambda sizes: f"must have at least {sizes['min_length']} of them",
    "too_long": lambda sizes: f"must have at most {sizes['max_length']} of them",
    "tuple_type": lambda _: "must be an array, [...]",
    "model_type": lambda _: "must be a table",
}
"""Texts by pydantic's types of problem."""

_REVERSED = {
    "torque_constant_nm_a": "motor.sign = -1 turns a motor round",
    "full_scale_a": "the sense shows no sign; motor.sign = -1 turns a motor round",
    "max_current_a": "motor.sign = -1 turns a motor round",
    "full_scale_v": "sign = -1 turns the sensor round",
    "lines": "sign = -1 turns the encoder round",
}
"""What a negative value was meant for, by key."""


def explain(problem: Mapping[str, Any], table: Mapping[str, Any]) -> str:
    """One line for one problem of `ValidationError.errors()`, found in `table`."""
    location, kind, value = problem["loc"], problem["type"], problem["input"]
    key = spelled(location, table)
    last = location[-1]
    if kind == "missing":
        return (
            f"{key}: is missing"
            if isinstance(last, str)
            else f"{key} = {_toml(value, key)}: element {last + 1} is missing"
        )
    if kind == "extra_forbidden":
        what = "table" if isinstance(value, Mapping) else "key"
        others = _models_with(str(last), location[:-1], table)
        if others:
            return f"{key}: unknown {what} of this model; a card of model {' or '.join(map(repr, others))} has it"
        return f"{key}: unknown {what}{nearest(str(last), keys_at(location[:-1], table))}"
    if last == "node_id" and isinstance(value, int):
        return f"{key} = {_toml(value, key)}: node-IDs are 0x01 to 0x{HIGHEST_NODE_ID:02X}"
    is_negative = isinstance(value, (int, float)) and value < 0
    meant = f"; {_REVERSED[str(last)]}" if is_negative and last in _REVERSED else ""
    return f"{key} = {_toml(value, key)}: {_rule(kind, problem, last)}{meant}"


def keys_at(location: Location, table: Any = None) -> list[str]:
    """The keys that the schema allows in a table, none if `location` is no table. `table` gives the cards' models."""
    model: Any = Cell
    for part in location:
        table = _within(table, part)
        if isinstance(part, int):
            if model is Card and isinstance(table, Mapping):
                model = CARD_TYPES.get(str(table.get("model")), Card)
            continue
        field = model.model_fields.get(part)
        annotation = field.annotation if field else None
        model = next((each for each in _arguments(annotation) if isinstance(each, type)), annotation)
        if not (isinstance(model, type) and issubclass(model, BaseModel)):
            return []
        if model is Brake and isinstance(table, Mapping):
            model = BRAKE_TYPES.get(str(table.get("kind")), Brake)
    return list(model.model_fields)


def _models_with(key: str, location: Location, table: Any) -> list[str]:
    """Models of card that have `key`, and are wired as the card at `location` is; none if that is no card."""
    for part in location:
        table = _within(table, part)
    own = KINDS.get(str(_within(table, "model"))) if len(location) == CARD_DEPTH and location[0] == "card" else None
    if own is None:
        return []
    return [name for name, kind in KINDS.items() if kind.takes is own.takes and key in kind.settings.model_fields]


def _arguments(annotation: Any) -> Iterable[Any]:
    """The arguments of a generic type, without annotations."""
    return (getattr(argument, "__origin__", argument) for argument in getattr(annotation, "__args__", ()))


def _within(table: Any, part: str | int) -> Any:
    try:
        return table[part]
    except (LookupError, TypeError):
        return None


def is_switch(location: Location) -> bool:
    """Whether the schema has a boolean at `location`."""
    model: Any = Cell
    for part in location:
        field = getattr(model, "model_fields", {}).get(part)
        annotation = field.annotation if field else None
        model = next((each for each in _arguments(annotation) if isinstance(each, type)), annotation)
    return model is bool


def nearest(word: object, known: Iterable[str], see: str = "") -> str:
    """A hint: the known word that was probably meant, or all of them, and what to `see`. `word` may be no word."""
    known = list(known)
    found = meant(word, known) if isinstance(word, str) else []
    if found:
        *most, last = map(repr, found)
        listed = f"{', '.join(most)} or {last}" if most else last
        return f"; did you mean {listed}?" + (f" See {see}" if see else "")
    return (f"; known are {', '.join(known)}" if known else "") + (f"; see {see}" if see else "")


def near_and_all(word: object, known: Iterable[str]) -> str:
    """As `nearest`, and all that is known in any case, once."""
    known = list(known)
    near = nearest(word, known)
    return near if "known are" in near else f"{near} There are {', '.join(known)}"


def meant(word: str, known: Iterable[str]) -> list[str]:
    """What was probably meant: the same word among `known` in other letters or another order, the only one that begins
    with it, or a similar one. Several where it could be of any robot: `elbow` where each has one. None if nothing fits.
    """
    word, names = word.casefold(), {each.casefold(): each for each in known}
    stem, _, number = word.rpartition(".")
    if number.isdecimal() and len(number) <= LONGEST_NODE_ID and f"{stem}.{int(number):#04x}" in names:
        return [names[f"{stem}.{int(number):#04x}"]]
    if word in names:
        return [names[word]]
    found = [each for each in names if _parts(each) == _parts(word)]
    if len(found) != 1:
        found = [each for each in names if each.startswith(word)]
    if len(found) != 1:
        found = [each for each in names if each.endswith(f"_{word}")] if len(word) >= SHORTEST_NAME else []
    if not found:
        close = difflib.get_close_matches(word, list(names), n=1)
        found = _of_any_robot(word, close[0], names) if close else []
    return [names[each] for each in found[:MOST_MEANT]]


def _of_any_robot(word: str, best: str, names: Iterable[str]) -> list[str]:
    """`best` alone if `word` begins like it, else all `names` with another beginning, a robot's name, than it."""
    separator = _SEPARATORS.search(best)
    if separator is None or separator[0] != "_":
        return [best]
    beginning = _SEPARATORS.split(word)[0]
    if difflib.SequenceMatcher(None, beginning, best[: separator.start()]).ratio() >= SIMILAR:
        return [best]
    return [each for each in names if each.endswith(best[separator.start() :])]


def _parts(name: str) -> list[str]:
    return sorted(_SEPARATORS.split(name))


def spelled(location: Location, table: Any) -> str:
    """A readable key path: tables of an array go by their names, as in `card 'adc'.slot`."""
    text = ""
    for part in location:
        table = _within(table, part)
        if isinstance(part, str):
            text += f".{part}" if text else part
        elif isinstance(table, Mapping):
            text += f" {table['name']!r}" if "name" in table else f" {table.get('number', f'#{part + 1}')}"
    return text


def _rule(kind: str, problem: Mapping[str, Any], last: str | int) -> str:
    if kind == "string_pattern_mismatch":
        return _SIGNAL if last == "signal" else _NAME
    rule = _RULES.get(kind)
    message: str = problem["msg"]
    return rule(problem.get("ctx", {})) if rule else message[0].lower() + message[1:]


def _toml(value: Any, key: str) -> str:
    """A value as TOML writes it, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, int) and key.endswith("node_id"):
        return f"0x{value:02X}"
    if isinstance(value, Mapping):
        return "{...}"
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item, key) for item in value)}]"
    return str(value)
