"""Reading the events of a run, also of one that goes on, was cut off or was damaged: what can be read is read.

What the events mean is not known here.
"""

import itertools
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..text_file import read_text
from .run_folder import later_run

LARGEST_EVENTS = 256 << 20
"""Bytes; a run of an hour with a fault a second has two million."""
LATEST_S = 1e9
"""No run takes thirty years, and nanoseconds of such a time fit into 64 bits."""
LARGEST_NUMBER = 1e15
"""No number in an event is larger."""
LONGEST_NUMBER = 40
"""Characters; Python writes 24 at most."""


def runs_of(folder: Path) -> Iterator[Path]:
    """The folders of the runs that an emulator has recorded into `folder`, which is the first."""
    yield folder
    for number in itertools.count(2):
        later = later_run(folder, number)
        if later.is_symlink() or not later.is_dir():
            return
        yield later


def event_lines(path: Path, complain: Callable[[str], None] = lambda text: None) -> list[dict[str, Any]]:
    """The events in a file, in the order of their times; none if there is no file.

    Every event has `time_s` (a number; minus infinity where it is not known, which is only before cycle 0), `event`
    (a text) and `cycle`; all its other numbers are finite. `complain` is told of lines that are no events, and of a
    last one without an end.
    """
    try:
        text = read_text(path, LARGEST_EVENTS, "a list of events", "JSON lines")
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        complain(f"{path.name}: cannot be read: {getattr(error, 'strerror', None) or error}")
        return []
    events, bad, end = [], 0, text.rfind("\n") + 1
    for line in text[:end].splitlines():
        event = _event(line)
        if event is None:
            bad += 1
        else:
            events.append(event)
    if bad:
        complain(f"{path.name}: {bad} {'line is' if bad == 1 else 'lines are'} no event and left out")
    if end < len(text):
        complain(f"{path.name}: its last line is cut off and left out")
    return sorted(events, key=lambda event: float(event["time_s"]))


def _event(line: str) -> dict[str, Any] | None:
    try:
        event = json.loads(line, parse_int=_whole, parse_float=_number, parse_constant=_number)
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or not isinstance(event.get("event"), str):
        return None
    time_s, cycle = event.get("time_s"), event.get("cycle", -1)
    if not isinstance(cycle, int):
        return None
    if time_s is None and cycle < 0:
        time_s = -math.inf
    elif not isinstance(time_s, int | float) or abs(time_s) > LATEST_S:
        return None
    return {**event, "time_s": float(time_s), "cycle": cycle}


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER:
        raise ValueError(text)
    return value


def _whole(text: str) -> int:
    if len(text) > LONGEST_NUMBER or abs(value := int(text)) > LARGEST_NUMBER:
        raise ValueError(text)
    return value
