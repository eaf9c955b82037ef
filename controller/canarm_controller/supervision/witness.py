"""One joint's potentiometer, tachometer and model as three witnesses: two that agree out-vote the third.

Owns the residuals of a joint and which sensor is to blame. Plain floats: `step` runs for every joint in every cycle.
Names of joints and cards, and how the robot is stopped, must not enter.
"""

from enum import Enum

from canarm_protocol.cell import Supervision

from .blind import BlindObserver
from .limits import HIGHEST_CODE, NOISE_MASK, JointLimits, Report
from .noisiness import SPIKE_CYCLES, SPIKES, TURNS, SpikeCount, TurnCount
from .step_trial import StepTrial

BANDWIDTH_RAD_S = 30.0
"""Of the observer of speed and acceleration bias: fast enough for gravity of a wrong payload along a swing (10 rad/s³
leave 10/30² rad/s = 0.6 LSB), slow enough that a step of either shows in full."""
DRIFT_S = 6.0
"""In which the tachometer's offset is learned from the potentiometer; shorter at first."""
MISMATCH_GAIN = 1.0 / 16.0
"""White noise of 0.42 LSB leaves 0.42/sqrt(31) = 0.075 LSB; a step of 3 LSB passes 0.65 LSB in the fourth cycle."""
EARLY_CYCLES, EARLY_FACTOR = 800, 2.3
"""Two seconds in which base and offset of the tachometer are learned, and a wire takes up what the arm carries."""
CALM_CYCLES, UNREST_FACTOR = 100, 2.5
"""After the start, or after the arm has changed, the payload's weight is not known: wider limits of the speed."""
SWINGING_CYCLES = 200
"""Half a second in which an arm that has left its support swings on elastic wires: turns of its speed are no noise."""
BLURRED_CYCLES, LONGEST_GAP_S = 40, 0.1
"""After a measurement whose time is known badly, limits are the wide ones; after a longer gap residuals begin anew."""
GAP_FACTOR = 6.0
"""Of the limit of the speed: over 50 ms friction may have turned its sign, and payload 12 rad/s² too little."""
DOUBT_CYCLES = 400
STUCK_SPEED_LSB, STUCK_CYCLES = 4.5, 8
STUCK_HASTE, STUCK_SURE_CYCLES = 1.45, 24
"""The model's speed must have changed by this while the tachometer's code has not; by more if not for long."""
STUCK_TRAVEL_LSB, STUCK_SUSPECT_LSB, STUCK_SOON_CYCLES = 1.25, 0.5, 6
"""The tachometer must have turned this far while the potentiometer's code has not changed; if it has turned some of the
way and will soon have turned the rest, the verdict waits."""
SLOW_SHARE = 0.35
"""Of a mismatch that was there 16 to 32 cycles ago: then it grows by less than 0.1 rad/s."""
RANGE_CYCLES = 2
PERSISTENT_CYCLES = 4
STEP_SHARE = 0.75
"""Of the limit, that a speed must change by from one cycle to the next to have stepped; else the arm accelerates."""
UNSETTLED_CYCLES = 80
"""If motor and joint part company so soon after an unexpected acceleration, it is what joins them that has broken."""
LEARNING_MASK = 15
"""The rate of learning changes every 16 cycles."""
AGREE_CYCLES = 100
"""A noisy potentiometer is believed again after it has agreed with the tachometer for so long."""
AGREE_AGAIN_CYCLES, AGREE_FACTOR, TOLD_SPEED_LSB = 400, 1.5, 25.0
"""A tachometer is believed again after a second of agreement in which the joint turned both ways: one that lags, or
reads too little, agrees as well while the speed is right by chance."""
BLIND_FACTOR = 2.0
"""With a sensor less, the limits of the other are wider."""


class Mode(Enum):
    """How far the joint's sensors can be trusted."""

    SOUND = 0
    STEP = 1
    """The speed has stepped; nobody knows yet why."""
    NO_TACHOMETER = 2
    NOISY_POTENTIOMETER = 3
    NO_POTENTIOMETER = 4
    BLIND = 5


_SOUND = Mode.SOUND  # an enum's attribute is slow


