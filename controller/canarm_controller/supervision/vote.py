"""Decides whether the arm follows a doubtful torque, by regressing its speed on the speed that it would cause.

Owns the arithmetic only; the torque and the reaction are decided elsewhere.
"""

from collections.abc import Sequence

DECISIVE = 12.0
"""Sum of squares in grains of speed: with 0.42 grains of noise the share is then known to 0.15."""
FOR_SHARE = 0.5


class Ballot:
    """Collects speeds, rad/s: those due if the torque acts, and those not explained without it.

    In every window the best straight line is subtracted from both: it looks like another payload.
    """

    __slots__ = ("_due", "_due2", "_limit", "_product", "_unexplained", "_window")

    def __init__(self, speed_grain: float, window_cycles: int) -> None:
        self._limit, self._window = DECISIVE * speed_grain**2, window_cycles
        self.clear()

    def clear(self) -> None:
        """Start over."""
        self._due: list[float] = []
        self._unexplained: list[float] = []
        self._due2 = self._product = 0.0

    def open_window(self) -> None:
        """Begin a new window; the results of earlier ones are kept."""
        self._due, self._unexplained = [], []

    def cast(self, due: float, unexplained: float) -> bool:
        """Take one cycle. True once it is decided."""
        self._due.append(due)
        self._unexplained.append(unexplained)
        if len(self._due) < self._window:
            return False
        due_part, unexplained_part = _without_line(self._due), _without_line(self._unexplained)
        self.open_window()
        self._due2 += sum(value * value for value in due_part)
        self._product += sum(one * other for one, other in zip(due_part, unexplained_part, strict=True))
        return self._due2 > self._limit

    @property
    def is_for(self) -> bool:
        """Whether the arm followed the torque."""
        return self._product > FOR_SHARE * self._due2


def _without_line(values: Sequence[float]) -> list[float]:
    """`values` less their best straight line, by least squares."""
    count = len(values)
    middle, mean = 0.5 * (count - 1), sum(values) / count
    slope = sum((place - middle) * value for place, value in enumerate(values)) * 12.0 / (count * (count * count - 1))
    return [value - mean - slope * (place - middle) for place, value in enumerate(values)]
