"""What tuning makes small: one figure of every run, and how the figures of many runs become one number."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.shown import printable, quoted

from ..usage import UsageError
from .one_run import DONE

OVER = ("mean", "worst")
KEYS = ("minimise", "over", "evaluations", "within", "seed")
OF_ERRORS = ("rms_lsb", "max_lsb", "speed_ripple")
"""Figures that count only after the first cycles of a run."""
LOST = 1e3
"""What a run counts that has no figure, as one that was stopped: more than any run that has one."""


@dataclass(frozen=True, slots=True)
class Objective:
    """`minimise` is a figure, such as `rms_lsb` (of the worst joint) or `joint2.rms_lsb`, `over` all runs of the study.

    Gains are looked for `within` a factor of theirs, either way; `evaluations` is how many sets of gains are tried.
    """

    minimise: str = "rms_lsb"
    over: str = "mean"
    evaluations: int = 60
    within: float = 4.0
    seed: int = 0

    def of(self, rows: Sequence[Mapping[str, Any]]) -> float:
        """The number of a set of gains, from the rows of all runs with it. A run that was stopped counts `LOST`."""
        values = [self._of_run(row) for row in rows]
        return max(values) if self.over == "worst" else math.fsum(values) / len(values)

    def _of_run(self, row: Mapping[str, Any]) -> float:
        key = self.minimise if "." in self.minimise else f"worst.{self.minimise}"
        value = row.get(key)
        is_whole = row.get("state") == DONE and isinstance(value, int | float) and math.isfinite(value)
        return min(float(value), LOST) if is_whole and value is not None else LOST

    @property
    def is_of_errors(self) -> bool:
        """Whether a run must be long enough for errors to count to have what is made small."""
        return self.minimise.rpartition(".")[2] in OF_ERRORS

    def __str__(self) -> str:
        joint = "" if "." in self.minimise else " of the worst joint"
        return f"{self.over} over all runs of {printable(self.minimise)}{joint}; a run that is stopped counts {LOST:g}"


def parse_objective(table: Mapping[str, Any]) -> Objective:
    """The table [tune] of a study file. Raises `UsageError`."""
    usual = Objective()
    for name in table:
        if name not in KEYS:
            raise UsageError(f"tune.{name}: unknown key{nearest(name, list(KEYS))}")
    minimise, over = table.get("minimise", usual.minimise), table.get("over", usual.over)
    if not isinstance(minimise, str) or not minimise:
        raise UsageError(f"tune.minimise = {quoted(minimise)}: must be the name of a figure, such as 'rms_lsb'")
    if over not in OVER:
        raise UsageError(f"tune.over = {quoted(over)}: must be {' or '.join(OVER)}")
    evaluations, seed = table.get("evaluations", usual.evaluations), table.get("seed", usual.seed)
    if not isinstance(evaluations, int) or isinstance(evaluations, bool) or not 10 <= evaluations <= 100_000:
        raise UsageError(f"tune.evaluations = {quoted(evaluations)}: must be a whole number from 10 to 100000")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise UsageError(f"tune.seed = {quoted(seed)}: must be a whole number, 0 or more")
    within = table.get("within", usual.within)
    if not isinstance(within, int | float) or isinstance(within, bool) or not 1.0 < within <= 1000.0:
        raise UsageError(f"tune.within = {quoted(within)}: must be a factor above 1, at most 1000")
    return Objective(minimise, over, evaluations, float(within), seed)
