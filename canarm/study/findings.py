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
from ..summary import errors_count_later
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
    """Infinite where a run did not end as planned."""
    values: dict[str, Value]
    command: str

    @property
    def said(self) -> str:
        """The figure, or why there is none."""
        return f"{self.figure:.3g}" if math.isfinite(self.figure) else printable(self.state, 40)

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        figure = self.figure if math.isfinite(self.figure) else None
        return {"run": self.number, "state": self.state, "reason": self.reason, JUDGED: figure, "repeat": self.command}


@dataclass(frozen=True)
class Findings:
    """`columns` has a number for each run: the `METRICS`, NaN where a run has none, and each axis.

    Of an axis of names the number is the place of the name. `is_done` tells the runs that ended as planned, `worst`
    are those that did not, and then those with the largest errors: a run without a figure is none of them.
    """

    runs: int
    states: dict[str, int]
    columns: dict[str, Floats]
    is_done: NDArray[np.bool_]
    worst: tuple[Case, ...]

    def lines(self) -> Iterable[str]:
        """In words, for a terminal."""
        yield from self.outcome()
        for case in self.worst[:3]:
            yield f"run {case.number}, {case.said}: {printable(case.command, 600)}"

    def known(self, metric: str) -> NDArray[np.bool_]:
        """Which runs ended as planned and have that figure."""
        return self.is_done & np.isfinite(self.columns[metric])

    def outcome(self) -> Iterable[str]:
        """Counts and figures in words."""
        ends = ", ".join(f"{count} {printable(state, 40)}" for state, count in self.states.items())
        yield f"{self.runs} run{'s' * (self.runs != 1)}: {ends}"
        for name, title in METRICS.items():
            values = self.columns[name][self.known(name)]
            if len(values):
                middle, high = np.percentile(values, [50, 90])
                yield f"{title}, worst joint: median {middle:.3g}, 90 % below {high:.3g}, most {values.max():.3g}"
        if missing := int(np.count_nonzero(self.is_done & ~self.known(JUDGED))):
            yield f"{missing} run{'s' * (missing != 1)} without a figure of errors: {errors_count_later('seconds')}"


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
        if math.isnan(figure):
            continue
        entry = (figure, -row["run"], row)
        (heapq.heappush if len(worst) < WORST_SHOWN else heapq.heappushpop)(worst, entry)
    cases = tuple(_case(study, row, figure) for figure, _, row in sorted(worst, key=lambda each: (-each[0], -each[1])))
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
