"""The figures of several runs side by side, with ratios to the first; and which of them are too large."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from canarm_protocol.shown import printable, quoted

from ...usage import UsageError
from ..run import Run
from .story import joint_figures

MOST_CYCLES = 10**12
"""No run is longer; a hostile number may have thousands of digits."""
WHOLE_RUN = ("ticks", "missed", "late", "real_time_factor", "faults")


@dataclass(frozen=True)
class Figure:
    """One figure, such as `joint2.rms_lsb`, of every run; None where a run has none."""

    key: str
    values: tuple[float | None, ...]

    def ratio(self, place: int) -> float | None:
        """Of the run at `place` to the first. Something to nothing is infinite."""
        first, value = self.values[0], self.values[place]
        if first is None or value is None:
            return None
        if first == 0.0:
            return 1.0 if value == 0.0 else float("inf")
        return value / first


def unlike(runs: Sequence[Run], names: Sequence[str]) -> str | None:
    """A sentence that says in what the runs differ so that ratios of their figures compare unlike things; or None."""
    found = []
    for what, values in (
        ("cells", [run.summary.get("cell") for run in runs]),
        ("motions", [run.summary.get("trajectory") or run.made_by.get("trajectory") for run in runs]),
        ("lengths", [_length(run) for run in runs]),
    ):
        known = [printable(str(value), 60) for value in values]
        if len(set(known)) > 1 and None not in values:
            each = (f"{value} of {printable(name, 60)}" for value, name in zip(known, names, strict=True))
            found.append(f"{what} ({', '.join(each)})")
    return f"These runs differ in their {' and '.join(found)}: ratios compare what is not alike." if found else None


def _length(run: Run) -> str | None:
    cycles = run.summary.get("ticks")
    return f"{cycles} cycles" if isinstance(cycles, int) and 0 <= cycles <= MOST_CYCLES else None


def figures_of(runs: Sequence[Run]) -> list[Figure]:
    """All figures that any of the runs has."""
    found = [_figures(run) for run in runs]
    keys = dict.fromkeys(key for each in found for key in each)
    return [Figure(key, tuple(each.get(key) for each in found)) for key in keys]


def parse_limits(words: Sequence[str]) -> dict[str, float]:
    """`KEY=RATIO` words as limits by key. Raises `UsageError`."""
    limits = {}
    for word in words:
        key, equals, text = word.partition("=")
        try:
            ratio = float(text)
        except ValueError:
            ratio = -1.0
        if not equals or not key or not 0.0 < ratio < math.inf:
            raise UsageError(f"--fail-above {quoted(word)}: write KEY=RATIO, such as rms_lsb=1.1")
        limits[key] = ratio
    return limits


def above(figures: Sequence[Figure], limits: Mapping[str, float]) -> list[tuple[Figure, int, float]]:
    """Figures beyond their limit: which, of which run, and the limit. A key without a joint is that of every joint.

    A figure that the first run has and another has not is beyond any limit. Raises `UsageError` for a key that no run
    has.
    """
    found = []
    for key, limit in limits.items():
        meant = [each for each in figures if key in (each.key, each.key.partition(".")[2])]
        if not meant:
            known = ", ".join(each.key for each in figures) or "none"
            raise UsageError(f"--fail-above {quoted(key)}: the runs have no such figure; there are {known}")
        for each in meant:
            for place in range(1, len(each.values)):
                ratio = each.ratio(place)
                is_lost = each.values[0] is not None and each.values[place] is None
                if is_lost or (ratio is not None and not ratio <= limit):
                    found.append((each, place, limit))
    return found


def _figures(run: Run) -> dict[str, float]:
    said = run.summary
    found = {f"{joint}.{key}": value for joint, figures in joint_figures(run).items() for key, value in figures.items()}
    for key in WHOLE_RUN:
        value = said.get(key)
        if isinstance(value, int | float) and abs(value) < 1e15:
            found[key] = float(value)
    return found
