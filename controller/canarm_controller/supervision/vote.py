"""Decides whether the arm follows a doubtful torque, by regressing its speed on the speed that it would cause.

Owns the arithmetic only; the torque and the reaction are decided elsewhere.
"""

import math

DECISIVE = 9.0
"""Logarithm of the likelihood ratio of "it acts" to "it does not": the wrong one is believed once in 8000 votes."""
ACTS_SHARE, MOST_SHARE = 0.5, 3.0
"""Share of the due speed above which the torque acts, and above which something else does: on an elastic wire a motor
answers alone, and twice as much."""
LARGEST_SHARE = 2.0
"""Share of the due speed that a torque makes at most: while all is well, only every other cycle is read."""
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
        "_total_product", "_unexplained", "_unexplained2", "_unexplained_time", "_window",
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
        self._due2 = self._product = self._time2 = self._due_time = self._unexplained_time = self._unexplained2 = 0.0

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
        self._unexplained2 += unexplained * unexplained
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

    def lean(self, doubt_rad_s2: float, noisiness: float) -> float:
        """Logarithm of how much likelier the speeds so far are if the torque acts; arguments as of `verdict`.

        Then any share up to `LARGEST_SHARE` of the due speed is equally likely, for a peak may have been shorter than
        its reading tells, or longer; or the arm swings by the due speed, when and which way nobody knows. The doubtful
        acceleration is equally likely anywhere up to `doubt_rad_s2`.
        """
        if self._count < 2:
            return 0.0
        due2, product, time = self._about_mean()
        share = 1.0 / self._count
        time2 = self._time2 - share * self._time * self._time
        drift = self._unexplained_time - share * self._unexplained * self._time
        noise2 = noisiness * noisiness / self._per_rad2
        granted = 1.0
        if self._is_first:
            doubt2 = doubt_rad_s2 * doubt_rad_s2 / 3.0 * time2
            granted = doubt2 / (noise2 + doubt2)
        slope = granted * time / time2
        due2 += self._total2 - slope * time
        product += self._total_product - slope * drift
        acts = _log_evidence(due2 / noise2, product / noise2)
        unexplained2 = self._unexplained2 - share * self._unexplained * self._unexplained
        swings = share * self._due2 / noise2
        found = (unexplained2 - granted * drift * drift / time2) / noise2
        swings = 0.5 * (found * swings / (1.0 + swings) - (self._count - 1) * math.log1p(swings))
        return max(acts, swings) + math.log(0.5 * (1.0 + math.exp(-abs(acts - swings))))

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


def _log_evidence(due2: float, product: float) -> float:
    """Logarithm of the mean of exp(share * product - share² * due2 / 2) over the shares up to the largest."""
    if due2 <= 0.0:
        return 0.0
    root = math.sqrt(0.5 * due2)
    middle = product / due2
    width = math.erf((LARGEST_SHARE - middle) * root) + math.erf(middle * root)
    if width <= 0.0:
        return -math.inf if product < 0.0 else math.inf
    return 0.5 * product * middle + math.log(0.5 * math.sqrt(math.pi) / root / LARGEST_SHARE * width)
