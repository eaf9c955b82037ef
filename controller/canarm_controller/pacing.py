"""Deadlines on the wall clock, and how well they were kept."""

import time
from collections.abc import Callable

BIN_NS = 10_000
BINS = 1000
LATE_FRACTION = 10
"""A SYNC that leaves more than a tenth of the period after its time is late."""


class Lateness:
    """A histogram of delays in bins of 10 µs up to 10 ms, and the greatest one; its memory does not grow."""

    def __init__(self) -> None:
        self.counts = [0] * (BINS + 1)
        self.max_ns = 0
        self.total = 0

    def add(self, delay_ns: int) -> None:
        """Count one delay."""
        self.counts[min(delay_ns // BIN_NS, BINS)] += 1
        self.total += 1
        self.max_ns = max(self.max_ns, delay_ns)

    def percentile_us(self, percent: float) -> float:
        """The delay that `percent` % of all do not exceed, in µs, to the upper edge of its bin."""
        wanted, seen = self.total * percent / 100.0, 0
        for position, count in enumerate(self.counts):
            seen += count
            if seen >= wanted and seen:
                return min((position + 1) * BIN_NS, self.max_ns) / 1000.0
        return 0.0

    def summary(self) -> dict[str, float]:
        """Median, 99th percentile and maximum in µs."""
        return {
            "median_us": self.percentile_us(50.0),
            "p99_us": self.percentile_us(99.0),
            "max_us": self.max_ns / 1000.0,
        }


class Pacer:
    """Absolute deadlines one period apart. A stall of more than a period leaves out the deadlines that it missed."""

    def __init__(self, period_ns: int, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._period_ns, self._clock = period_ns, clock
        self.next_ns = clock()
        self.lateness = Lateness()
        self.late = 0
        self.missed = 0

    def left_s(self) -> float:
        """Seconds to the next deadline; not positive when it has come."""
        return (self.next_ns - self._clock()) * 1e-9

    def begin(self) -> None:
        """The deadline has come: count how late it is kept, set the next one."""
        now_ns = self._clock()
        delay_ns = max(now_ns - self.next_ns, 0)
        self.lateness.add(delay_ns)
        if delay_ns * LATE_FRACTION > self._period_ns:
            self.late += 1
        skipped = delay_ns // self._period_ns
        self.missed += skipped
        self.next_ns += self._period_ns * (1 + skipped)
