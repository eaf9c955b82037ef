"""One run of a study in this process, as a row of its table. What a row means for the study is not known here."""

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import first_line, named_error, printable

from ..open_cell import open_cell
from ..rig.rig import Rig
from ..summary import Summary
from .plan import Settings

Row = dict[str, Any]
"""Column → number, text, truth value or None."""
FIGURES = ("rms_lsb", "max_lsb", "peak_current_a", "saturated_cycles", "speed_ripple")
HISTORY_S = 1.0
"""A run keeps no more of its course than that: a row has only figures, which the bench counts."""
BROKEN = "broken"
"""The state of a run that could not be carried out."""


@dataclass(frozen=True, slots=True)
class Task:
    """Run `number` of a study: its settings, and the columns that say what varies."""

    number: int
    settings: Settings
    varied: tuple[tuple[str, Any], ...]


def run_task(task: Task) -> Row:
    """The row of one run. Whatever goes wrong is in it."""
    try:
        return _row(task, _summary(task.settings))
    except CanarmError as error:
        return broken(task, str(error))
    except Exception as error:
        return broken(task, named_error(error))


def broken(task: Task, why: object) -> Row:
    """The row of a run that could not be carried out."""
    return {"run": task.number, **dict(task.varied), "state": BROKEN, "reason": first_line(why)}


def _summary(settings: Settings) -> Summary:
    cell = _load(settings.cell, settings.settings)
    faults = None if settings.faults is None else Path(settings.faults)
    with Rig(
        cell,
        settings.law,
        settings.trajectory,
        feedforward=settings.feedforward,
        seed=settings.seed,
        wire=settings.wire,
        truth=dict(settings.truth),
        faults=faults,
        history_s=min(settings.seconds, HISTORY_S),
    ) as rig:
        rig.run(settings.seconds)
        return rig.finish()


def _row(task: Task, summary: Summary) -> Row:
    row: Row = {"run": task.number, **dict(task.varied)}
    row |= {"state": summary.state, "reason": None if summary.reason is None else printable(summary.reason)}
    row |= {"ticks": summary.ticks, "faults_begun": summary.faults, "detections": len(summary.detections)}
    first = summary.detections[0] if summary.detections else None
    row |= {
        "first_detector": first["detector"] if first else None,
        "first_where": first["where"] if first else None,
        "first_cycle": first["tick"] if first else None,
    }
    plain = summary.as_json()["joints"]
    for figure in FIGURES:
        of_joints = {joint: _number(figures[figure]) for joint, figures in plain.items()}
        known = [value for value in of_joints.values() if value is not None]
        row[f"worst.{figure}"] = max(known, default=None)
        row |= {f"{joint}.{figure}": value for joint, value in of_joints.items()}
    if summary.object is not None:
        row |= {f"object.{key}": _number(value) for key, value in summary.object.items() if key != "lost_by"}
    return row


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


@functools.lru_cache(maxsize=4)
def _load(cell: str, settings: tuple[tuple[str, str], ...]) -> Cell:
    """Cells take time to read and check; a process mostly needs the same one again."""
    return open_cell(cell, dict(settings))
