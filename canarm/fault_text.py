"""Faults in lines of text: the catalogue for people to read, and values as they are typed on a command line."""

import fnmatch
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from canarm_protocol.cell_messages import nearest
from canarm_protocol.faults import ParameterValue

from .usage import UsageError

_SWITCHES = {"true": True, "false": False}


def parse_parameters(words: Iterable[str]) -> dict[str, ParameterValue]:
    """`key=value` words; numbers and true/false get their types. Raises `UsageError`."""
    parameters: dict[str, ParameterValue] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or not key or not text:
            raise UsageError(f"{word}: write KEY=VALUE, a parameter of the fault; they are in `canarm fault list`")
        if key in parameters:
            raise UsageError(f"{word}: {key} is given twice")
        parameters[key] = _value(text)
    return parameters


def _value(text: str) -> ParameterValue:
    if text in _SWITCHES:
        return _SWITCHES[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def select_taps(taps: Sequence[Mapping[str, Any]], pattern: str | None) -> list[Mapping[str, Any]]:
    """The taps of a catalogue whose names match `pattern`, with `*` for anything. Raises `UsageError` for none."""
    if pattern is None:
        return list(taps)
    found = [tap for tap in taps if fnmatch.fnmatchcase(tap["tap"], pattern)]
    if not found:
        names = [tap["tap"] for tap in taps]
        raise UsageError(f"--tap {pattern}: no such tap{nearest(pattern, names)}; taps are {', '.join(names)}")
    return found


def catalogue_lines(taps: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """A line a tap, a fault and a parameter."""
    for tap in taps:
        unit = f" [{tap['unit']}]" if tap["unit"] else ""
        yield f"{tap['tap']}{unit}: {tap['about']}"
        for fault in tap["faults"]:
            needs = " (needs --wire)" if fault["needs_wire"] else ""
            yield f"  {fault['fault']:<22} {fault['about']}{needs}"
            for parameter in fault["parameters"]:
                yield f"    {parameter['name']:<20} {_limits(parameter)}: {parameter['about']}"


def _limits(parameter: Mapping[str, Any]) -> str:
    default = parameter["default"]
    usual = "" if default is None else f"{default:g}" if isinstance(default, float | int) else str(default)
    if "choices" in parameter:
        return f"{usual} ({' | '.join(parameter['choices'])})"
    unit = f" {parameter['unit']}" if parameter["unit"] else ""
    bounds = f"({parameter['minimum']:g} to {parameter['maximum']:g}{unit})"
    return f"{usual} {bounds}" if usual else bounds


def status_lines(status: Mapping[str, Any]) -> Iterator[str]:
    """A line a set, and one a fault that acts now."""
    cycle = f"cycle {status['cycle']}" if status["cycle"] >= 0 else "before the first cycle"
    yield f"{cycle}: {len(status['active'])} faults act, {status['begun']} have begun"
    for each in status["sets"]:
        yield f"  set {each['set']!r}: {each['state']}, active {each['activations']} times"
        yield from (f"    {one['tap']} {one['fault']}" for one in status["active"] if one["set"] == each["set"])
