"""Decides when wrong single readings, and speeds that stray to both sides, count as noise.

Owns the counting; rejecting and reporting are elsewhere.
"""

SPIKES, TURNS = 3, 3
"""Rejected readings, and reversals of a doubtful speed, each soon after the last, that count as noise."""


class SpikeCount:
    """Recently rejected readings."""

    __slots__ = ("_count", "_soon", "_until")

    def __init__(self, soon_cycles: int) -> None:
        self._count, self._until, self._soon = 0, -1, soon_cycles

    def is_too_many(self, cycle: int) -> bool:
        """Count a rejected reading."""
        if cycle > self._until:
            self._count = 0
        self._count += 1
        self._until = cycle + self._soon
        return self._count >= SPIKES


class TurnCount:
    """Reversals of a doubtful speed: neither an arm nor another kind of fault does that.


    A motor swings on an elastic wire: a turn counts if it takes no longer than `quick_cycles`, as no wire's does.
    """

    __slots__ = ("_at", "_off", "_quick", "_soon", "_turns")

    def __init__(self, soon_cycles: int, quick_cycles: int) -> None:
        self._at, self._off, self._turns, self._soon = -soon_cycles, 0.0, 0, soon_cycles
        self._quick = quick_cycles

    def is_too_many(self, cycle: int, off_rad_s: float) -> bool:
        """Take a speed error beyond the limit of doubt."""
        if cycle > self._at + self._soon:
            self._turns = 0
        elif off_rad_s * self._off < 0.0 and cycle <= self._at + self._quick:
            self._turns += 1
        self._at, self._off = cycle, off_rad_s
        return self._turns >= TURNS
