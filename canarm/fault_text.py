"""Faults as text: the catalogue for people to read, and values as typed on a command line."""

import fnmatch
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from canarm_protocol.cell.cell_messages import meant, nearest
from canarm_protocol.faults.script import IDENTIFIER, ParameterValue, limits_text

from .usage import UsageError, key_values

_SWITCHES = {"true": True, "false": False}
LONGEST_HEXADECIMAL = len("0x") + 16


def parse_parameters(words: Iterable[str]) -> dict[str, ParameterValue]:
    """`key=value` words; numbers and true/false get their types. Raises `UsageError`."""
    hint = ", a parameter of the fault; they are in `canarm fault list`"
    return {key: _value(text) for key, text in key_values(words, "", hint).items()}


def _value(text: str) -> ParameterValue:
    if text in _SWITCHES:
        return _SWITCHES[text]
    if not text.isascii() or "_" in text:  # Python's numbers may have digits of other scripts, and underscores
        return text
    for kind in (int, _hexadecimal, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _hexadecimal(text: str) -> int:
    if not text.lower().startswith("0x") or len(text) > LONGEST_HEXADECIMAL:
        raise ValueError(text)
    return int(text, 16)


def select_taps(taps: Sequence[Mapping[str, Any]], pattern: str | None) -> list[Mapping[str, Any]]:
    """The taps of a catalogue whose names match `pattern`, with `*` for anything. Raises `UsageError` for none."""
    if pattern is None:
        return list(taps)
    found = [tap for tap in taps if fnmatch.fnmatchcase(tap["tap"], pattern)]
    if not found:
        raise UsageError(f"--tap {pattern}: no such tap{_nearest_tap(pattern, [tap['tap'] for tap in taps])}")
    return found


def _nearest_tap(pattern: str, names: Sequence[str]) -> str:
    """A hint at what was meant, from the first part of the pattern: a joint or card."""
    if not any(sign in pattern for sign in "*?["):
        return nearest(pattern, names)
    head, dot, rest = pattern.partition(".")
    heads = list(dict.fromkeys(name.partition(".")[0] for name in names))
    found = [] if head in heads else meant(head, heads)
    if not found:
        return f"; names begin with {', '.join(heads)}"
    return f"; did you mean {' or '.join(repr(f'{each}{dot}{rest}') for each in found)}?"


def catalogue_lines(taps: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """One line per tap, fault and parameter."""
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
    if parameter["name"] == IDENTIFIER:
        usual = "0" if not default else f"0x{int(default):03X}"
    if "choices" in parameter:
        return f"{usual} ({' | '.join(parameter['choices'])})"
    bounds = f"({limits_text(parameter['name'], parameter['minimum'], parameter['maximum'], parameter['unit'])})"
    return f"{usual} {bounds}" if usual else bounds


MOST_DETECTIONS = 10
"""So many detections are shown, the last ones."""


def status_lines(status: Mapping[str, Any]) -> Iterator[str]:
    """Whether a run is on, then a line per set, one per active fault, and one per detection."""
    is_on = status["running"]
    run = (
        f"a run is on, cycle {status['cycle']}" if is_on else "no run is on: at and cycle count from the next NMT start"
    )
    yield f"{run}; {len(status['active'])} faults act, {status['begun']} have begun"
    for each in status["sets"]:
        yield f"  set {each['set']!r}: {each['state']}, {_times(each['activations'])}"
        yield from (f"    {one['tap']} {one['fault']}" for one in status["active"] if one["set"] == each["set"])
    for each in status["detections"][-MOST_DETECTIONS:]:
        yield f"  detected in cycle {each['cycle']}: {each['detector']}, {each['detail']} ({each['reaction']})"


def _times(activations: int) -> str:
    return ("has not begun", "has begun once")[activations] if activations < 2 else f"has begun {activations} times"
