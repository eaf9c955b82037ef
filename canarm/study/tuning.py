"""Looks for gains with which the runs of a study go best, by scipy's differential evolution. Nothing is run here.

Each set of gains is tried with every run of the study: it has to be good for all payloads and seeds. What was tried
stands in the journal, so that a search that was killed comes to the same place again without running it twice.
"""

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Any

from canarm_protocol.cell.cell_messages import meant, nearest
from canarm_protocol.cell.settings import setting_keys
from canarm_protocol.shown import printable

from ..libraries import load_library
from ..open_cell import open_cell
from ..usage import UsageError
from .journal import Journal
from .objective import Objective
from .one_run import Row, Task
from .plan import SET, Settings, Study, text_of
from .running import OnProgress, Runner

PER_GAIN = 4
"""Sets of gains in a generation, for each gain that is looked for."""
LEAST_GENERATION = 8
NEAREST = 4
TOLERANCE = 1e-3
"""The search is over where the sets of a generation agree to that share."""


@dataclass(frozen=True, slots=True)
class Gain:
    """A key of `--set`, and between which values it is looked for, evenly in its logarithm."""

    key: str
    usual: float
    low: float
    high: float

    def at(self, logarithm: float) -> float:
        """The value, to as many digits as a cell line shows."""
        return float(f"{math.exp(logarithm):.4g}")

    def __str__(self) -> str:
        return f"{self.key} {self.low:.9g} to {self.high:.9g}"


@dataclass(frozen=True, slots=True)
class Tuned:
    """The best gains that were found; `before` and `after` are the objective with the usual ones and with these."""

    gains: dict[str, float]
    usual: dict[str, float]
    before: float
    after: float
    evaluations: int

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        return {"before": self.before, "after": self.after, "evaluations": self.evaluations, "gains": self.gains}


def gains_of(study: Study, patterns: Sequence[str], objective: Objective) -> tuple[Gain, ...]:
    """The gains that fit one of `patterns`. Raises `UsageError` for one that fits none, or that the study varies."""
    cell = open_cell(study.base.cell, dict(study.base.settings))
    known = {key: value for key, value in setting_keys(cell).items() if key.startswith("control.")}
    numbers = {
        key: float(value)
        for key, value in known.items()
        if isinstance(value, int | float) and not isinstance(value, bool) and value > 0.0
    }
    found: dict[str, Gain] = {}
    for pattern in patterns:
        keys = [key for key in numbers if fnmatchcase(key, pattern) and (key == pattern or not _of_a_joint(key, cell))]
        if not keys:
            hint = _hint(pattern, [key for key in numbers if not _of_a_joint(key, cell)])
            raise UsageError(
                f"--tune {printable(pattern)}: fits no gain above 0; see `canarm check --keys`, control.*{hint}"
            )
        found |= {key: _gain(key, numbers[key], objective) for key in keys}
    varied = [axis.name.removeprefix(SET) for axis in study.axes if axis.name.removeprefix(SET) in found]
    if varied:
        raise UsageError(f"--tune: the study itself varies {', '.join(varied)}; take it out of [vary]")
    return tuple(found.values())


