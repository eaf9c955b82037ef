"""One joint's potentiometer, tachometer and model as three witnesses: two that agree outvote the third.

Owns a joint's residuals and decides which sensor is to blame. Plain floats: `step` runs per joint and cycle.
Names of joints and cards, and how the robot is stopped, are not known here.
"""

from ..estimation.blind import observer_gains
from .joint_state import STUCK_HASTE, Mode
from .limits import NOISE_MASK, Report
from .noisiness import SPIKES, TURNS, SpikeCount, TurnCount
from .nominal import JointNominal
from .sensor_less import BLIND_FACTOR, EARLY_FACTOR, PERSISTENT_CYCLES, SensorLess
from .step_trial import StepTrial
from .suspicion import Suspicion
from .thresholds import Thresholds
from .timing import Timing
from .wire_twist import WireTwist

MISMATCH_GAIN = 1.0 / 16.0
"""White noise of 0.42 grains leaves 0.42/sqrt(31) = 0.075; a step of 3 grains passes 0.65 in the fourth cycle."""
UNREST_FACTOR = 2.5
"""Factor on the speed's limits while the payload is unknown, or after a measurement of uncertain time."""
LONGEST_GAP_S = 0.1
"""After a longer gap, residuals start over."""
GAP_FACTOR = 6.0
"""Factor on the speed's limit after a gap: over 50 ms friction may reverse, and the payload be off by 12 rad/s²."""
STUCK_SOON_CYCLES = 6
"""If the tachometer has covered part of the travel while the position's code has not changed, and will soon cover the
rest, the verdict waits."""
RANGE_CYCLES = 2
STEP_SHARE = 0.75
"""Share of the limit by which a speed must change in one cycle to have stepped; else the arm accelerates."""
LEARNING_MASK = 15
"""The learning rate changes every 16 cycles."""

_SOUND = Mode.SOUND  # an enum's attribute is slow


