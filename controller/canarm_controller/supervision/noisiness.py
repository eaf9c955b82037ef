"""Single readings that are wrong, and speeds that stray to one side and the other: when is it noise?

Owns the counting. What is rejected, and what is reported, is decided elsewhere.
"""

SPIKES, SPIKE_CYCLES = 3, 80
TURNS, TURN_CYCLES = 3, 40
"""A doubtful speed that turns to the other side so often, each time within 0.1 s."""


class SpikeCount:
    """Readings rejected lately."""

    __slots__ = ("_count", "_until")

    def __init__(self) -> None:
        self._count, self._until = 0, -1

    def is_too_many(self, cycle: int) -> bool:
        """Count one."""
        if cycle > self._until:
            self._count = 0
        self._count += 1
        self._until = cycle + SPIKE_CYCLES
        return self._count >= SPIKES


class TurnCount:
    """How often a doubtful speed has turned: an arm cannot, and a fault of another kind does not."""

    __slots__ = ("_at", "_off", "_turns")

    def __init__(self) -> None:
        self._at, self._off, self._turns = -TURN_CYCLES, 0.0, 0

    def is_too_many(self, cycle: int, off_rad_s: float) -> bool:
        """Take a speed that is off by more than is in doubt."""
        if cycle > self._at + TURN_CYCLES:
            self._turns = 0
        elif off_rad_s * self._off < 0.0:
            self._turns += 1
        self._at, self._off = cycle, off_rad_s
        return self._turns >= TURNS
