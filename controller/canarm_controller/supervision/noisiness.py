"""Single readings that are wrong, and speeds that stray to one side and the other: when is it noise?

Owns the counting. What is rejected, and what is reported, is decided elsewhere.
"""

SPIKES, TURNS = 3, 3
"""Readings rejected, each soon after the last; turns of a doubtful speed to the other side, likewise."""


class SpikeCount:
    """Readings rejected lately."""

    __slots__ = ("_count", "_soon", "_until")

    def __init__(self, soon_cycles: int) -> None:
        self._count, self._until, self._soon = 0, -1, soon_cycles

    def is_too_many(self, cycle: int) -> bool:
        """Count one."""
        if cycle > self._until:
            self._count = 0
        self._count += 1
        self._until = cycle + self._soon
        return self._count >= SPIKES


class TurnCount:
    """How often a doubtful speed has turned: an arm cannot, and a fault of another kind does not."""

    __slots__ = ("_at", "_off", "_soon", "_turns")

    def __init__(self, soon_cycles: int) -> None:
        self._at, self._off, self._turns, self._soon = -soon_cycles, 0.0, 0, soon_cycles

    def is_too_many(self, cycle: int, off_rad_s: float) -> bool:
        """Take a speed that is off by more than is in doubt."""
        if cycle > self._at + self._soon:
            self._turns = 0
        elif off_rad_s * self._off < 0.0:
            self._turns += 1
        self._at, self._off = cycle, off_rad_s
        return self._turns >= TURNS
