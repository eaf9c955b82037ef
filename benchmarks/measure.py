"""Figures that are robust on a noisy machine: ratios of alternating blocks, with their spread."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Ratio:
    """Median and range of the ratio of paired blocks; `usual_low` to `usual_high` is the range without outliers.

    That leaves out the lowest and the highest eighth of the blocks: one that was disturbed would hide what has changed.
    """

    median: float
    low: float
    high: float
    blocks: int
    usual_low: float
    usual_high: float

    @classmethod
    def of(cls, ours: Sequence[float], theirs: Sequence[float]) -> "Ratio":
        """Block by block, ours over theirs."""
        ratios = sorted(a / b for a, b in zip(ours, theirs, strict=True))
        out = len(ratios) // 8
        usual = ratios[out : len(ratios) - out]
        return cls(statistics.median(ratios), ratios[0], ratios[-1], len(ratios), usual[0], usual[-1])


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: what, against what, the ratio, the target, and a remark."""

    what: str
    against: str
    ratio: Ratio
    goal: str
    remark: str

    @property
    def more_is_better(self) -> bool:
        """Whether the goal is a least value, as of a speed; else less is better."""
        return self.goal.startswith(">")

    def as_json(self) -> dict[str, Any]:
        """The row as stored."""
        return asdict(self)

    def as_text(self) -> str:
        """The row as shown."""
        ratio = self.ratio
        spread = f"{ratio.low:.3g} to {ratio.high:.3g}"
        return f"{self.what:<42}{self.against:<42}{ratio.median:>8.3g}  {spread:<16}{self.goal:<8}{self.remark}"


def yardstick_s() -> float:
    """Seconds of CPU for 1000 rounds of plain Python, the least of some: what this machine's interpreter does now."""
    best_s = float("inf")
    for _ in range(7):
        begun = time.process_time()
        for _ in range(20):
            _rounds()
        best_s = min(best_s, (time.process_time() - begun) / 20)
    return best_s


def _rounds() -> float:
    values, total = [0.5] * 8, 0.0
    for number in range(1000):
        total += values[number & 7] * 1.5
        if total > 100.0:
            values[number & 7], total = total * 0.001, 0.0
    return total
