"""A share that was counted, and what it says of the probability behind it. Knows nothing of what is counted."""

from dataclasses import dataclass

from ..draws import CONFIDENCE, clopper_pearson


@dataclass(frozen=True, slots=True)
class Share:
    """`hits` of `count`. The bounds are exact for draws that know nothing of each other."""

    hits: int
    count: int

    @property
    def value(self) -> float:
        """From 0 to 1; of nothing all is as it should be."""
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
        """The bounds in words."""
        return f"{CONFIDENCE:.0%} bounds {self.low:.1%} to {self.high:.1%}"

    def __str__(self) -> str:
        return f"{self.hits} of {self.count}, {self.value:.1%} ({self.bounds})"
