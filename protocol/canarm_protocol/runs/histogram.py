"""A histogram of durations: memory and time per count do not depend on how many there are.

Both sides of the bus use it, so that their figures can be compared. It reads no clock.
"""

from typing import Any

LINEAR_US = 64
"""Bins are 1 µs wide up to here; above, every octave has half as many bins, so that each is at most 1/32 of its
value."""
_HALF = LINEAR_US // 2
_LINEAR_BITS = LINEAR_US.bit_length() - 1
_OCTAVES = 30
_BINS = LINEAR_US + _OCTAVES * _HALF
"""Bins up to 2^36 µs, 19 hours; longer durations count in the last one."""
_LAST = _BINS - 1


class Histogram:
    """Durations of 0 ns and more; negative ones count as 0."""

    __slots__ = ("_counts", "count", "max_ns")

    def __init__(self) -> None:
        self._counts = [0] * _BINS
        self.count = 0
        self.max_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration."""
        if duration_ns > self.max_ns:
            self.max_ns = duration_ns
        self.count += 1
        duration_us = duration_ns // 1000
        if duration_us < LINEAR_US:
            self._counts[duration_us if duration_us > 0 else 0] += 1
        else:
            octave = duration_us.bit_length() - _LINEAR_BITS
            place = octave * _HALF + (duration_us >> octave)
            self._counts[place if place < _LAST else _LAST] += 1

    def percentile_us(self, percent: float) -> float:
        """The duration that `percent` % of all do not exceed, as the upper edge of its bin in µs; 0 if empty."""
        wanted, seen = self.count * percent / 100.0, 0
        for place, count in enumerate(self._counts):
            seen += count
            if seen and seen >= wanted:
                return self.max_ns / 1000.0 if place == _LAST else min(float(_edge_us(place + 1)), self.max_ns / 1000.0)
        return 0.0

    def summary(self) -> dict[str, Any]:
        """Count, median, 99th and 99.9th percentile and maximum in µs, and columns of the bins that are not empty."""
        filled = [place for place, count in enumerate(self._counts) if count]
        return {
            "count": self.count,
            "median_us": self.percentile_us(50.0),
            "p99_us": self.percentile_us(99.0),
            "p99_9_us": self.percentile_us(99.9),
            "max_us": self.max_ns / 1000.0,
            "histogram": {
                "from_us": [_edge_us(place) for place in filled],
                "count": [self._counts[place] for place in filled],
            },
        }


def _edge_us(place: int) -> int:
    """Lower edge of a bin."""
    if place < LINEAR_US:
        return place
    octave = place // _HALF - 1
    return (place - octave * _HALF) << octave
