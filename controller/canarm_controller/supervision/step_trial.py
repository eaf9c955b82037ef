"""Decides whether a step of the speed away from the model was the arm's, or only the tachometer's.

If the arm stepped, the angle follows. Owns the least squares of angle over step; the reaction is decided
elsewhere.
"""

SMALLEST_LEAD, ARM_SHARE = 0.5, 0.65
"""A step that would have moved the angle by less than half a grain counts as the tachometer's; of others, this share
must be seen there. With 0.42 grains of noise a step of 1 rad/s of konkuk1 is judged to 0.15."""
EARLY, EARLY_SHARES = 5.0, (0.3, 0.7)
"""A large step is judged as soon as the sum of squares gives the share to 0.42/sqrt(5) = 0.19."""


class StepTrial:
    """One step of the speed, from its beginning to the verdict. Angles in rad, speeds in rad/s."""

    __slots__ = ("_followed_rad2", "_grain_rad", "_judged", "_led_rad2", "_period_s", "cycles", "led_rad", "step_rad_s")

    def __init__(self, grain_rad: float, period_s: float, judged: int) -> None:
        self._grain_rad, self._period_s, self._judged = grain_rad, period_s, judged
        self.begin(0.0)

    def begin(self, step_rad_s: float) -> None:
        """The speed has stepped in this cycle."""
        self.cycles, self.step_rad_s = 0, step_rad_s
        self.led_rad = self._period_s * step_rad_s
        """How far the arm would have moved had it stepped."""
        self._followed_rad2 = self._led_rad2 = 0.0

    def take(self, off_rad_s: float, astray_rad: float) -> None:
        """Take one cycle: speed minus model, and potentiometer minus the model's angle."""
        self.cycles += 1
        led = self.led_rad = self.led_rad + self._period_s * off_rad_s
        self._followed_rad2 += led * astray_rad
        self._led_rad2 += led * led

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
