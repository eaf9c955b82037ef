"""A counted share, and the confidence bounds of its probability. What is counted is not known here."""

from dataclasses import dataclass

from ..draws import CONFIDENCE, clopper_pearson


@dataclass(frozen=True, slots=True)
class Share:
    """`hits` of `count`. The bounds are exact for independent draws."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """The share, 0 to 1; 1 of nothing."""
        return self.hits / self.count if self.count else 1.0

    @property
    def low(self) -> float:
        """The lower bound of the probability."""
        return clopper_pearson(self.hits, self.count)[0] if self.count else 0.0

    @property
    def high(self) -> float:
        """The upper bound of the probability."""
        return clopper_pearson(self.hits, self.count)[1] if self.count else 1.0

    @property
    def bounds(self) -> str:
        """The bounds as text."""
        return f"{CONFIDENCE:.0%} bounds {self.low:.1%} to {self.high:.1%}"

    def __str__(self) -> str:
        return f"{self.hits} of {self.count}, {self.value:.1%} ({self.bounds})"