class JointWitness(SensorLess):
    """Residuals of one joint.

    Speed       v̂' = v̂ + T·(a + b), ν = tachometer - v̂; v̂ += 2ω·T·ν, b += ω²·T·ν (ω = 30 rad/s, critically damped)
    Angle       e = potentiometer - ∫tachometer - base; base and its rate, the tachometer's offset, are learned in 6 s

    a is the nominal model's acceleration under the commanded current, b what it lacks: another payload, friction.
    Limits are multiples of grains, see `thresholds`. A right robot leaves 0.42 grains in one reading of either sensor.
    Measured in fault-free runs of all laws with a payload of -50..+50 %: |ν| <= 2.5 grains, filtered 1.3; |e| <= 1.9,
    filtered 0.5.
    """

    __slots__ = (
        "_accused_at", "_begun_rad", "_code_at", "_code_bias", "_code_model", "_end_gains", "_gap_at",
        "_quick_cycles", "_raw", "_settled_at", "_spikes", "_stepped_until",
        "_stuck_cycles", "_stuck_limit", "_suspicion", "_turns", "_wire", "_x_code", "_x_travel", "trial",
    )  # fmt: skip

    def __init__(self, nominal: JointNominal, thresholds: Thresholds, timing: Timing, report: Report) -> None:
        super().__init__(nominal, thresholds, timing, report)
        self._stuck_limit, self._stuck_cycles = thresholds.stuck_speed, timing.stuck
        self._suspicion = Suspicion(timing.doubt, self._bandwidth_rad_s, timing.period_s)
        self._quick_cycles = max(int(thresholds.wire_turn_s / timing.period_s), 1)
        noise_codes = nominal.speed.noise_lsb if nominal.speed else 0.0
        self.trial = StepTrial(thresholds.position_grain, timing.period_s, timing.step, noise_codes)
        self._end_gains = observer_gains(timing.period_s)
        self._wire = WireTwist(nominal, thresholds, timing.refresh, timing.period_s)
        self.start(0.0)

    def start(self, position_rad: float) -> None:
        """At rest at a measured angle."""
        super().start(position_rad)
        self._wire.start()
        self._begun_rad = position_rad
        self._spikes, self._turns = (
            {sensor: SpikeCount(self._timing.spike) for sensor in ("potentiometer", "tachometer")},
            TurnCount(self._timing.turn, self._quick_cycles),
        )
        self._suspicion.start()
        self._x_code, self._code_at, self._accused_at = -1, 0, -1
        self._code_model = self._code_bias = self._x_travel = self._raw = 0.0
        self._stepped_until = -1
        self._settled_at = -self._timing.unsettled
        self._gap_at = -self._timing.doubt

    def step(self, x: float, v: float, acceleration: float, x_code: int, v_code: int) -> bool:
        """Take one cycle: angle, speed, and the model's acceleration since the last one (rad, rad/s, rad/s²).

        Returns True where `position_rad` and `velocity_rad_s` are to be taken instead of the measurement.
        """
        period_s = self._period_s
        count = self.cycles = self.cycles + 1
        model = self.model_rad_s = self.model_rad_s + period_s * acceleration
        bias, travel = self.bias, self._travel
        predicted = self.speed + period_s * (acceleration + bias)
        off = v - predicted
        is_stuck = False
        if v_code != self._code:
            self._code, self._code_cycles, self._code_model, self._code_bias = v_code, 0, model, bias
            self._code_at, self._code_turned, self._code_swing = count, self.turned_until, self._swing
        else:
            cycles = self._code_cycles = self._code_cycles + 1
            if cycles >= self._stuck_cycles and count >= self._calm_at and count >= self.contested_until:
                stood_s = (count - self._code_at) * period_s
                moved = model - self._code_model + stood_s * self._code_bias
                timing = self._timing
                is_sure = cycles >= (timing.stuck_swinging if self.compliance_rad_nm else timing.stuck_sure)
                limit = self._stuck_limit if is_sure else STUCK_HASTE * self._stuck_limit
                is_far = not -limit < moved < limit and self._is_beyond_model(
                    moved, limit, stood_s, self._code_at, self._code_turned, self._code_swing
                )
                is_far = is_far or (is_sure and self._goes_on(model, bias))
                is_stuck = is_far or self._accused_at == self._code_at
        if x_code != self._x_code:
            self._x_code, self._x_travel = x_code, travel
        if self.mode is not _SOUND:
            return self._step_unsound(x, v, acceleration, predicted, v_code)
        raw = self._raw = x - travel - self._half_s * v - self._base
        astray = raw + self._twist
        mismatch = self._mismatch
        mismatch += (astray - mismatch) * MISMATCH_GAIN
        swing = self._swing
        swing += (off - swing) * 0.125
        limits = self._limits
        jump, drift, doubt, swing_limit = limits.jump, limits.drift, limits.doubt, limits.swing
        if (
            is_stuck
            or not -jump < astray < jump
            or not -drift < mismatch < drift
            or not -doubt < off < doubt
            or not -swing_limit < swing < swing_limit
            or self._astray_cycles
            or not 0 < v_code < self._highest_speed_code
        ) and self._examine(x, predicted, off, astray, mismatch, swing, is_stuck):
            return True
        if not count & NOISE_MASK:
            limits.learn(astray, mismatch, off - self._last_off)
            self._suspicion.take(mismatch)
            if not count & LEARNING_MASK:
                self._set_rate()
                if count >= self._timing.early:
                    limits.settle()
        self.speed = predicted + self._speed_gain * off
        self.bias = bias + self._accel_gain * off
        self._swing = swing
        self._last_off = off
        self._last_rad_s = v
        self._travel = travel + period_s * v
        self._mismatch = mismatch
        self._base += period_s * self._offset + self._base_gain * raw
        self._offset += self._offset_gain * raw
        return False

    def glimpse(self, x: float, v: float, acceleration: float, x_code: int, v_code: int, is_gap: bool) -> bool:
        """As `step`, for a measurement of uncertain time: integrate, and judge only what does not depend on time.

        `is_gap`: so uncertain that the residuals start over.
        """
        self._blurred_until = self.cycles + self._timing.blurred
        if self.mode is Mode.STEP:
            self.mode = _SOUND  # a verdict needs cycles in a row
        if self.mode is not _SOUND or (v_code == self._code and not is_gap and self._code_cycles >= self._stuck_cycles):
            return self.step(x, v, acceleration, x_code, v_code)
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        off, limit = v - predicted, GAP_FACTOR * self._limits.step
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        if v_code != self._code:
            self._code, self._code_cycles, self._code_model, self._code_bias = v_code, 0, self.model_rad_s, self.bias
            self._code_at, self._code_turned, self._code_swing = self.cycles, self.turned_until, self._swing
        else:
            self._code_cycles += 1
        is_believed = is_gap or -limit < off < limit
        v = v if is_believed else predicted
        if is_gap:
            self._base = x - self._travel - self._half_s * v - self._mismatch + self._twist
            self._wire.count_anew()
            self._learn_from = self._gap_at = self.cycles
            self._set_rate()
        angle = self._angle(v)
        self._last_off = self._swing = 0.0
        self._last_rad_s = v
        self._advance(v, v)
        is_near = abs(x - angle) < BLIND_FACTOR * self._limits.jump
        self._substitute(x if is_near else angle, v)
        return not (is_believed and is_near)

    def twist(self, drive_nm: float, acceleration: float) -> None:
        """Take what drive, less friction, and the model's acceleration make of the wire's torque, once in 10 ms."""
        if self.mode is _SOUND and not self._astray_cycles:
            wire = self._wire
            wire.take(drive_nm, acceleration + self.bias, self._raw, self._base_gain, self._offset_gain)
            self._twist = wire.twist_rad
            self.compliance_rad_nm = wire.compliance if wire.is_elastic else 0.0

    def accuse_code(self) -> bool:
        """Whether an unexpected acceleration is the tachometer's: its code stands, at a speed that it can show.

        It is then called stuck. An arm that accelerates changes the code; one that was stopped shows that it stands.
        """
        is_shown = abs(self._last_rad_s) >= self._thresholds.standing and 0 < self._code < self._highest_speed_code
        is_shown = is_shown and self.cycles >= self.contested_until
        self._accused_at = self._code_at if is_shown and self._code_cycles >= self._stuck_cycles else -1
        return self._accused_at >= 0

    def settle(self, bias_rad_s2: float) -> None:
        """The unexpected acceleration has been investigated."""
        self.bias += bias_rad_s2
        self._swing = 0.0
        self._calm_at = self.cycles + self._timing.calm
        self._settled_at = self._upset_at = self._changed_at = self.cycles

    def _examine(
        self, x: float, predicted: float, off: float, astray: float, mismatch: float, swing: float, is_stuck: bool
    ) -> bool:
        """Examine something unusual. True if nothing must be learned from this cycle's measurement."""
        limits, count, timing = self._limits, self.cycles, self._timing
        if self._judge_angle(x, predicted, off, astray):
            return True
        if self._code in (0, self._highest_speed_code) and (
            (off if predicted + off > 0.0 else -off)
            < limits.step * UNREST_FACTOR + self._model_drift(self._code_cycles * self._period_s)
            or count < self._gap_at + timing.blurred  # in which the current stayed what it was
        ):
            return self._beyond_end(x, predicted)
        if is_stuck and self._report("tachometer-stuck", self._stuck_detail(), None):
            return self._lose_tachometer(x, predicted)
        is_doubtful = not -limits.doubt < off < limits.doubt
        turns = is_doubtful and count > timing.swinging and self._turns.is_too_many(count, off)
        if turns and self._report("sensor-noise", f"tachometer: {TURNS} turns", None):
            return self._lose_tachometer(x, predicted)
        is_calm = count >= max(self._calm_at, self._blurred_until, self._gap_at + timing.doubt)
        factor = 1.0 if is_calm else UNREST_FACTOR
        step = limits.step * factor
        if count < timing.swinging:
            step = max(step, self._thresholds.start_speed)
        if not -step < off < step:
            self.is_agitated = True
            if abs(off - self._last_off) >= STEP_SHARE * step:
                self.mode = Mode.STEP
                self.trial.begin(off, self._code)
                self._advance(predicted, predicted)
                return self._substitute(x, predicted)
        if is_doubtful:
            self._suspicion.doubt(count, off)
        if not -limits.swing * factor < swing < limits.swing * factor:
            self.is_agitated = True
        is_wide = count < max(self._stepped_until, self._blurred_until)
        drift = limits.drift * (EARLY_FACTOR if is_wide or count < self._learn_from + timing.early else 1.0)
        drift += self._thresholds.twist if count < timing.early else self._wire.unlearned_rad
        return not -drift < mismatch < drift and self._judge_mismatch(x, predicted, mismatch)

    def _beyond_end(self, x: float, predicted: float) -> bool:
        """As fast as the tachometer can show, and perhaps faster: the angle corrects the model, with three poles."""
        by_position, by_speed, by_bias = self._end_gains
        off = x - self._angle(predicted) - self._mismatch
        self._base += by_position * off
        predicted += by_speed * off
        self.bias += by_bias * off
        self._last_off = self._swing = 0.0
        self._advance(predicted, predicted)
        return self._substitute(x, predicted)

    def _judge_angle(self, x: float, predicted: float, off: float, astray: float) -> bool:
        """The potentiometer against the integrated tachometer in one cycle: no tachometer goes wrong that fast.

        Unless its code has not changed for long, and the position sensor is a fine one.
        """
        if -self._limits.jump < astray < self._limits.jump:
            if self._astray_cycles:
                self._astray_cycles = 0
                self._spike("potentiometer")
            return False
        self._astray_cycles += 1
        if self._astray_cycles >= PERSISTENT_CYCLES:
            if self._code_cycles >= self._timing.stuck_sure and self._report(
                "tachometer-stuck", self._stuck_detail(), None
            ):
                self._base += astray
                return self._lose_tachometer(x, predicted)
            name, detail = "potentiometer-jump", self._angle_detail(astray)
            if self._x_code in self._angle_ends:
                name, detail = "potentiometer-range", f"code {self._x_code}"
            elif (turned := abs(self._travel - self._x_travel)) > self._thresholds.stuck_travel:
                name, detail = "potentiometer-stuck", self._still_detail(turned)
            if self._report(name, detail, None):
                self.mode = Mode.NO_POTENTIOMETER
        self._advance(predicted + self._speed_gain * off, predicted + off)
        self.bias += self._accel_gain * off
        return self._substitute(x - astray, predicted + off)

    def _believe_tachometer(self, x: float, v: float) -> None:
        super()._believe_tachometer(x, v)
        self._wire.count_anew()

    def _judge_mismatch(self, x: float, predicted: float, mismatch: float) -> bool:
        """Potentiometer and integrated tachometer have drifted apart."""
        detail, thresholds = self._angle_detail(mismatch), self._thresholds
        turned = abs(self._travel - self._x_travel)
        soon = turned + STUCK_SOON_CYCLES * self._period_s * abs(predicted)
        if self.cycles < self._settled_at + self._timing.unsettled:
            name = "drive-broken"
        elif self.cycles < self._stepped_until and self._suspicion.fits(self.cycles, mismatch):
            name = "tachometer-mismatch"
        elif turned > thresholds.stuck_travel:
            name, detail = "potentiometer-stuck", self._still_detail(turned)
        elif turned > thresholds.stuck_suspect and soon > thresholds.stuck_travel:
            return False
        elif self._suspicion.fits(self.cycles, mismatch) or self._code_cycles >= self._stuck_cycles:
            name = "tachometer-mismatch"
        elif self.cycles < self._timing.early and (x - self._begun_rad) * self._travel < 0.0:
            # From the first move on the angle goes the other way than model and tachometer: it is reversed.
            name = "potentiometer-mismatch"
        elif self._suspicion.is_slow(mismatch):
            # Either may drift, but of a tachometer an offset is enough; a potentiometer that slow still holds the arm.
            name, detail = "tachometer-mismatch", f"{detail}, slowly"
        else:
            name = "potentiometer-mismatch"
        if not self._report(name, detail, None):
            return False
        if name == "tachometer-mismatch":
            return self._lose_tachometer(x, predicted)
        self.mode = Mode.NO_POTENTIOMETER
        self._advance(predicted, predicted)
        return self._substitute(x - mismatch, predicted)

    def _step_unsound(self, x: float, v: float, acceleration: float, predicted: float, v_code: int) -> bool:
        if self.mode is Mode.STEP:
            return self._judge_step(x, v, predicted, v_code)
        if self.mode is Mode.NO_TACHOMETER:
            return self._without_tachometer(x, v, acceleration)
        if self.mode is Mode.BLIND:
            self._advance(predicted, predicted)
            return self._substitute(self._angle(predicted), predicted)
        return self._without_potentiometer(x, v, predicted)

    def _judge_step(self, x: float, v: float, predicted: float, v_code: int) -> bool:
        """The speed has stepped away from the model. The angle decides whether the arm did, or only the tachometer."""
        trial, off, limits = self.trial, v - predicted, self._limits
        step = trial.step_rad_s
        trial.take(off, x - self._angle(predicted) - self._mismatch, v_code)
        if abs(off) < max(0.4 * abs(step), limits.doubt):
            self.mode = _SOUND
            if not self._spike("tachometer"):
                return self._lose_tachometer(x, predicted)
        elif off * step < 0.0 and self._report("sensor-noise", "tachometer: one way, then the other", None):
            return self._lose_tachometer(x, predicted)
        elif v_code in (0, self._highest_speed_code) and trial.cycles >= RANGE_CYCLES - 1:
            if self.cycles < self._settled_at + self._timing.unsettled:
                self._report("overspeed", f"tachometer at code {v_code}", None)
                return self._believe_step(v)
            if self._report("tachometer-range", f"code {v_code}", None):
                return self._lose_tachometer(x, predicted)
        elif trial.has_fallen and self._report("tachometer-jump", f"its pin goes to ground, code {v_code}", None):
            return self._lose_tachometer(x, predicted)
        elif off * step > 0.0 and trial.cycles >= 2 and abs(off) > 1.6 * abs(step) + limits.doubt and not trial.falls:
            return self._believe_step(v)
        elif trial.is_ready:
            is_stuck = self._code_cycles >= self._stuck_cycles - 1
            if trial.is_arm and not is_stuck:
                return self._believe_step(v)
            name = "tachometer-stuck" if is_stuck else "tachometer-jump"
            detail = self._stuck_detail() if is_stuck else f"{off / self._speed_lsb:+.0f} LSB from the model"
            if self._report(name, detail, None):
                return self._lose_tachometer(x, predicted)
            return self._believe_step(v)
        self._advance(predicted, predicted)
        return self._substitute(x, predicted)

    def _believe_step(self, v: float) -> bool:
        """The arm itself has stepped."""
        self.mode = _SOUND
        self._travel += self.trial.led_rad
        self._swing = 0.0
        self.speed = self._last_rad_s = v
        self._stepped_until = self.cycles + self._timing.doubt
        self._suspicion.doubt(self.cycles, self.trial.step_rad_s)
        self._upset_at = self.cycles
        self.is_agitated = True
        self._calm_at = self.cycles + self._timing.calm
        return False

    def _spike(self, sensor: str) -> bool:
        """One reading was wrong. False if there were so many that the sensor is given up."""
        self.is_agitated = False
        if not self._spikes[sensor].is_too_many(self.cycles):
            self._report(f"{sensor}-spike", "one reading rejected", None)
            return True
        if not self._report(
            "sensor-noise", f"{sensor}: {SPIKES} readings rejected within {self._timing.spike} cycles", None
        ):
            return True
        if sensor == "potentiometer":
            self.mode, self._agreed = Mode.NOISY_POTENTIOMETER, 0
        return False

    def _still_detail(self, turned_rad: float) -> str:
        return f"code {self._x_code} while the tachometer turned {turned_rad / self._position_lsb:.1f} LSB"

    def _stuck_detail(self) -> str:
        return f"code {self._code} for {self._code_cycles + 1} cycles"