class JointWitness:
    """Residuals of one joint.

    Speed       v̂' = v̂ + T·(a + b), ν = tachometer - v̂; v̂ += 2ω·T·ν, b += ω²·T·ν (ω = 30 rad/s, critically damped)
    Angle       e = potentiometer - ∫tachometer - base; base and its rate, the tachometer's offset, are learned in 6 s

    a is the nominal model's acceleration under the commanded current, b what it lacks: another payload, friction.
    Noise of 0.3 LSB and rounding leave 0.42 LSB in one reading of either sensor. Measured in fault-free runs of all
    laws with a payload of -50..+50 %: |ν| <= 2.5 LSB, filtered 1.3; |e| <= 1.9 LSB, filtered 0.5.
    """

    __slots__ = (
        "_accel_gain", "_agreed", "_astray_cycles", "_base", "_base_gain", "_blind", "_blurred_until",
        "_calm_at", "_code", "_code_at", "_code_bias", "_code_cycles", "_code_model", "_doubt_until",
        "_fastest", "_half_s", "_last_off", "_last_rad_s", "_learn_from", "_learning_cycles", "_limits",
        "_mismatch", "_new_mismatch", "_offset", "_offset_gain", "_old_mismatch", "_period_s", "_position_lsb",
        "_report", "_settled_at", "_speed_gain", "_speed_lsb", "_spikes", "_stepped", "_stepped_until",
        "_stuck_limit", "_swing", "_told_speed", "_travel", "_trial", "_turns", "_upset_at", "_x_code",
        "_x_travel", "bias", "cycles", "is_agitated", "mode", "model_rad_s", "position_rad", "speed",
        "velocity_rad_s",
    )  # fmt: skip

    def __init__(
        self,
        limits: Supervision,
        position_lsb: float,
        speed_lsb: float,
        tachometer_skew_s: float,
        period_s: float,
        report: Report,
    ) -> None:
        self._report = report
        self._limits = JointLimits(limits, position_lsb, speed_lsb)
        self._position_lsb, self._speed_lsb, self._period_s = position_lsb, speed_lsb, period_s
        self._half_s = 0.5 * period_s - tachometer_skew_s
        self._told_speed = TOLD_SPEED_LSB * speed_lsb
        self._stuck_limit = STUCK_SPEED_LSB * speed_lsb
        self._speed_gain = 2.0 * BANDWIDTH_RAD_S * period_s
        self._accel_gain = BANDWIDTH_RAD_S**2 * period_s
        self._learning_cycles = round(DRIFT_S / period_s)
        self._blind = BlindObserver(period_s)
        self._trial = StepTrial(position_lsb, period_s)
        self.start(0.0)

    def start(self, position_rad: float) -> None:
        """At rest at a measured angle."""
        self.mode = _SOUND
        self._limits.start()
        self._spikes, self._turns = {"potentiometer": SpikeCount(), "tachometer": SpikeCount()}, TurnCount()
        self.cycles = self._learn_from = 0
        self.speed = self.bias = self.model_rad_s = self._last_rad_s = 0.0
        self._travel = self._mismatch = self._swing = self._offset = self._last_off = 0.0
        self._old_mismatch = self._new_mismatch = 0.0
        self._fastest = 0.0, 0.0
        self._base = position_rad
        self._code = self._x_code = -1
        self._code_at = self._code_cycles = self._astray_cycles = self._stepped = self._agreed = 0
        self._code_model = self._code_bias = self._x_travel = 0.0
        self._calm_at = CALM_CYCLES
        self._doubt_until = self._stepped_until = self._blurred_until = -1
        self._settled_at = self._upset_at = -UNSETTLED_CYCLES
        self._set_rate()
        self.is_agitated = False
        """Whether the speed went where the model did not expect it; whoever looks into it sets it back."""
        self.position_rad, self.velocity_rad_s = position_rad, 0.0
        """What to believe where `step` says so."""

    @property
    def is_upset(self) -> bool:
        """Whether its speed has surprised within the last second, the start apart."""
        return self._upset_at > CALM_CYCLES and self.cycles < self._upset_at + DOUBT_CYCLES

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
            self._code_at = count
        else:
            cycles = self._code_cycles = self._code_cycles + 1
            if cycles >= STUCK_CYCLES and count >= self._calm_at:
                moved = model - self._code_model + (count - self._code_at) * period_s * self._code_bias
                limit = self._stuck_limit if cycles >= STUCK_SURE_CYCLES else STUCK_HASTE * self._stuck_limit
                is_stuck = not -limit < moved < limit
        if x_code != self._x_code:
            self._x_code, self._x_travel = x_code, travel
        if self.mode is not _SOUND:
            return self._step_unsound(x, v, acceleration, predicted, v_code)
        astray = x - travel - self._half_s * v - self._base
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
            or not 0 < v_code < HIGHEST_CODE
        ) and self._examine(x, predicted, off, astray, mismatch, swing, is_stuck):
            return True
        if not count & NOISE_MASK:
            limits.learn(astray, mismatch, off - self._last_off)
            if not count & LEARNING_MASK:
                self._set_rate()
                self._old_mismatch, self._new_mismatch = self._new_mismatch, mismatch
        self.speed = predicted + self._speed_gain * off
        self.bias = bias + self._accel_gain * off
        self._swing = swing
        self._last_off = off
        self._last_rad_s = v
        self._travel = travel + period_s * v
        self._mismatch = mismatch
        self._base += period_s * self._offset + self._base_gain * astray
        self._offset += self._offset_gain * astray
        return False

    def coast(self, acceleration: float) -> None:
        """A cycle without a measurement."""
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        self._blind.predict(acceleration)
        self._blurred_until = self.cycles + BLURRED_CYCLES
        self._advance(predicted, predicted)
        self._substitute(self._angle(predicted), predicted)

    def shift(self, excess_s: float, acceleration: float) -> None:
        """The time to the next measurement is `excess_s` longer than a cycle."""
        speed = self._last_rad_s if self.mode is _SOUND else self.speed
        step_rad_s = excess_s * (acceleration + self.bias)
        self._travel += excess_s * (speed + 0.5 * step_rad_s)
        self._base += excess_s * self._offset
        self.speed += step_rad_s
        self.model_rad_s += excess_s * acceleration
        self._blind.shift(excess_s, acceleration)

    def glimpse(self, x: float, v: float, acceleration: float, x_code: int, v_code: int, is_gap: bool) -> bool:
        """As `step`, but when this was measured is known badly: integrate, and judge only what time does not enter.

        `is_gap`: so badly that the residuals begin anew.
        """
        self._blurred_until = self.cycles + BLURRED_CYCLES
        if self.mode is Mode.STEP:
            self.mode = _SOUND  # a verdict needs cycles in a row
        if self.mode is not _SOUND or (v_code == self._code and not is_gap and self._code_cycles >= STUCK_CYCLES):
            return self.step(x, v, acceleration, x_code, v_code)
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        off, limit = v - predicted, GAP_FACTOR * self._limits.step
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        if v_code != self._code:
            self._code, self._code_cycles, self._code_model, self._code_bias = v_code, 0, self.model_rad_s, self.bias
            self._code_at = self.cycles
        else:
            self._code_cycles += 1
        is_believed = is_gap or -limit < off < limit
        v = v if is_believed else predicted
        if is_gap:
            self._base = x - self._travel - self._half_s * v - self._mismatch
        angle = self._angle(v)
        self._last_off = self._swing = 0.0
        self._last_rad_s = v
        self._advance(v, v)
        is_near = abs(x - angle) < BLIND_FACTOR * self._limits.jump
        self._substitute(x if is_near else angle, v)
        return not (is_believed and is_near)

    def settle(self, bias_rad_s2: float) -> None:
        """The acceleration that the model lacked has been looked into."""
        self.bias += bias_rad_s2
        self._swing = 0.0
        self._calm_at = self.cycles + CALM_CYCLES
        self._settled_at = self._upset_at = self.cycles

    def _set_rate(self) -> None:
        """How fast base and offset of the tachometer are learned, critically damped; faster at first."""
        cycles = self.cycles - self._learn_from
        rate = 2.0 / (DRIFT_S if cycles > self._learning_cycles else (cycles + 20) * self._period_s)
        self._base_gain = 2.0 * rate * self._period_s
        self._offset_gain = rate**2 * self._period_s

    def _examine(
        self, x: float, predicted: float, off: float, astray: float, mismatch: float, swing: float, is_stuck: bool
    ) -> bool:
        """Something is unusual. True if this cycle's measurement must not be learned from."""
        limits, count = self._limits, self.cycles
        if self._judge_angle(x, predicted, off, astray):
            return True
        if self._code in (0, HIGHEST_CODE) and abs(off) < limits.step * UNREST_FACTOR:
            # As fast as that, and perhaps faster: nothing can be told from it.
            self._base = x - self._travel - self._half_s * predicted - self._mismatch
            self._last_off = self._swing = 0.0
            self._advance(predicted, predicted)
            return self._substitute(x, predicted)
        if is_stuck and self._report("tachometer-stuck", self._stuck_detail(), None):
            return self._lose_tachometer(x, predicted)
        is_doubtful = not -limits.doubt < off < limits.doubt
        turns = is_doubtful and count > SWINGING_CYCLES and self._turns.is_too_many(count, off)
        if turns and self._report("sensor-noise", f"tachometer: {TURNS} turns", None):
            return self._lose_tachometer(x, predicted)
        factor = UNREST_FACTOR if count < self._calm_at or count < self._blurred_until else 1.0
        step = limits.step * factor
        if not -step < off < step:
            self.is_agitated = True
            if abs(off - self._last_off) >= STEP_SHARE * step:
                self.mode = Mode.STEP
                self._trial.begin(off)
                self._advance(predicted, predicted)
                return self._substitute(x, predicted)
        if is_doubtful:
            self._doubt_until = count + DOUBT_CYCLES
        if not -limits.swing * factor < swing < limits.swing * factor:
            self.is_agitated = True
        is_wide = count < max(self._stepped_until, self._blurred_until)
        drift = limits.drift * (EARLY_FACTOR if is_wide or count < self._learn_from + EARLY_CYCLES else 1.0)
        return not -drift < mismatch < drift and self._judge_mismatch(x, predicted, mismatch)

    def _judge_angle(self, x: float, predicted: float, off: float, astray: float) -> bool:
        """The potentiometer against the integrated tachometer in one cycle: no tachometer is that fast wrong."""
        if -self._limits.jump < astray < self._limits.jump:
            if self._astray_cycles:
                self._astray_cycles = 0
                self._spike("potentiometer")
            return False
        self._astray_cycles += 1
        if self._astray_cycles >= PERSISTENT_CYCLES:
            at_end = self._x_code in (0, HIGHEST_CODE)
            name = "potentiometer-range" if at_end else "potentiometer-jump"
            if self._report(name, f"code {self._x_code}" if at_end else self._angle_detail(astray), None):
                self.mode = Mode.NO_POTENTIOMETER
        self._advance(predicted + self._speed_gain * off, predicted + off)
        self.bias += self._accel_gain * off
        return self._substitute(x - astray, predicted + off)

    def _judge_mismatch(self, x: float, predicted: float, mismatch: float) -> bool:
        """Potentiometer and integrated tachometer have drifted apart."""
        detail = self._angle_detail(mismatch)
        lsb = self._position_lsb
        turned = abs(self._travel - self._x_travel)
        soon = turned + STUCK_SOON_CYCLES * self._period_s * abs(predicted)
        if self.cycles < self._settled_at + UNSETTLED_CYCLES:
            name = "drive-broken"
        elif self.cycles < self._stepped_until:
            name = "tachometer-mismatch"
        elif turned > STUCK_TRAVEL_LSB * lsb:
            detail = f"code {self._x_code} while the tachometer turned {turned / lsb:.1f} LSB"
            name = "potentiometer-stuck"
        elif turned > STUCK_SUSPECT_LSB * lsb and soon > STUCK_TRAVEL_LSB * lsb:
            return False
        elif self.cycles < self._doubt_until or self._code_cycles >= STUCK_CYCLES:
            name = "tachometer-mismatch"
        else:
            name = "potentiometer-mismatch"
            if self._old_mismatch * mismatch > SLOW_SHARE * mismatch * mismatch:
                # Either may drift; a potentiometer that slow still holds the arm, a tachometer soon does not.
                return self._report(name, f"{detail}, slowly", None) and self._lose_tachometer(x, predicted)
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
        trial, off, limits = self._trial, v - predicted, self._limits
        step = trial.step_rad_s
        trial.take(off, x - self._angle(predicted) - self._mismatch)
        if abs(off) < max(0.4 * abs(step), limits.doubt):
            self.mode = _SOUND
            if not self._spike("tachometer"):
                return self._lose_tachometer(x, predicted)
        elif off * step < 0.0 and self._report("sensor-noise", "tachometer: one way, then the other", None):
            return self._lose_tachometer(x, predicted)
        elif v_code in (0, HIGHEST_CODE) and trial.cycles >= RANGE_CYCLES - 1:
            if self.cycles < self._settled_at + UNSETTLED_CYCLES:
                self._report("overspeed", f"tachometer at code {v_code}", None)
                return self._believe_step(v)
            if self._report("tachometer-range", f"code {v_code}", None):
                return self._lose_tachometer(x, predicted)
        elif off * step > 0.0 and trial.cycles >= 2 and abs(off) > 1.6 * abs(step) + limits.doubt:
            return self._believe_step(v)
        elif trial.is_ready:
            is_stuck = self._code_cycles >= STUCK_CYCLES - 1
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
        """It was the arm."""
        self.mode = _SOUND
        self._travel += self._trial.led_rad
        self._swing = 0.0
        self.speed = self._last_rad_s = v
        self._stepped_until = self.cycles + DOUBT_CYCLES
        self._upset_at = self.cycles
        self.is_agitated = True
        self._calm_at = self.cycles + CALM_CYCLES
        return False

    def _spike(self, sensor: str) -> bool:
        """One reading was wrong. False if there were so many that the sensor is given up."""
        self.is_agitated = False
        if not self._spikes[sensor].is_too_many(self.cycles):
            self._report(f"{sensor}-spike", "one reading rejected", None)
            return True
        if not self._report("sensor-noise", f"{sensor}: {SPIKES} readings rejected within {SPIKE_CYCLES} cycles", None):
            return True
        if sensor == "potentiometer":
            self.mode, self._agreed = Mode.NOISY_POTENTIOMETER, 0
        return False

    def _lose_tachometer(self, x: float, speed: float) -> bool:
        self._upset_at = self.cycles
        self.mode, self._agreed = Mode.NO_TACHOMETER, 0
        self._blind.start(self._angle(speed), speed, self.bias)
        self._blind.correct(x)
        self._fastest = 0.0, 0.0
        return self._substitute(x, self._blind.velocity_rad_s)

    def _without_tachometer(self, x: float, v: float, acceleration: float) -> bool:
        """Speed from potentiometer and model, until the tachometer has agreed with it for long, both ways."""
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
        if abs(v - self.speed) > AGREE_FACTOR * self._limits.step or self._code_cycles > STUCK_SURE_CYCLES:
            self._agreed, self._fastest = 0, (0.0, 0.0)
        else:
            low, high = self._fastest
            self._agreed, self._fastest = self._agreed + 1, (min(low, self.speed), max(high, self.speed))
            if self._agreed >= AGREE_AGAIN_CYCLES and low < -self._told_speed and high > self._told_speed:
                self._believe_tachometer(x, v)
        return self._substitute(x, blind.velocity_rad_s)

    def _believe_tachometer(self, x: float, v: float) -> None:
        self.mode, self.speed, self._last_rad_s = _SOUND, v, v
        self._mismatch = self._swing = self._last_off = 0.0
        self._base = x - self._travel - self._half_s * v
        self._learn_from = self.cycles
        self._set_rate()
        self._calm_at = self.cycles + CALM_CYCLES

    def _without_potentiometer(self, x: float, v: float, predicted: float) -> bool:
        """Angle from the integrated tachometer; a noisy potentiometer may still lead it, slowly."""
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
        """What a noisy potentiometer still tells: where the angle is on average."""
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
        elif self._agreed >= AGREE_CYCLES:
            self.mode, self._mismatch = _SOUND, 0.0

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

    def _stuck_detail(self) -> str:
        return f"code {self._code} for {self._code_cycles + 1} cycles"

    def _angle_detail(self, astray_rad: float) -> str:
        return f"{astray_rad / self._position_lsb:+.1f} LSB from the integrated tachometer"
