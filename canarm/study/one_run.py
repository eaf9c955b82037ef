"""One run of a study in this process, as a row of its table. What a row means for the study is not known here."""

import functools
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import first_line, named_error, printable

from ..open_cell import open_cell
from ..rig.rig import Rig
from ..summary import Summary
from .beginnings import from_beginning
from .plan import Settings

Row = dict[str, Any]
"""Column → number, text, truth value or None."""
FIGURES = ("rms_lsb", "max_lsb", "peak_current_a", "saturated_cycles", "speed_ripple")
HISTORY_S = 1.0
"""A run keeps no more of its course than that: a row has only figures, which the bench counts."""
DONE, FAILED, BROKEN = "done", "failed", "broken"
"""The states of a run: ended as planned, in a safe stop, or it could not be carried out."""
STATES = (DONE, FAILED, BROKEN)


@dataclass(frozen=True, slots=True)
class Task:
    """Run `number` of a study: its settings, and the columns that say what varies.

    `shares` says that others differ from it in their faults alone.
    """

    number: int
    settings: Settings
    varied: tuple[tuple[str, Any], ...]
    shares: bool = False


def run_task(task: Task) -> Row:
    """The row of one run. Whatever goes wrong is in it."""
    try:
        return _row(task, _summary(task))
    except CanarmError as error:
        return broken(task, str(error))
    except Exception as error:
        return broken(task, named_error(error))


def broken(task: Task, why: object) -> Row:
    """The row of a run that could not be carried out."""
    return {"run": task.number, **dict(task.varied), "state": BROKEN, "reason": first_line(why)}


def _summary(task: Task) -> Summary:
    settings = task.settings
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a thousand runs each would warn of the same
        if task.shares:
            cell = _load(settings.cell, settings.settings)
            summary = from_beginning(settings, cell, _rig)
            if summary is not None:
                return summary
        with _rig(settings) as rig:
            rig.run(settings.seconds)
            return rig.finish()


def _rig(settings: Settings) -> Rig:
    return Rig(
        _load(settings.cell, settings.settings),
        settings.law,
        settings.trajectory,
        feedforward=settings.feedforward,
        seed=settings.seed,
        wire=settings.wire,
        truth=dict(settings.truth),
        faults=None if settings.faults is None else Path(settings.faults),
        history_s=min(settings.seconds, HISTORY_S),
    )


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
