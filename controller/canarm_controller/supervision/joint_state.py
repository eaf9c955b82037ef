"""The estimated state of one joint: mode of its sensors, speed and angle, model error, and limits.

Owns the state that verdicts work on, and how it evolves; verdicts are elsewhere.
"""

import math
from enum import Enum

from .limits import JointLimits, Report
from .nominal import JointNominal
from .thresholds import DRIFT_S, Thresholds, observer_bandwidth_rad_s
from .timing import Timing

NO_END = 1 << 40
"""Above all codes of any converter."""
LACKING_FLOOR = 0.1
"""Share of the payload of the box that no observer tells from its own noise."""
LACKING_KEPT = 0.998
"""How what the model has lacked fades in 10 ms: by half within two swings of an arm."""
FIRST_READINGS = 20
"""Base and offset of the tachometer are learned as if this many readings had gone before."""


STUCK_HASTE = 1.45
"""Factor on the model's change of speed while the tachometer's code stands, if that is not for long."""
Mark = tuple[int, float, float, int, float]
"""While a code stands: cycle, the model's speed, what it lacks, until when friction is unknown, and the residual."""


class Mode(Enum):
    """How far the joint's sensors can be trusted."""

    SOUND = 0
    STEP = 1
    """The speed has stepped, for a reason not yet known."""
    NO_TACHOMETER = 2
    NOISY_POTENTIOMETER = 3
    NO_POTENTIOMETER = 4
    BLIND = 5


