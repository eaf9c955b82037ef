"""How fast a joint is by its angle's readings, where there is no tachometer; and what the model did not foresee.

Owns the arithmetic of two windows; which speed is believed, and what is judged by it, is elsewhere.
"""

import math

SHORTEST_CYCLES, LONGEST_S = 4, 0.1
"""Bounds of a window."""
TOLD_SIGMAS = 3.5
"""Two readings of a counter are off by up to a step together: 3.5 deviations of its rounding."""
KEPT_S = 0.15
"""How fast what was not foreseen fades: a wire swings at 10 Hz or faster, and shows its most twice in that time."""


class ReadSpeed:
    """Speed of one joint over a window of readings, brought up to now by what the model changed it by meanwhile.

    v = (x - x₀)/τ + m - m̄ + ½·b·τ, with the model's speed m, its mean m̄ in the window, and the bias b. Errors ε of
    the readings and δ of the acceleration make it wrong by ε/τ + ½·δ·τ at most, least for τ = √(2·ε/δ). Windows
    overlap, so that the one in use is between one and two of these long.
    """

    __slots__ = (
        "_age", "_base", "_doubt_rad_s", "_gone", "_is_told", "_kept", "_last", "_old_base", "_old_gone", "_old_x",
        "_period_s", "_reading", "_speed", "_told_rad", "_turned_base", "_turned_rad_s", "_window", "_x",
        "unforeseen_rad_s2",
    )  # fmt: skip

    def __init__(self, noise_rad: float, doubt_rad_s2: float, period_s: float) -> None:
        """`doubt_rad_s2` is what the acceleration is usually off by where it matters."""
        self._told_rad, self._period_s = TOLD_SIGMAS * noise_rad, period_s
        best_s = min(math.sqrt(2.0 * self._told_rad / max(doubt_rad_s2, 1e-9)), LONGEST_S)
        self._window = max(round(best_s / period_s), SHORTEST_CYCLES)
        self._kept = math.exp(-self._window * period_s / KEPT_S)
        self.start(0.0, 0.0)

    def start(self, position_rad: float, model_rad_s: float) -> None:
        """Begin at a reading; nothing is known of the speed yet."""
        self._x = self._old_x = position_rad
        self._last = self._base = self._old_base = self._turned_base = model_rad_s
        self._gone = self._old_gone = 0.0
        self._age = 0
        self._turned_rad_s: float | None = None
        self._speed, self._doubt_rad_s, self.unforeseen_rad_s2 = 0.0, math.inf, 0.0
        self._reading, self._is_told = (position_rad, model_rad_s, 0.0, 0.0), True

    @property
    def speed(self) -> float:
        """As of the last reading; 0 while nothing is known. Worked out when it is asked for, as few cycles do."""
        if not self._is_told:
            self._tell()
        return self._speed

    @property
    def doubt_rad_s(self) -> float:
        """How wrong the speed may be; infinite while nothing is known."""
        if not self._is_told:
            self._tell()
        return self._doubt_rad_s

    def take(self, position_rad: float, model_rad_s: float, bias_rad_s2: float, doubt_rad_s2: float) -> None:
        """A reading, the model's speed from any zero, what it is known to lack, and how wrong that may be."""
        period_s = self._period_s
        travel = 0.5 * period_s * (self._last + model_rad_s)
        self._last = model_rad_s
        self._gone += travel - period_s * self._base
        self._old_gone += travel - period_s * self._old_base
        age = self._age = self._age + 1
        self._reading, self._is_told = (position_rad, model_rad_s, bias_rad_s2, doubt_rad_s2), False
        if age >= self._window:
            self._tell()
            self._turn(position_rad, model_rad_s, bias_rad_s2)

    def _tell(self) -> None:
        self._is_told = True
        if self._turned_rad_s is None:
            return
        position_rad, model_rad_s, bias_rad_s2, doubt_rad_s2 = self._reading
        elapsed_s = (self._window + self._age) * self._period_s
        by_model = model_rad_s - self._old_base + 0.5 * bias_rad_s2 * elapsed_s
        self._speed = (position_rad - self._old_x - self._old_gone) / elapsed_s + by_model
        doubt_rad_s2 = max(doubt_rad_s2, self.unforeseen_rad_s2)
        self._doubt_rad_s = self._told_rad / elapsed_s + 0.5 * doubt_rad_s2 * elapsed_s

    def _turn(self, position_rad: float, model_rad_s: float, bias_rad_s2: float) -> None:
        """A window is full: the next one begins."""
        elapsed_s = self._window * self._period_s
        by_model = model_rad_s - self._base + 0.5 * bias_rad_s2 * elapsed_s
        speed = (position_rad - self._x - self._gone) / elapsed_s + by_model
        if self._turned_rad_s is not None:
            foreseen = self._turned_rad_s + model_rad_s - self._turned_base + bias_rad_s2 * elapsed_s
            unforeseen = abs(speed - foreseen) / elapsed_s
            self.unforeseen_rad_s2 = max(unforeseen, self._kept * self.unforeseen_rad_s2)
        self._turned_rad_s, self._turned_base = speed, model_rad_s
        self._old_x, self._old_base, self._old_gone = self._x, self._base, self._gone
        self._x, self._base, self._gone, self._age = position_rad, model_rad_s, 0.0, 0
