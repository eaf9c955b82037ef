"""Decides whether a step of the speed away from the model was the arm's, or only the tachometer's.

If the arm stepped, the angle follows. Owns the least squares of angle over step; the reaction is decided
elsewhere.
"""

import math

SMALLEST_LEAD, ARM_SHARE = 0.5, 0.65
"""A step that would have moved the angle by less than half a grain counts as the tachometer's; of others, this share
must be seen there. With 0.42 grains of noise a step of 1 rad/s of konkuk1 is judged to 0.15."""
EARLY, EARLY_SHARES = 5.0, (0.3, 0.7)
"""A large step is judged as soon as the sum of squares gives the share to 0.42/sqrt(5) = 0.19."""
FALLEN_CYCLES, FALLEN_SHARE, FALL_SIGMAS, FALL_FROM = 4, 0.5, 4.75, 30.0
"""A pin that nothing drives goes to ground by the same share in every cycle. In so many it halves at least, within so
many deviations of a reading, from so many times that: an arm that slows down steadily is then off by twice as much."""


class StepTrial:
    """One step of the speed, from its beginning to the verdict. Angles in rad, speeds in rad/s."""

    __slots__ = (
        "_codes", "_followed_rad2", "_grain_rad", "_judged", "_led_rad2", "_off_codes", "_period_s", "cycles",
        "led_rad", "step_rad_s",
    )  # fmt: skip

    def __init__(self, grain_rad: float, period_s: float, judged: int, noise_codes: float = 0.0) -> None:
        """`noise_codes` is the deviation of a reading of the speed."""
        self._grain_rad, self._period_s, self._judged = grain_rad, period_s, judged
        self._off_codes = FALL_SIGMAS * noise_codes
        self.begin(0.0, 0)

    def begin(self, step_rad_s: float, code: int) -> None:
        """The speed has stepped in this cycle."""
        self._codes = [code]
        self.cycles, self.step_rad_s = 0, step_rad_s
        self.led_rad = self._period_s * step_rad_s
        """How far the arm would have moved had it stepped."""
        self._followed_rad2 = self._led_rad2 = 0.0

    def take(self, off_rad_s: float, astray_rad: float, code: int) -> None:
        """Take one cycle: speed minus model, potentiometer minus the model's angle, and the tachometer's code."""
        self.cycles += 1
        if self.cycles <= FALLEN_CYCLES:
            self._codes.append(code)
        led = self.led_rad = self.led_rad + self._period_s * off_rad_s
        self._followed_rad2 += led * astray_rad
        self._led_rad2 += led * led

    @property
    def falls(self) -> bool:
        """Whether the code goes to ground by itself, as far as is known."""
        first, last, cycles = self._codes[0], self._codes[-1], len(self._codes) - 1
        if cycles < 2 or self.cycles > FALLEN_CYCLES or first < FALL_FROM * self._off_codes or last <= 0:
            return False
        share = math.pow(last / first, 1.0 / cycles)
        if share > FALLEN_SHARE ** (1.0 / FALLEN_CYCLES):
            return False
        off = max(abs(code - first * share**place) for place, code in enumerate(self._codes))
        return off <= self._off_codes

    @property
    def has_fallen(self) -> bool:
        """Whether that is sure."""
        return self.cycles == FALLEN_CYCLES and self.falls

    @property
    def is_ready(self) -> bool:
        """Whether enough is known."""
        if self.cycles >= self._judged:
            return True
        if self._led_rad2 < EARLY * self._grain_rad**2:
            return False
        return not EARLY_SHARES[0] < self._followed_rad2 / self._led_rad2 < EARLY_SHARES[1]

    @property
    def is_arm(self) -> bool:
        """Whether the arm stepped."""
        is_telling = abs(self.led_rad) > SMALLEST_LEAD * self._grain_rad
        return is_telling and self._followed_rad2 > ARM_SHARE * self._led_rad2
