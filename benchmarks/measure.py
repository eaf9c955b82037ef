"""Figures that are robust on a noisy machine: ratios of alternating blocks, with their spread."""

import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Ratio:
    """Median and range of the ratio of paired blocks."""

    median: float
    low: float
    high: float
    blocks: int

    @classmethod
    def of(cls, ours: Sequence[float], theirs: Sequence[float]) -> "Ratio":
        """Block by block, ours over theirs."""
        ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
        return cls(statistics.median(ratios), min(ratios), max(ratios), len(ratios))


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: what, against what, the ratio, the target, and a remark."""

    what: str
    against: str
    ratio: Ratio
    goal: str
    remark: str

    def as_json(self) -> dict[str, Any]:
        """The row as stored."""
        return asdict(self)

    def as_text(self) -> str:
        """The row as shown."""
        ratio = self.ratio
        spread = f"{ratio.low:.3g} to {ratio.high:.3g}"
        return f"{self.what:<42}{self.against:<38}{ratio.median:>8.3g}  {spread:<16}{self.goal:<8}{self.remark}"
