"""One joint's potentiometer, tachometer and model as three witnesses: two that agree out-vote the third.

Owns the residuals of a joint and which sensor is to blame. Plain floats: `step` runs for every joint in every cycle.
Names of joints and cards, and how the robot is stopped, must not enter.
"""

from collections.abc import Callable
from enum import Enum

from canarm_protocol.cell import Supervision

from .blind import BlindObserver
from .detection import Reaction

Report = Callable[[str, str, Reaction | None], bool]
"""Detector, detail and, where it is not the table's, the reaction. False if that detector is switched off."""

BANDWIDTH_RAD_S = 30.0
"""Of the observer of speed and acceleration bias: fast enough for gravity of a wrong payload along a swing (10 rad/s³
leave 10/30² rad/s = 0.6 LSB), slow enough that a step of either shows in full."""
DRIFT_S = 6.0
"""In which the tachometer's offset is learned from the potentiometer; shorter at first."""
CALM_CYCLES, UNREST_FACTOR = 100, 2.5
"""After the start, or after the arm has changed, the payload's weight is not known: wider limits of the speed."""
DOUBT_LSB, DOUBT_CYCLES = 2.7, 400
"""A speed off by this is no fault, but remembered for a second: a payload of ±50 % leaves 2.2."""
STUCK_SPEED_LSB, STUCK_CYCLES = 4.5, 8
STUCK_HASTE, STUCK_SURE_CYCLES = 1.45, 24
"""The model's speed must have changed by this while the tachometer's code has not; by more if not for long."""
STUCK_TRAVEL_LSB = 0.9
"""The tachometer must have turned this far while the potentiometer's code has not changed."""
JUDGED_CYCLES = 9
"""After a step of the speed, so long until it is decided whether arm or tachometer made it: 22.5 ms."""
SMALLEST_LEAD_LSB, ARM_SHARE = 0.5, 0.65
"""A step that would have moved the angle by less than half a step of the potentiometer is taken for the tachometer's;
of others, this share must be seen there. With 0.42 LSB of noise a step of 1 rad/s is judged to 0.15."""
RANGE_CYCLES = 2
PERSISTENT_CYCLES = 4
STEP_SHARE = 0.75
"""Of the limit, that a speed must change by from one cycle to the next to have stepped; else the arm accelerates."""
UNSETTLED_CYCLES = 80
"""If motor and joint part company so soon after an unexpected acceleration, it is what joins them that has broken."""
SPIKES, SPIKE_CYCLES = 3, 80
TURNS, TURN_CYCLES = 3, 40
"""A doubtful speed that turns to the other side so often, each time within 0.1 s."""
LEARNING_MASK = 15
"""The rate of learning changes every 16 cycles."""
AGREE_CYCLES = 100
"""A sensor that has failed is believed again after it has agreed with the others for so long."""
BLIND_FACTOR = 2.0
"""With a sensor less, the limits of the other are wider."""
HIGHEST_CODE = 255


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
    laws with a payload of -50..+50 %: |ν| <= 2.2 LSB, filtered 1.3; |e| <= 1.7 LSB, filtered 0.6.
    """

    __slots__ = (
        "_accel_gain", "_agreed", "_astray_cycles", "_base", "_base_gain", "_blind", "_calm_at", "_code",
        "_code_bias", "_code_cycles", "_code_model", "_doubt_limit", "_doubt_until", "_drift_limit",
        "_followed_rad2", "_half_s", "_jump_limit", "_last_off", "_learn_from", "_learning_cycles", "_misled_rad",
        "_misled_rad2", "_mismatch", "_offset", "_offset_gain", "_period_s", "_position_lsb", "_report",
        "_settled_at", "_speed_gain", "_speed_lsb", "_spikes", "_spikes_until", "_step_limit", "_step_rad_s",
        "_stepped", "_stepped_until", "_stuck_limit", "_swing", "_swing_limit", "_travel", "_turned_at",
        "_turned_off", "_turns", "_upset_at", "_x_code", "_x_travel", "bias", "cycles", "is_agitated", "mode",
        "model_rad_s", "position_rad", "speed", "velocity_rad_s",
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
        self._position_lsb, self._speed_lsb, self._period_s = position_lsb, speed_lsb, period_s
        self._half_s = 0.5 * period_s - tachometer_skew_s
        self._jump_limit = limits.position_jump_lsb * position_lsb
        self._drift_limit = limits.position_drift_lsb * position_lsb
        self._step_limit = limits.speed_jump_lsb * speed_lsb
        self._swing_limit = limits.speed_drift_lsb * speed_lsb
        self._doubt_limit = min(DOUBT_LSB, limits.speed_jump_lsb) * speed_lsb
        self._stuck_limit = STUCK_SPEED_LSB * speed_lsb
        self._speed_gain = 2.0 * BANDWIDTH_RAD_S * period_s
        self._accel_gain = BANDWIDTH_RAD_S**2 * period_s
        self._learning_cycles = round(DRIFT_S / period_s)
        self._blind = BlindObserver(period_s)
        self.start(0.0)

    def start(self, position_rad: float) -> None:
        """At rest at a measured angle."""
        self.mode = _SOUND
        self.cycles = self._learn_from = 0
        self.speed = self.bias = self.model_rad_s = 0.0
        self._travel = self._mismatch = self._swing = self._offset = self._misled_rad = self._step_rad_s = 0.0
        self._base = position_rad
        self._code = self._x_code = -1
        self._code_cycles = self._spikes = self._astray_cycles = self._stepped = self._agreed = 0
        self._code_model = self._code_bias = self._x_travel = 0.0
        self._calm_at = CALM_CYCLES
        self._doubt_until = self._spikes_until = self._stepped_until = -1
        self._followed_rad2 = self._misled_rad2 = self._last_off = 0.0
        self._turned_at, self._turned_off, self._turns = -TURN_CYCLES, 0.0, 0
        self._settled_at = self._upset_at = -UNSETTLED_CYCLES
        self._set_rate()
        self.is_agitated = False
        """Whether the speed went where the model did not expect it; whoever looks into it sets it back."""
        self.position_rad, self.velocity_rad_s = position_rad, 0.0
        """What to believe where `step` says so."""

    def step(self, x: float, v: float, acceleration: float, x_code: int, v_code: int) -> bool:
        """Take one cycle: angle, speed, and the model's acceleration since the last one (rad, rad/s, rad/s²).

        Returns True where `position_rad` and `velocity_rad_s` are to be taken instead of the measurement.
        """
        period_s = self._period_s
        self.cycles += 1
        model = self.model_rad_s = self.model_rad_s + period_s * acceleration
        bias, travel = self.bias, self._travel
        predicted = self.speed + period_s * (acceleration + bias)
        off = v - predicted
        is_stuck = False
        if v_code != self._code:
            self._code, self._code_cycles, self._code_model, self._code_bias = v_code, 0, model, bias
        else:
            cycles = self._code_cycles = self._code_cycles + 1
            if cycles >= STUCK_CYCLES and self.cycles >= self._calm_at:
                moved = model - self._code_model + cycles * period_s * self._code_bias
                limit = self._stuck_limit if cycles >= STUCK_SURE_CYCLES else STUCK_HASTE * self._stuck_limit
                is_stuck = not -limit < moved < limit
        if x_code != self._x_code:
            self._x_code, self._x_travel = x_code, travel
        if self.mode is not _SOUND:
            return self._step_unsound(x, v, acceleration, predicted, x_code, v_code)
        astray = x - travel - self._half_s * v - self._base
        mismatch = self._mismatch
        mismatch += (astray - mismatch) * 0.125
        swing = self._swing
        swing += (off - swing) * 0.125
        limit, drift, doubt, swing_limit = self._jump_limit, self._drift_limit, self._doubt_limit, self._swing_limit
        if (
            is_stuck
            or not -limit < astray < limit
            or not -drift < mismatch < drift
            or not -doubt < off < doubt
            or not -swing_limit < swing < swing_limit
            or self._astray_cycles
            or not 0 < v_code < HIGHEST_CODE
        ) and self._examine(x, predicted, off, astray, mismatch, swing, is_stuck):
            return True
        self.speed = predicted + self._speed_gain * off
        self.bias = bias + self._accel_gain * off
        self._swing = swing
        self._last_off = off
        self._travel = travel + period_s * v
        self._mismatch = mismatch
        if not self.cycles & LEARNING_MASK:
            self._set_rate()
        self._base += period_s * self._offset + self._base_gain * astray
        self._offset += self._offset_gain * astray
        return False

    def coast(self, acceleration: float) -> None:
        """A cycle without a measurement."""
        self.cycles += 1
        self.model_rad_s += self._period_s * acceleration
        predicted = self.speed + self._period_s * (acceleration + self.bias)
        self._blind.predict(acceleration)
        self._code_cycles = 0
        self._advance(predicted, predicted)
        self._substitute(self._angle(predicted), predicted)

    def resume(self, x: float, v: float) -> None:
        """A cycle after a gap of unknown length."""
        if self.mode is _SOUND:
            self.speed = v
            self._base = x - self._travel - self._half_s * v - self._mismatch
            self._travel += self._period_s * v
        elif self.mode is Mode.STEP:
            self._believe_step(v)
        self._last_off = self._swing = 0.0
        self._code_cycles = 0

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
        if self._judge_angle(x, predicted, off, astray):
            return True
        if self._code in (0, HIGHEST_CODE) and abs(off) < self._step_limit * UNREST_FACTOR:
            self.resume(x, predicted)  # as fast as that, and perhaps faster: nothing can be told from it
            return self._substitute(x, predicted)
        if is_stuck and self._report("tachometer-stuck", self._stuck_detail(), None):
            return self._lose_tachometer(x, predicted)
        if not -self._doubt_limit < off < self._doubt_limit and self._is_noisy(off):
            return self._lose_tachometer(x, predicted)
        factor = UNREST_FACTOR if self.cycles < self._calm_at else 1.0
        limit = self._step_limit * factor
        if not -limit < off < limit and abs(off - self._last_off) < STEP_SHARE * limit:
            self.is_agitated = True
        elif not -limit < off < limit:
            self.mode, self._stepped, self._step_rad_s = Mode.STEP, 0, off
            self._misled_rad = self._period_s * off
            self._misled_rad2 = self._followed_rad2 = 0.0
            self.is_agitated = True
            self._advance(predicted, predicted)
            return self._substitute(x, predicted)
        if not -self._doubt_limit < off < self._doubt_limit:
            self._doubt_until = self.cycles + DOUBT_CYCLES
        limit = self._swing_limit * factor
        if not -limit < swing < limit:
            self.is_agitated = True
        if not -self._drift_limit < mismatch < self._drift_limit:
            return self._judge_mismatch(x, predicted, mismatch)
        return False

    def _judge_angle(self, x: float, predicted: float, off: float, astray: float) -> bool:
        """The potentiometer against the integrated tachometer in one cycle: no tachometer is that fast wrong."""
        if -self._jump_limit < astray < self._jump_limit:
            if self._astray_cycles:
                self._astray_cycles = 0
                self._spike("potentiometer")
            return False
        self._astray_cycles += 1
        speed = predicted + self._speed_gain * off
        angle = x - astray
        if self._astray_cycles >= PERSISTENT_CYCLES:
            at_end = self._x_code in (0, HIGHEST_CODE)
            name = "potentiometer-range" if at_end else "potentiometer-jump"
            detail = f"code {self._x_code}" if at_end else self._angle_detail(astray)
            if self._report(name, detail, None):
                self.mode = Mode.NO_POTENTIOMETER
        self._advance(speed, predicted + off)
        self.bias += self._accel_gain * off
        return self._substitute(angle, predicted + off)

    def _is_noisy(self, off: float) -> bool:
        """Whether the speed strays to one side and the other: an arm cannot, and a fault of another kind does not."""
        if self.cycles > self._turned_at + TURN_CYCLES:
            self._turns = 0
        elif off * self._turned_off < 0.0:
            self._turns += 1
        self._turned_at, self._turned_off = self.cycles, off
        return self._turns >= TURNS and self._report("sensor-noise", f"tachometer: {TURNS} turns", None)

    def _judge_mismatch(self, x: float, predicted: float, mismatch: float) -> bool:
        """Potentiometer and integrated tachometer have drifted apart."""
        detail = self._angle_detail(mismatch)
        turned = self._travel - self._x_travel
        if self.cycles < self._settled_at + UNSETTLED_CYCLES:
            name = "drive-broken"
        elif self.cycles < self._stepped_until:
            name = "tachometer-mismatch"
        elif abs(turned) > STUCK_TRAVEL_LSB * self._position_lsb:
            detail = f"code {self._x_code} while the tachometer turned {turned / self._position_lsb:.1f} LSB"
            name = "potentiometer-stuck"
        elif self.cycles < self._doubt_until or self._code_cycles >= STUCK_CYCLES:
            name = "tachometer-mismatch"
        else:
            name = "potentiometer-mismatch"
        if not self._report(name, detail, None):
            return False
        if name == "tachometer-mismatch":
            return self._lose_tachometer(x, predicted)
        self.mode = Mode.NO_POTENTIOMETER
        self._advance(predicted, predicted)
        return self._substitute(x - mismatch, predicted)

    def _step_unsound(
        self, x: float, v: float, acceleration: float, predicted: float, x_code: int, v_code: int
    ) -> bool:
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
        self._stepped += 1
        off, step = v - predicted, self._step_rad_s
        self._misled_rad += self._period_s * off
        angle = self._angle(predicted)
        led = self._misled_rad
        self._followed_rad2 += led * (x - angle - self._mismatch)
        self._misled_rad2 += led * led
        if abs(off) < max(0.4 * abs(step), self._doubt_limit):
            self.mode = _SOUND
            if not self._spike("tachometer"):
                return self._lose_tachometer(x, predicted)
        elif off * step < 0.0 and self._report("sensor-noise", "tachometer: one way, then the other", None):
            return self._lose_tachometer(x, predicted)
        elif v_code in (0, HIGHEST_CODE) and self._stepped >= RANGE_CYCLES - 1:
            if self.cycles < self._settled_at + UNSETTLED_CYCLES:
                self._report("overspeed", f"tachometer at code {v_code}", None)
                return self._believe_step(v)
            if self._report("tachometer-range", f"code {v_code}", None):
                return self._lose_tachometer(x, predicted)
        elif off * step > 0.0 and self._stepped >= 2 and abs(off) > 1.6 * abs(step) + self._doubt_limit:
            return self._believe_step(v)
        elif self._stepped >= JUDGED_CYCLES:
            # Had the arm stepped, the angle would have gone with it. Least squares: 1 for the arm, 0 for the sensor.
            is_stuck = self._code_cycles >= STUCK_CYCLES - 1
            is_telling = abs(self._misled_rad) > SMALLEST_LEAD_LSB * self._position_lsb
            if is_telling and not is_stuck and self._followed_rad2 > ARM_SHARE * self._misled_rad2:
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
        self._travel += self._misled_rad
        self._swing = 0.0
        self.speed = v
        self._stepped_until = self.cycles + DOUBT_CYCLES
        self._upset_at = self.cycles
        self.is_agitated = True
        self._calm_at = self.cycles + CALM_CYCLES
        return False

    def _spike(self, sensor: str) -> bool:
        """One reading was wrong. False if there were so many that the sensor is given up."""
        if self.cycles > self._spikes_until:
            self._spikes = 0
        self._spikes += 1
        self._spikes_until = self.cycles + SPIKE_CYCLES
        self.is_agitated = False
        if self._spikes < SPIKES:
            self._report(f"{sensor}-spike", "one reading rejected", None)
            return True
        if not self._report("sensor-noise", f"{sensor}: {SPIKES} readings rejected within {SPIKE_CYCLES} cycles", None):
            return True
        if sensor == "potentiometer":
            self.mode = Mode.NOISY_POTENTIOMETER
        return False

    @property
    def is_upset(self) -> bool:
        """Whether its speed has surprised within the last second, the start apart."""
        return self._upset_at > CALM_CYCLES and self.cycles < self._upset_at + DOUBT_CYCLES

    def _lose_tachometer(self, x: float, speed: float) -> bool:
        self._upset_at = self.cycles
        self.mode, self._agreed = Mode.NO_TACHOMETER, 0
        self._blind.start(self._angle(speed), speed, self.bias)
        self._blind.correct(x)
        return self._substitute(x, self._blind.velocity_rad_s)

    def _without_tachometer(self, x: float, v: float, acceleration: float) -> bool:
        """Speed from potentiometer and model, until the tachometer agrees with it again."""
        blind = self._blind
        blind.predict(acceleration)
        off = x - blind.position_rad
        if abs(off) > BLIND_FACTOR * self._jump_limit:
            self._astray_cycles += 1
            if self._astray_cycles >= PERSISTENT_CYCLES and self._report("both-sensors", "no speed, no angle", None):
                self.mode = Mode.BLIND
        else:
            self._astray_cycles = 0
            blind.correct(x)
        self.speed, self.bias = blind.velocity_rad_s, blind.bias
        agrees = abs(v - self.speed) < self._step_limit * UNREST_FACTOR and self._code_cycles < AGREE_CYCLES // 2
        self._agreed = self._agreed + 1 if agrees else 0
        if self._agreed >= AGREE_CYCLES:
            self.mode, self.speed = _SOUND, v
            self._mismatch = self._swing = 0.0
            self._base = x - self._travel - self._half_s * v
            self._learn_from = self.cycles
            self._set_rate()
            self._calm_at = self.cycles + CALM_CYCLES
        return self._substitute(x, blind.velocity_rad_s)

    def _without_potentiometer(self, x: float, v: float, predicted: float) -> bool:
        """Angle from the integrated tachometer; a noisy potentiometer may still lead it, slowly."""
        off = v - predicted
        if abs(off) > BLIND_FACTOR * self._step_limit:
            self._stepped += 1
            if self._stepped >= PERSISTENT_CYCLES and self._report("both-sensors", "no angle, no speed", None):
                self.mode = Mode.BLIND
            v, off = predicted, 0.0
        else:
            self._stepped = 0
        astray = x - self._angle(v)
        if self.mode is Mode.NOISY_POTENTIOMETER:
            limit = self._jump_limit
            bounded = max(-limit, min(limit, astray))
            self._base += self._base_gain * bounded
            self._mismatch += (bounded - self._mismatch) * 0.03
            self._agreed = self._agreed + 1 if abs(astray) < 0.6 * limit else 0
            if abs(self._mismatch) > 2.0 * self._drift_limit and self._report(
                "potentiometer-mismatch", self._angle_detail(self._mismatch), None
            ):
                self.mode = Mode.NO_POTENTIOMETER
            elif self._agreed >= AGREE_CYCLES:
                self.mode, self._mismatch, self._agreed = _SOUND, 0.0, 0
        self._advance(predicted + self._speed_gain * off, v)
        self.bias += self._accel_gain * off
        return self._substitute(self._angle(v), v)

    def _angle(self, v: float) -> float:
        return self._travel + self._half_s * v + self._base

    def _advance(self, speed: float, turned_rad_s: float) -> None:
        """On to the next cycle at the speed that is believed."""
        self.speed = speed
        self._travel += self._period_s * turned_rad_s
        self._base += self._period_s * self._offset

    def _substitute(self, position_rad: float, velocity_rad_s: float) -> bool:
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s
        return True

    def _stuck_detail(self) -> str:
        return f"code {self._code} for {self._code_cycles + 1} cycles"

    def _angle_detail(self, astray_rad: float) -> str:
        return f"{astray_rad / self._position_lsb:+.1f} LSB from the integrated tachometer"
