"""What is known of one joint: the mode of its sensors, its speed and angle, what the model lacks, and the limits.

Owns the state that every verdict works on, and how it goes on in time. Verdicts must not enter.
"""

from enum import Enum

from canarm_protocol.cell.model import Supervision

from .limits import JointLimits, Report

BANDWIDTH_RAD_S = 30.0
"""Of the observer of speed and acceleration bias: fast enough for gravity of a wrong payload along a swing (10 rad/s³
leave 10/30² rad/s = 0.6 LSB), slow enough that a step of either shows in full."""
DRIFT_S = 6.0
"""In which the tachometer's offset is learned from the potentiometer; shorter at first."""
CALM_CYCLES = 100
"""After the start, or after the arm has changed, the payload's weight is not known: wider limits of the speed."""
BLURRED_CYCLES = 40
"""After a measurement whose time is known badly, limits are the wide ones."""
DOUBT_CYCLES = 400
"""A second."""


class Mode(Enum):
    """How far the joint's sensors can be trusted."""

    SOUND = 0
    STEP = 1
    """The speed has stepped; nobody knows yet why."""
    NO_TACHOMETER = 2
    NOISY_POTENTIOMETER = 3
    NO_POTENTIOMETER = 4
    BLIND = 5


class JointState:
    """State of one joint, in rad, rad/s and rad/s²."""

    __slots__ = (
        "_accel_gain", "_astray_cycles", "_base", "_base_gain", "_blurred_until", "_calm_at", "_code", "_code_cycles",
        "_half_s", "_last_off", "_last_rad_s", "_learn_from", "_learning_cycles", "_limits", "_mismatch", "_offset",
        "_offset_gain", "_period_s", "_position_lsb", "_report", "_speed_gain", "_speed_lsb", "_swing", "_travel",
        "_upset_at", "bias", "cycles", "is_agitated", "mode", "model_rad_s", "position_rad", "speed", "velocity_rad_s",
    )  # fmt: skip

    def __init__(
        self, limits: Supervision, position_lsb: float, speed_lsb: float, tachometer_skew_s: float, period_s: float,
        report: Report,
    ) -> None:  # fmt: skip
        self._report = report
        self._limits = JointLimits(limits, position_lsb, speed_lsb)
        self._position_lsb, self._speed_lsb, self._period_s = position_lsb, speed_lsb, period_s
        self._half_s = 0.5 * period_s - tachometer_skew_s
        self._speed_gain = 2.0 * BANDWIDTH_RAD_S * period_s
        self._accel_gain = BANDWIDTH_RAD_S**2 * period_s
        self._learning_cycles = round(DRIFT_S / period_s)

    def start(self, position_rad: float) -> None:
        """At rest at a measured angle."""
        self.mode = Mode.SOUND
        self._limits.start()
        self.cycles = self._learn_from = 0
        self.speed = self.bias = self.model_rad_s = self._last_rad_s = 0.0
        self._travel = self._mismatch = self._swing = self._offset = self._last_off = 0.0
        self._base = position_rad
        self._code = -1
        self._code_cycles = self._astray_cycles = 0
        self._calm_at = CALM_CYCLES
        self._blurred_until = -1
        self._upset_at = 0
        self._set_rate()
        self.is_agitated = False
        """Whether the speed went where the model did not expect it; whoever looks into it sets it back."""
        self.position_rad, self.velocity_rad_s = position_rad, 0.0
        """What to believe where `step` says so."""

    @property
    def is_upset(self) -> bool:
        """Whether its speed has surprised within the last second, the start apart."""
        return self._upset_at > CALM_CYCLES and self.cycles < self._upset_at + DOUBT_CYCLES

    def coast(self, acceleration: float) -> None:
        """A cycle without a measurement."""
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        self._blurred_until = self.cycles + BLURRED_CYCLES
        self._advance(predicted, predicted)
        self._substitute(self._angle(predicted), predicted)

    def shift(self, excess_s: float, acceleration: float) -> None:
        """The time to the next measurement is `excess_s` longer than a cycle."""
        speed = self._last_rad_s if self.mode is Mode.SOUND else self.speed
        step_rad_s = excess_s * (acceleration + self.bias)
        self._travel += excess_s * (speed + 0.5 * step_rad_s)
        self._base += excess_s * self._offset
        self.speed += step_rad_s
        self.model_rad_s += excess_s * acceleration

    def _set_rate(self) -> None:
        """How fast base and offset of the tachometer are learned, critically damped; faster at first."""
        cycles = self.cycles - self._learn_from
        rate = 2.0 / (DRIFT_S if cycles > self._learning_cycles else (cycles + 20) * self._period_s)
        self._base_gain = 2.0 * rate * self._period_s
        self._offset_gain = rate**2 * self._period_s

    def _angle(self, v: float) -> float:
        return self._travel + self._half_s * v + self._base

    def _advance(self, speed: float, turned_rad_s: float) -> None:
        """On to the next cycle at the speed that is believed."""
        self.speed = speed
        self._last_rad_s = turned_rad_s
        self._travel += self._period_s * turned_rad_s
        self._base += self._period_s * self._offset

    def _substitute(self, position_rad: float, velocity_rad_s: float) -> bool:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s
        return True

    def _angle_detail(self, astray_rad: float) -> str:
        return f"{astray_rad / self._position_lsb:+.1f} LSB from the integrated tachometer"