def tuned(
    study: Study,
    objective: Objective,
    gains: Sequence[Gain],
    journal: Journal,
    runner: Runner,
    on_progress: OnProgress,
) -> Tuned | None:
    """The best gains; None if it was interrupted. Raises `MissingLibraryError` without scipy."""
    optimize = load_library("scipy.optimize", "--tune")
    search = _Search(study, objective, gains, journal, runner, on_progress)
    size = max(LEAST_GENERATION, PER_GAIN * len(gains))
    size = min(size, objective.evaluations)
    with contextlib.suppress(KeyboardInterrupt):
        optimize.differential_evolution(
            _unused,
            [(math.log(gain.low), math.log(gain.high)) for gain in gains],
            init=_first_generation(gains, size, objective.seed),
            maxiter=max(objective.evaluations // size - 1, 0),
            tol=TOLERANCE,
            rng=objective.seed,
            polish=False,
            updating="deferred",
            workers=search.generation,
        )
        return search.best()
    return None


def lines_of(found: Tuned, objective: Objective) -> Iterator[str]:
    """What to print: the objective before and after, and the lines for a cell file."""
    yield f"objective: {objective}"
    yield f"{found.before:.4g} with the cell's own gains, {found.after:.4g} with these, best of {found.evaluations}:"
    table = None
    for key, value in sorted(found.gains.items(), key=lambda pair: pair[0].rpartition(".")):
        section, _, name = key.rpartition(".")
        if section != table:
            table = section
            yield f"[{section}]"
        yield f"{name} = {value:.4g}  # was {found.usual[key]:.4g}"


class _Search:
    """Carries out generations of gains, a run of the study after the other, and remembers the best."""

    def __init__(
        self,
        study: Study,
        objective: Objective,
        gains: Sequence[Gain],
        journal: Journal,
        runner: Runner,
        on_progress: OnProgress,
    ) -> None:
        self._study, self._objective, self._gains = study, objective, gains
        self._journal, self._runner, self._on_progress = journal, runner, on_progress
        self._rows = {row["run"]: row for row in journal.rows()}
        self._tried: list[tuple[float, dict[str, float]]] = []

    def generation(self, unused: Callable[..., float], points: Iterable[Sequence[float]]) -> list[float]:
        """The objective of each point, logarithms of the gains; their runs are carried out together."""
        sets = [{gain.key: gain.at(x) for gain, x in zip(self._gains, point, strict=True)} for point in points]
        first, size = len(self._tried), len(self._study)
        tasks = [task for place, gains in enumerate(sets, start=first) for task in self._tasks(place, gains)]
        left = [task for task in tasks if task.number not in self._rows]
        with contextlib.closing(self._runner(left)) as coming:
            for _, row in coming:
                self._journal.add(row)
                self._rows[row["run"]] = row
                done = sum(1 for _ in self._rows)
                self._on_progress(min(done, self._total), self._total)
        for place, gains in enumerate(sets, start=first):
            rows: list[Row] = [self._rows[place * size + number] for number in range(size)]
            self._tried.append((self._objective.of(rows), gains))
        return [value for value, _ in self._tried[first:]]

    def best(self) -> Tuned:
        """The best set so far; the first one tried is the cell's own."""
        before, usual = self._tried[0]
        after, gains = min(self._tried, key=lambda each: each[0])
        return Tuned(gains, usual, before, after, len(self._tried))

    @property
    def _total(self) -> int:
        return max(self._objective.evaluations, len(self._tried)) * len(self._study)

    def _tasks(self, place: int, gains: dict[str, float]) -> Iterator[Task]:
        size = len(self._study)
        for number in range(size):
            whole = self._study.settings(number)
            pairs = dict(whole.settings) | {key: text_of(value) for key, value in gains.items()}
            changed = {name: getattr(whole, name) for name in whole.__dataclass_fields__}
            settings = Settings(**(changed | {"settings": tuple(pairs.items())}))
            varied = {**self._study[number], **{SET + key: value for key, value in gains.items()}}
            yield Task(place * size + number, settings, tuple(varied.items()))


def _hint(pattern: str, keys: Sequence[str]) -> str:
    """What was probably meant, or the few keys that look most like it."""
    near = get_close_matches(pattern, keys, n=NEAREST, cutoff=0.0)
    return nearest(pattern, keys) if meant(pattern, keys) else f"; the nearest are {', '.join(near)}"


def _gain(key: str, usual: float, objective: Objective) -> Gain:
    return Gain(key, usual, usual / objective.within, usual * objective.within)


def _of_a_joint(key: str, cell: Any) -> bool:
    """Whether it is a joint's own key, which a pattern does not mean unless it names it."""
    return key.split(".")[1] in cell.joint_names


def _first_generation(gains: Sequence[Gain], size: int, seed: int) -> Any:
    """The cell's own gains, then a Latin hypercube over the ranges; logarithms, (size, gains)."""
    qmc = load_library("scipy.stats", "--tune").qmc
    shares = qmc.LatinHypercube(d=len(gains), rng=seed).random(size)
    low, high = ([math.log(getattr(gain, end)) for gain in gains] for end in ("low", "high"))
    points = qmc.scale(shares, low, high)
    points[0] = [math.log(gain.usual) for gain in gains]
    return points


def _unused(point: Sequence[float]) -> float:
    """Generations are evaluated whole; scipy wants a function all the same."""
    raise AssertionError(point)
