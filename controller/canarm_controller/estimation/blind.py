"""The speed of a joint from its potentiometer and the arm's model, in place of a tachometer that has failed."""

POLE_RAD_S = 12.0
"""Triple pole of the observer: noise of 0.42 LSB leaves 0.03 rad/s; a wrong payload is learned within 0.3 s."""

SUBSTITUTE_POLE_RAD_S = 20.0
"""The same in place of a tachometer that is lost, for a law that is tuned to one. A payload of the box that turns
changes what the model lacks by 14 rad/s³, of which 3·14/ω² = 0.1 rad/s is left (0.3 at 12); noise leaves 0.065 (0.03).
"""
SLOWEST_POLE = 0.3
"""Largest pole times cycle time."""


def blind_pole_rad_s(period_s: float, pole_rad_s: float = POLE_RAD_S) -> float:
    """The observer's pole for a cycle of `period_s`."""
    return min(pole_rad_s, SLOWEST_POLE / period_s)


def observer_gains(period_s: float, pole_rad_s: float = POLE_RAD_S) -> tuple[float, float, float]:
    """Of angle, speed and acceleration bias for three poles at ω: 3ωT, 3ω²T, ω³T (Luenberger)."""
    omega = blind_pole_rad_s(period_s, pole_rad_s)
    return 3.0 * omega * period_s, 3.0 * omega**2 * period_s, omega**3 * period_s


class BlindObserver:
    """x' = x + T·v + T²/2·(a + b),  v' = v + T·(a + b),  b' = b, corrected by the potentiometer.

    The gains are `observer_gains`; after `start_moving` those of the parabola that fits all readings since best, as
    long as they are higher: the expanding-memory filter of degree 2 of Brookner, Tracking and Kalman Filtering Made
    Easy (1998).
    """

    __slots__ = ("_gains", "_period_s", "_readings", "bias", "position_rad", "velocity_rad_s")

    def __init__(self, period_s: float, pole_rad_s: float = POLE_RAD_S) -> None:
        self._period_s, self._gains = period_s, observer_gains(period_s, pole_rad_s)
        self.start(0.0, 0.0, 0.0)

    def start(self, position_rad: float, velocity_rad_s: float, bias_rad_s2: float) -> None:
        """Begin at the last known state."""
        self.position_rad, self.velocity_rad_s, self.bias = position_rad, velocity_rad_s, bias_rad_s2
        self._readings = 0

    def start_moving(self, position_rad: float, velocity_rad_s: float) -> None:
        """Begin at a measured angle, of which `correct` is still told, and a speed from it and the one before."""
        self.start(position_rad, velocity_rad_s, 0.0)
        self._readings = 1

    def predict(self, acceleration_rad_s2: float) -> None:
        """One cycle on, by the model's acceleration."""
        step_rad_s = self._period_s * (acceleration_rad_s2 + self.bias)
        self.position_rad += self._period_s * (self.velocity_rad_s + 0.5 * step_rad_s)
        self.velocity_rad_s += step_rad_s

    def shift(self, excess_s: float, acceleration_rad_s2: float) -> None:
        """The cycle was longer by `excess_s`."""
        step_rad_s = excess_s * (acceleration_rad_s2 + self.bias)
        self.position_rad += excess_s * (self.velocity_rad_s + 0.5 * step_rad_s)
        self.velocity_rad_s += step_rad_s

    def correct(self, measured_rad: float) -> None:
        """Take the potentiometer's angle."""
        off = measured_rad - self.position_rad
        by_position, by_speed, by_bias = self._gains if not self._readings else self._growing_gains()
        self.position_rad += by_position * off
        self.velocity_rad_s += by_speed * off
        self.bias += by_bias * off

    def _growing_gains(self) -> tuple[float, float, float]:
        """Of the next reading after `_readings`."""
        count, period_s = self._readings, self._period_s
        share = 1.0 / ((count + 1) * (count + 2) * (count + 3))
        growing = (
            3.0 * (3 * count * count + 3 * count + 2) * share,
            18.0 * (2 * count + 1) * share / period_s,
            60.0 * share / period_s**2,
        )
        self._readings = count + 1 if growing[2] > self._gains[2] else 0
        by_position, by_speed, by_bias = (max(each) for each in zip(growing, self._gains, strict=True))
        return by_position, by_speed, by_bias
