"""What came of a study: counts, the figures of all runs as columns, and its worst runs. Nothing is drawn here."""

import heapq
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.shown import printable

from ..draws import Choice, Value
from .journal import Journal
from .one_run import DONE
from .plan import Axis, Study

Floats = NDArray[np.float64]
METRICS = {
    "worst.rms_lsb": "RMS error, steps of the sensor",
    "worst.max_lsb": "largest error, steps of the sensor",
    "worst.peak_current_a": "peak current, A",
}
"""The figures that a page shows, each of the worst joint of a run."""
JUDGED = "worst.rms_lsb"
WORST_SHOWN = 20


@dataclass(frozen=True, slots=True)
class Case:
    """One run that stands out: what was set, what came of it, and the command that repeats it."""

    number: int
    state: str
    reason: str | None
    figure: float
    """NaN where a run that ended as planned has none, infinite of one that did not."""
    values: dict[str, Value]
    command: str

    @property
    def said(self) -> str:
        """The figure, or why there is none."""
        if math.isfinite(self.figure):
            return f"{self.figure:.3g}"
        return printable(self.state, 40) if self.state != DONE else "no figure"

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        figure = self.figure if math.isfinite(self.figure) else None
        return {"run": self.number, "state": self.state, "reason": self.reason, JUDGED: figure, "repeat": self.command}


@dataclass(frozen=True)
class Findings:
    """`columns` has a number for each run: the `METRICS`, NaN where a run has none, and each axis.

    Of an axis of names the number is the place of the name. `is_done` tells the runs that ended as planned.
    """

    runs: int
    states: dict[str, int]
    columns: dict[str, Floats]
    is_done: NDArray[np.bool_]
    worst: tuple[Case, ...]

    def lines(self) -> Iterable[str]:
        """In words, for a terminal."""
        ends = ", ".join(f"{count} {printable(state, 40)}" for state, count in self.states.items())
        yield f"{self.runs} runs: {ends}"
        for name, title in METRICS.items():
            values = self.columns[name][self.is_done]
            values = values[np.isfinite(values)]
            if len(values):
                middle, high = np.percentile(values, [50, 90])
                yield f"{title}, worst joint: median {middle:.3g}, 90 % below {high:.3g}, most {values.max():.3g}"
        for case in self.worst[:3]:
            yield f"run {case.number}, {case.said}: {printable(case.command, 600)}"


def findings_of(study: Study, journal: Journal) -> Findings:
    """What came of the runs that are done."""
    count = len(journal.places)
    columns = {name: np.full(count, math.nan) for name in (*METRICS, *(axis.name for axis in study.axes))}
    is_done: NDArray[np.bool_] = np.zeros(count, dtype=np.bool_)
    states: Counter[str] = Counter()
    worst: list[tuple[float, int, dict[str, Any]]] = []
    for place, row in enumerate(journal.rows()):
        state = str(row.get("state"))
        states[state] += 1
        is_done[place] = state == DONE
        for name in METRICS:
            columns[name][place] = _number(row.get(name))
        for axis in study.axes:
            columns[axis.name][place] = axis_number(axis, row.get(axis.name))
        figure = columns[JUDGED][place] if state == DONE else math.inf
        entry = (figure if math.isfinite(figure) else (math.inf if state != DONE else -1.0), -row["run"], row)
        (heapq.heappush if len(worst) < WORST_SHOWN else heapq.heappushpop)(worst, entry)
    cases = tuple(
        _case(study, row, figure if figure >= 0.0 else math.nan)
        for figure, _, row in sorted(worst, key=lambda each: (-each[0], -each[1]))
    )
    return Findings(count, dict(states), columns, is_done, cases)


def axis_number(axis: Axis, value: Any) -> float:
    """The number by which a column tells the value of an axis."""
    if isinstance(axis, Choice):
        return float(axis.values.index(value)) if value in axis.values else math.nan
    return _number(value)


def _case(study: Study, row: dict[str, Any], figure: float) -> Case:
    number, reason = int(row["run"]), row.get("reason")
    values = {axis.name: row[axis.name] for axis in study.axes if axis.name in row}
    return Case(number, str(row.get("state")), reason, figure, values, study.settings(number).command)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan
