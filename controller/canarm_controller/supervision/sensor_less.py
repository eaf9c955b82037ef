"""A joint that has lost a sensor: what replaces it, and when it is trusted again.

Owns the substitutes; how a failure is found is elsewhere.
"""

from ..estimation.blind import POLE_RAD_S, SUBSTITUTE_POLE_RAD_S, BlindObserver
from .joint_state import JointState, Mode
from .limits import Report
from .nominal import JointNominal
from .thresholds import Thresholds
from .timing import Timing

PERSISTENT_CYCLES = 4
"""How long a residual must be beyond a limit that a single reading can pass."""
EARLY_FACTOR = 2.3
"""Factor on the angle's limit while its base is poorly known."""
AGREE_FACTOR = 1.5
"""Factor on the speed's limit within which a tachometer agrees. It is trusted again after a second of agreement in
which the joint turned both ways: one that lags, or reads low, also agrees while the speed is right by chance."""
BLIND_FACTOR = 2.0
"""Factor on the other sensor's limits when one is lost."""


class SensorLess(JointState):
    """State of a joint that may have lost its tachometer, its potentiometer or both."""

    __slots__ = ("_agreed", "_blind", "_fastest", "_stepped")

    def __init__(self, nominal: JointNominal, thresholds: Thresholds, timing: Timing, report: Report) -> None:
        super().__init__(nominal, thresholds, timing, report)
        self._blind = BlindObserver(timing.period_s, SUBSTITUTE_POLE_RAD_S if nominal.speed else POLE_RAD_S)

    def start(self, position_rad: float) -> None:
        """Start at rest at a measured angle, with all sensors."""
        super().start(position_rad)
        self._fastest = 0.0, 0.0
        self._stepped = self._agreed = 0

    def coast(self, acceleration: float) -> None:
        """A cycle without a measurement."""
        super().coast(acceleration)
        self._blind.predict(acceleration)

    def shift(self, excess_s: float, acceleration: float) -> None:
        """The time to the next measurement is `excess_s` longer than a cycle."""
        super().shift(excess_s, acceleration)
        self._blind.shift(excess_s, acceleration)

    def _lose_tachometer(self, x: float, speed: float) -> bool:
        self._upset_at = self.cycles
        self.mode, self._agreed = Mode.NO_TACHOMETER, 0
        self._blind.start(self._angle(speed), speed, self.bias)
        self._blind.correct(x)
        self._fastest = 0.0, 0.0
        return self._substitute(x, self._blind.velocity_rad_s)

    def _without_tachometer(self, x: float, v: float, acceleration: float) -> bool:
        """Speed from potentiometer and model, until the tachometer has agreed long enough in both directions."""
        blind = self._blind
        blind.predict(acceleration)
        if abs(x - blind.position_rad) > BLIND_FACTOR * self._limits.jump:
            self._astray_cycles += 1
            if self._astray_cycles >= PERSISTENT_CYCLES and self._report("both-sensors", "no speed, no angle", None):
                self.mode = Mode.BLIND
        else:
            self._astray_cycles = 0
            blind.correct(x)
        self.speed, self.bias = blind.velocity_rad_s, blind.bias
        if abs(v - self.speed) > AGREE_FACTOR * self._limits.step or self._code_cycles > self._timing.stuck_sure:
            self._agreed, self._fastest = 0, (0.0, 0.0)
        else:
            low, high = self._fastest
            self._agreed, self._fastest = self._agreed + 1, (min(low, self.speed), max(high, self.speed))
            told = self._thresholds.told_speed
            if self._agreed >= self._timing.agree_again and low < -told and high > told:
                self._believe_tachometer(x, v)
        return self._substitute(x, blind.velocity_rad_s)

    def _believe_tachometer(self, x: float, v: float) -> None:
        self.mode, self.speed, self._last_rad_s = Mode.SOUND, v, v
        self._mismatch = self._swing = self._last_off = 0.0
        self._base = x - self._travel - self._half_s * v + self._twist
        self._learn_from = self.cycles
        self._set_rate()
        self._calm_at = self.cycles + self._timing.calm

    def _without_potentiometer(self, x: float, v: float, predicted: float) -> bool:
        """Angle from the integrated tachometer, which a noisy potentiometer may still correct slowly."""
        off = v - predicted
        if abs(off) > BLIND_FACTOR * self._limits.step:
            self._stepped += 1
            if self._stepped >= PERSISTENT_CYCLES and self._report("both-sensors", "no angle, no speed", None):
                self.mode = Mode.BLIND
            v, off = predicted, 0.0
        else:
            self._stepped = 0
        if self.mode is Mode.NOISY_POTENTIOMETER:
            self._follow_noisy(x - self._angle(v))
        self._advance(predicted + self._speed_gain * off, v)
        self.bias += self._accel_gain * off
        return self._substitute(self._angle(v), v)

    def _follow_noisy(self, astray: float) -> None:
        """Correct the angle by a noisy potentiometer, which is right on average."""
        limit = self._limits.jump
        bounded = max(-limit, min(limit, astray))
        self._base += self._base_gain * bounded
        self._mismatch += (bounded - self._mismatch) * 0.03
        self._agreed = self._agreed + 1 if abs(astray) < 0.6 * limit else 0
        highest = 2.0 * EARLY_FACTOR * self._limits.drift
        if abs(self._mismatch) > highest and self._report(
            "potentiometer-mismatch", self._angle_detail(self._mismatch), None
        ):
            self.mode = Mode.NO_POTENTIOMETER
        elif self._agreed >= self._timing.agree:
            self.mode, self._mismatch = Mode.SOUND, 0.0
