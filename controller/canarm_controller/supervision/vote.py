"""Decides whether the arm follows a doubtful torque, by regressing its speed on the speed that it would cause.

Owns the arithmetic only; the torque and the reaction are decided elsewhere.
"""

DECISIVE = 9.0
"""Logarithm of the likelihood ratio of "it acts" to "it does not": the wrong one is believed once in 8000 votes."""
ACTS_SHARE, MOST_SHARE = 0.5, 3.0
"""Share of the due speed above which the torque acts, and above which something else does: on an elastic wire a motor
answers alone, and twice as much."""
READING = 0.42
"""Deviation of one reading of the speed, in grains."""


class Ballot:
    """Collects speeds, rad/s: those due if the torque acts, and those not explained without it.

    In every window the best straight line is subtracted from both: it looks like another payload. In the first one its
    mean alone tells as well, as far as the model's acceleration may be trusted: the first reading is as noisy as all
    others.
    """

    __slots__ = (
        "_count", "_due", "_due2", "_due_time", "_is_first", "_per_rad2", "_product", "_time", "_time2", "_total2",
        "_total_product", "_unexplained", "_unexplained_time", "_window",
    )  # fmt: skip

    def __init__(self, speed_grain: float, window_cycles: int) -> None:
        self._per_rad2, self._window = 1.0 / (READING * speed_grain) ** 2, window_cycles
        self.clear()

    def clear(self) -> None:
        """Start over."""
        self._total2 = self._total_product = 0.0
        self.open_window()

    def open_window(self, is_first: bool = True) -> None:
        """Begin a new window; the results of earlier ones are kept."""
        self._is_first = is_first
        self._count = 0
        self._due = self._unexplained = self._time = 0.0
        self._due2 = self._product = self._time2 = self._due_time = self._unexplained_time = 0.0

    def cast(self, due: float, unexplained: float, elapsed_s: float) -> None:
        """Take one cycle, `elapsed_s` after the first window began."""
        if self._count == self._window:
            due2, product = self._without_line(*self._about_mean())
            self._total2 += due2
            self._total_product += product
            self.open_window(is_first=False)
        self._count += 1
        self._due += due
        self._unexplained += unexplained
        self._time += elapsed_s
        self._due2 += due * due
        self._product += due * unexplained
        self._time2 += elapsed_s * elapsed_s
        self._due_time += due * elapsed_s
        self._unexplained_time += unexplained * elapsed_s

    def verdict(self, doubt_rad_s2: float, noisiness: float) -> int:
        """1 if the torque acts, -1 if it does not, 0 while that is open.

        `doubt_rad_s2` is what the arm's acceleration may be unexpected by for other reasons, and `noisiness` by what
        factor its speed is noisier than nominal; infinite if it is not known.
        """
        if self._count < 2:
            return 0
        due2, product, time = self._about_mean()
        line2, line_product = self._without_line(due2, product, time)
        needed = DECISIVE * noisiness * noisiness / self._per_rad2
        if verdict := _verdict(self._total2 + line2, self._total_product + line_product, 0.0, needed):
            return verdict
        return _verdict(due2, product, doubt_rad_s2 * abs(time), needed) if self._is_first else 0

    def _about_mean(self) -> tuple[float, float, float]:
        """Due speed squared, times unexplained speed, and times time, of this window less their means."""
        share = 1.0 / self._count
        return (
            self._due2 - share * self._due * self._due,
            self._product - share * self._due * self._unexplained,
            self._due_time - share * self._due * self._time,
        )

    def _without_line(self, due2: float, product: float, time: float) -> tuple[float, float]:
        """What is left of the first two without their straight line over time."""
        share = 1.0 / self._count
        slope = time / (self._time2 - share * self._time * self._time)
        return due2 - slope * time, product - slope * (self._unexplained_time - share * self._unexplained * self._time)


def _verdict(due2: float, product: float, doubt: float, needed: float) -> int:
    """As `Ballot.verdict`; `doubt` is what the product may be off by."""
    leans = product - ACTS_SHARE * due2
    if leans > needed + doubt:
        return 1 if product < MOST_SHARE * due2 + doubt else 0
    return -1 if leans < -needed - doubt else 0
