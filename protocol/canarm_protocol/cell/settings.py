"""The keys of `--set`: gains, limits and the object that robots carry, laid over a cell before the schema judges it.

Those of one joint go by its name: `control.joint2.mras.gamma_bias` is the table of joint2 in `[[control.joint]]`.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from ..errors import CellError
from ..shown import printable
from ..text_file import parse_toml
from .cell_messages import is_switch, keys_at, nearest
from .control import Control, JointControl
from .model import Cell

SETTABLE = ("control", "supervision", "object")
"""The tables whose keys `--set` takes."""
SWITCH = {"0": "false", "1": "true", "false": "false", "true": "true"}
"""How a switch is written on a command line, and how in TOML."""
_OWN = ("control", "joint", 0)
_OF_A_JOINT = re.compile(r"control\.joint '([^']+)'")


def lay_over(table: dict[str, Any], key: str, value: str, option: str) -> None:
    """Put one setting, given in `option`, into the `table` of a cell as its file has it.

    Raises `CellError` for a key that there is not, and for what is no value.
    """
    where = printable(f"{option} {key}={value}")
    parts = key.split(".")
    if parts[0] not in SETTABLE or len(parts) == 1:
        raise CellError(f"{where}: keys begin with 'control.', 'supervision.' or 'object.'; see `canarm check --keys`")
    if parts[0] == "object" and "object" not in table:
        raise CellError(f"{where}: nothing is carried in this cell, it has no [object]")
    joint = parts[1] if parts[0] == "control" and parts[1] in _own_names(table) else None
    location: tuple[str | int, ...] = (parts[0],) if joint is None else _OWN
    rest = parts[1 if joint is None else 2 :]
    for place, part in enumerate(rest):
        known = _keys_at(location, table)
        if part not in known:
            whole = "_".join(rest[place : place + 2])
            hint = nearest(whole if whole in known else part, known)
            raise CellError(f"{where}: no such key (see `canarm check --keys`){hint}")
        location = (*location, part)
    below = _keys_at(location, table)
    if below:
        raise CellError(f"{where}: is a table; set one of its keys, {', '.join(below)}")
    *parents, leaf = parts if joint is None else parts[2:]
    target: Any = table if joint is None else _own_table(table, joint)
    for parent in parents:
        target = target.setdefault(parent, {}) if isinstance(target, dict) else {}
    if not isinstance(target, dict):
        return  # the schema says so
    if is_switch(location):
        value = SWITCH.get(value.lower(), value)
    try:
        (target[leaf],) = parse_toml(f"value = {value}").values()
    except ValueError:
        raise CellError(f"{where}: {printable(repr(value))} is not a value such as {target.get(leaf, 1.0)}") from None


def setting_keys(cell: Cell) -> dict[str, object]:
    """Every key that `--set` takes, with its nominal value: the leaves of the tables `SETTABLE`."""
    tables = {name: getattr(cell, name) for name in SETTABLE if getattr(cell, name) is not None}
    keys = {key: value for name, table in tables.items() for key, value in _leaves(name, table.model_dump())}
    for joint in cell.joint_names:
        if joint in Control.model_fields:
            continue
        whole = cell.control.of_joint(joint).model_dump()
        for key in JointControl.model_fields:
            own = keys_at((*_OWN, key))
            value = whole.get(key)
            if isinstance(value, Mapping):
                value = {name: each for name, each in value.items() if name in own}
            keys |= _leaves(f"control.{joint}", {key: value})
    return keys


def key_of(line: str) -> str:
    """The key of `--set` that a complaint of the schema, "key = value: ...", is about."""
    return _OF_A_JOINT.sub(r"control.\1", line.split(" = ")[0])


def _leaves(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(f"{prefix}.{name}", value)
        elif value is not None and not isinstance(value, tuple):
            yield f"{prefix}.{name}", value


def _keys_at(location: tuple[str | int, ...], table: Mapping[str, Any]) -> list[str]:
    """The keys that may follow; at `control` the names of joints as well."""
    keys = [key for key in keys_at(location) if location != _OWN or key != "name"]
    return [key for key in keys if key != "joint"] + _own_names(table) if location == ("control",) else keys


def _own_names(table: Mapping[str, Any]) -> list[str]:
    """Names of the joints in the whole cell, of a table that nobody has checked; not those that are keys as well."""
    pairs = [
        (str(robot.get("name")), str(joint.get("name")))
        for robot in _tables(table.get("robot"))
        for joint in _tables(robot.get("joint"))
    ]
    count = Counter(joint for _, joint in pairs)
    names = [f"{robot}_{joint}" if count[joint] > 1 else joint for robot, joint in pairs]
    return [name for name in names if name not in Control.model_fields]


def _own_table(table: dict[str, Any], joint: str) -> dict[str, Any]:
    """The joint's table in `[[control.joint]]`, a new one unless it is there."""
    control = table.setdefault("control", {})
    tables = control.setdefault("joint", []) if isinstance(control, dict) else []
    for own in _tables(tables):
        if own.get("name") == joint:
            return own
    own = {"name": joint}
    if isinstance(tables, list):
        tables.append(own)
    return own


def _tables(value: Any) -> list[dict[str, Any]]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []
