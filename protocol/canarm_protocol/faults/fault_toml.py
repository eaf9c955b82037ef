"""Fault scripts as text: the TOML that `faults.parse_faults` reads back. What a script means is not known here."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from .script import FaultScript, FaultSet, FaultSpec


def as_toml(script: FaultScript) -> str:
    """The text that `parse_faults` reads as `script`."""
    plain = {"parallel": script.is_parallel or None, "clear": script.clear, "trigger": script.trigger}
    lines = [*_lines(plain), *(line for each in script.sets for line in _set_lines(each))]
    return "\n".join([*lines, ""])


def _set_lines(declared: FaultSet) -> Iterable[str]:
    trigger = declared.trigger
    yield "[[set]]"
    yield from _lines(
        {
            "name": declared.name,
            "at": trigger.at_s,
            "cycle": trigger.cycle,
            "when": trigger.when,
            "manual": trigger.is_manual or None,
            "duration": declared.duration_s,
            "repeat": declared.repeat if declared.repeat > 1 else None,
            "period": declared.period_s,
        }
    )
    for spec in declared.faults:
        yield "[[set.fault]]"
        yield from _lines(_spec_table(spec))


def _spec_table(spec: FaultSpec) -> dict[str, Any]:
    return {"tap": spec.tap, "fault": spec.fault, **spec.parameters}


def _lines(table: Mapping[str, Any]) -> Iterable[str]:
    """Strings, numbers and booleans are written alike in JSON and TOML, except DEL, which names cannot have."""
    given = ((key, value) for key, value in table.items() if value is not None)
    return [f"{json.dumps(key)} = {json.dumps(value, ensure_ascii=False)}" for key, value in given]