class JointState:
    """State of one joint, in rad, rad/s and rad/s²."""

    __slots__ = (
        "_accel_gain",
        "_angle_ends",
        "_astray_cycles",
        "_bandwidth_rad_s",
        "_base",
        "_base_gain",
        "_blurred_until",
        "_calm_at",
        "_changed_at",
        "_code",
        "_code_cycles",
        "_code_swing",
        "_code_turned",
        "_half_s",
        "_highest_speed_code",
        "_lacking",
        "_last_off",
        "_last_rad_s",
        "_learn_from",
        "_learning_cycles",
        "_limits",
        "_marks",
        "_mismatch",
        "_offset",
        "_offset_gain",
        "_period_s",
        "_position_lsb",
        "_report",
        "_speed_gain",
        "_speed_lsb",
        "_swing",
        "_thresholds",
        "_timing",
        "_travel",
        "_twist",
        "_upset_at",
        "bias",
        "compliance_rad_nm",
        "contested_until",
        "cycles",
        "is_agitated",
        "mode",
        "model_rad_s",
        "position_rad",
        "speed",
        "turned_until",
        "turning_rad_s",
        "velocity_rad_s",
    )  # fmt: skip

    def __init__(self, nominal: JointNominal, thresholds: Thresholds, timing: Timing, report: Report) -> None:
        position, speed = nominal.position, nominal.speed
        period_s = timing.period_s
        self._report, self._thresholds, self._timing, self._period_s = report, thresholds, timing, period_s
        self._limits = JointLimits(thresholds)
        self._position_lsb, self._angle_ends = position.step, position.end_codes
        self._speed_lsb = speed.step if speed else thresholds.speed_grain
        self._highest_speed_code = speed.end_codes[1] if speed and speed.end_codes else NO_END
        self._half_s = 0.5 * period_s - (speed.skew_s if speed else 0.0)
        bandwidth_rad_s = self._bandwidth_rad_s = observer_bandwidth_rad_s(period_s)
        self._speed_gain = 2.0 * bandwidth_rad_s * period_s
        self._accel_gain = bandwidth_rad_s**2 * period_s
        self._learning_cycles = round(DRIFT_S / period_s)

    def start(self, position_rad: float) -> None:
        """Start at rest at a measured angle."""
        self.mode = Mode.SOUND
        self._limits.start()
        self.cycles = self._learn_from = 0
        self.speed = self.bias = self.model_rad_s = self._last_rad_s = 0.0
        self._travel = self._mismatch = self._swing = self._offset = self._last_off = 0.0
        self._base, self._twist = position_rad, 0.0
        self._code = -1
        self._code_cycles = self._astray_cycles = 0
        self._calm_at = self._timing.calm
        self._blurred_until = -1
        self._upset_at = self.turned_until = self._code_turned = 0
        self._lacking = self._code_swing = 0.0
        self._marks: tuple[Mark, Mark] = ((0, 0.0, 0.0, 0, 0.0),) * 2
        self._changed_at = 0
        self._set_rate()
        self.contested_until = -1
        """Until this cycle a code that stands is no proof: another joint has shown that the arm itself has changed."""
        self.turning_rad_s = 0.0
        """How fast the arm turns, all of its joints together."""
        self.compliance_rad_nm = 0.0
        """Of its drive wire, where that is known to be elastic; else 0."""
        self.is_agitated = False
        """Whether the speed left the model's prediction; reset once investigated."""
        self.position_rad, self.velocity_rad_s = position_rad, 0.0
        """Substitutes for the measurement, used if `step` says so."""

    def take_load(self) -> None:
        """The arm leaves its support: its payload is not known yet."""
        self._calm_at = self.cycles + self._timing.calm

    def strikes(self, position_rad: float, side: int) -> bool:
        """Whether it is at its stop on this side (-1 or 1) and moves into it; not if only its sensor says so."""
        return self.speed * side > self._thresholds.standing

    def shake(self) -> None:
        """A joint of its robot strikes an end stop: it may go on in any way."""
        self._calm_at = max(self._calm_at, self.cycles + self._timing.calm)

    @property
    def is_elastic(self) -> bool:
        """Whether its drive wire is known to be elastic."""
        return self.compliance_rad_nm > 0.0

    @property
    def is_witness(self) -> bool:
        """Whether it contradicts its model by a reading that lives: the arm has changed, and not its tachometer."""
        return self.is_agitated and self._code_cycles < self._timing.stuck

    @property
    def is_upset(self) -> bool:
        """Whether its speed has been unexpected within the last second, apart from the start."""
        return self._upset_at > self._timing.calm and self.cycles < self._upset_at + self._timing.doubt

    @property
    def noisiness(self) -> float:
        """By what factor its speed is noisier than nominal."""
        noisier: float = self._limits.step / self._thresholds.step
        return noisier

    def learn_lack(self) -> None:
        """Once in 10 ms while nothing surprises: the most that the model has lacked lately."""
        if self._code_cycles < self._timing.stuck:
            self._lacking = max(abs(self.bias), LACKING_KEPT * self._lacking)

    def unlearned_friction(self, turned_until: int, cycle: int, worst_rad_s2: float) -> float:
        """What friction may make, rad/s², of the joint that turned lately, as `turned_until` says, in `cycle`.

        `worst_rad_s2` is what the box has; twice the most that the model has lacked bounds it as well: half of the
        error of friction that turns shows on either side.
        """
        unlearned = min((turned_until - cycle) / self._timing.turning, 1.0)
        if unlearned <= 0.0:
            return 0.0
        if self.cycles >= self._timing.early:
            worst_rad_s2 = min(worst_rad_s2, 2.0 * self._lacking)
        return unlearned * worst_rad_s2

    def doubt_rad_s2(self, mobility: float) -> float:
        """What the model's acceleration may be off by: friction that has just turned, and a payload that turns.

        The observer is two time constants behind it.
        """
        worst = self._thresholds.turned_nm * mobility
        behind = self._payload_share() * self._thresholds.stuck_drift * 2.0 / self._bandwidth_rad_s
        return self.unlearned_friction(self.turned_until, self.cycles, worst) + behind

    @property
    def behind_rad_s2(self) -> float:
        """What is not learned yet of a payload that turns with the arm: the observer is two time constants behind."""
        return self._payload_share() * self._thresholds.payload * self.turning_rad_s * 2.0 / self._bandwidth_rad_s

    def _payload_share(self) -> float:
        """How much payload of the box there is: what the model has lacked lately tells, unless the arm has changed."""
        thresholds = self._thresholds
        if thresholds.payload > 0.0 and self.cycles >= self._changed_at + self._timing.doubt:
            return min(LACKING_FLOOR + self._lacking / thresholds.payload, 1.0)
        return 1.0

    def _model_drift(self, elapsed_s: float) -> float:
        """What a payload that turns makes of the model's speed, rad/s, while nothing corrects it."""
        behind_s = 0.5 * elapsed_s + 2.0 / self._bandwidth_rad_s
        return self._payload_share() * self._thresholds.stuck_drift * elapsed_s * behind_s

    def _is_beyond_model(
        self, moved: float, limit: float, stood_s: float, since: int, turned_until: int, swing: float
    ) -> bool:
        """Whether the model's speed has moved by more than a right model may be off by in `stood_s`, since a cycle.

        The payload's share turns with the arm, and its observer is two time constants behind. Friction of a joint that
        had just turned then, as `turned_until` says, was not known; nor was what left a `swing` of a/(e·ω).
        """
        unlearned = self.unlearned_friction(turned_until, since, self._thresholds.stuck_turned)
        unlearned += math.e * self._bandwidth_rad_s * abs(swing)
        limit += self._model_drift(stood_s) + unlearned * stood_s
        return not -limit < moved < limit

    def _goes_on(self, model_rad_s: float, bias_rad_s2: float) -> bool:
        """Whether the model's speed moves while the code has stood for long, rightly perhaps: on a stretch of constant
        speed it does. Judged is what has come since one or two times `stuck_sure` ago; before, the bias was right.
        """
        sure = self._timing.stuck_sure
        if not self._code_cycles % sure:
            mark = self.cycles, model_rad_s, bias_rad_s2, self.turned_until, self._swing
            self._marks = (self._marks[1] if self._code_cycles > sure else mark), mark
            return False
        since, model, bias, turned_until, swing = self._marks[0]
        stood = self.cycles - since
        if not self._timing.stuck <= stood <= self._code_cycles:
            return False
        stood_s = stood * self._period_s
        moved, limit = model_rad_s - model + stood_s * bias, STUCK_HASTE * self._thresholds.stuck_speed
        is_far = not -limit < moved < limit
        return is_far and self._is_beyond_model(moved, limit, stood_s, since, turned_until, swing)

    def coast(self, acceleration: float) -> None:
        """A cycle without a measurement."""
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        self._blurred_until = self.cycles + self._timing.blurred
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
        rate = 2.0 / (DRIFT_S if cycles > self._learning_cycles else (cycles + FIRST_READINGS) * self._period_s)
        self._base_gain = 2.0 * rate * self._period_s
        self._offset_gain = rate**2 * self._period_s

    def _angle(self, v: float) -> float:
        return self._travel + self._half_s * v + self._base - self._twist

    def _advance(self, speed: float, turned_rad_s: float) -> None:
        """Advance to the next cycle at the estimated speed."""
        self.speed = speed
        self._last_rad_s = turned_rad_s
        self._travel += self._period_s * turned_rad_s
        self._base += self._period_s * self._offset

    def _substitute(self, position_rad: float, velocity_rad_s: float) -> bool:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s
        return True

    def _angle_detail(self, astray_rad: float) -> str:
        return f"{astray_rad / self._position_lsb:+.1f} LSB from the integrated tachometer"
