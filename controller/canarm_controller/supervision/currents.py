"""Compares measured and commanded current of one joint: has the amplifier failed, or its sense?

Owns the winding's lag and the vote of the arm's acceleration; motion sensors are not used here.
"""

import math

from .detection import Reaction
from .limits import Report
from .nominal import JointNominal, SensorNominal
from .thresholds import Thresholds, observer_bandwidth_rad_s
from .timing import Timing
from .vote import ACTS_SHARE, Ballot

STEP_FRACTION = 0.2
"""Extra tolerance, as a share of a command change: the time constant is known to about a quarter, e^-0.8 to 0.09, and
the code of the DAC is rounded."""
FLUTTER_GAIN = 0.25
"""Changes of the difference between readings are averaged over about four."""
NOTED_CYCLES, NOTED_FACTOR = 8, 2.0
"""A difference is reported after so many cycles at this factor of the limit, which is a fault's floor, or more; a
smaller one in proportion later: the arm has so long to tell amplifier and sense apart."""
TOLD_READINGS = 2, 3
"""Readings that must differ before the drive is accused, or the sense: what one shows may have lasted for a part of a
cycle only, or be a current that turns."""
BRIEF_CYCLES, FLUTTER_NOTED_CYCLES, FLUTTER_CYCLES, CALMING = 3, 20, 24, 0.25
"""Cycles of a current that does not follow: a brief one is reported once it is over, a lasting one before, and unless
the sense proves to be the cause, torque is switched off."""
UNEXPLAINED_SHARE, UNEXPLAINED_CYCLES = 1.2, 16
"""Share of the limit, and cycles: a difference this large and long, not blamed on the sense, switches torque off; in
half that time if it flutters by half the flutter limit, as no offset or gain error does."""
WORTH_MENTION = math.log(3.0)
"""Logarithm of a likelihood ratio below which evidence is "not worth more than a bare mention": Kass and Raftery, Bayes
factors, J. Am. Stat. Assoc. 90 (1995) 773. Who cannot be told from its sense stays the drive."""
FASTEST_SHARE = 0.98
"""Share of the tachometer's range beyond which the back-EMF is unknown."""
SUPPLY_SHARE = 0.85
"""Share of the current that the supply can drive against the back-EMF: near it, the amplifier may not follow."""


class CurrentWatch:
    """One joint: the sense gives |i| at its own time after SYNC; the command acts at SYNC, through the winding.

    Two ways to differ: by what moves the joint visibly (`current_mismatch_a` at most), or by a difference that
    flutters, as it does when the current follows an old command or noise. Then the arm votes, by the speed that the
    difference causes if it is the amplifier's. What had built up before has been learned as acceleration bias already,
    as fast as `_slow_a` follows it; only what has come since is due.
    """

    __slots__ = (
        "_amperes",
        "_ballot",
        "_base_a",
        "_beyond_cycles",
        "_bias",
        "_code",
        "_command_a",
        "_deficit_nm_s",
        "_detail",
        "_doubt",
        "_emf_v",
        "_end_codes",
        "_fastest_rad_s",
        "_flutter_a",
        "_flutter_cycles",
        "_flutter_limit_a",
        "_full_a",
        "_haste",
        "_is_noted",
        "_last_off_a",
        "_learned_a",
        "_limit_a",
        "_model",
        "_moving_a",
        "_ohm",
        "_period_s",
        "_pushed_nm",
        "_readings",
        "_report",
        "_shown_a",
        "_shown_doubt_a",
        "_shown_readings",
        "_slow_a",
        "_slow_gain",
        "_speed",
        "_step_a",
        "_supply_v",
        "_unexplained_cycles",
        "_weight",
        "cycles",
        "is_given_up",
    )  # fmt: skip

    def __init__(
        self, joint: JointNominal, sense: SensorNominal, limits: Thresholds, timing: Timing, report: Report
    ) -> None:
        self._report = report
        self._step_a, self._end_codes = sense.step, sense.end_codes
        self._limit_a, self._flutter_limit_a = limits.current, limits.flutter
        self._moving_a = limits.moving_current
        self._full_a = NOTED_FACTOR * limits.current
        self._weight = math.exp(-sense.skew_s / joint.winding_s)
        self._supply_v, self._ohm = joint.supply_v, joint.winding_ohm / SUPPLY_SHARE
        self._emf_v = joint.back_emf_v_s_rad
        self._fastest_rad_s = FASTEST_SHARE * joint.fastest_rad_s
        self._amperes = 1.0 / joint.torque_per_ampere
        self._period_s = timing.period_s
        self.cycles = 0
        """Number of cycles in which measurement and command have differed."""
        self.is_given_up = False
        """Whether the sense was found wrong, and is ignored."""
        self._ballot = Ballot(limits.speed_grain, timing.window)
        self._slow_gain = timing.period_s * observer_bandwidth_rad_s(timing.period_s)
        self._slow_a = self._learned_a = 0.0
        self._unexplained_cycles = self._readings = 0
        self._beyond_cycles = self._haste = self._flutter_cycles = self._pushed_nm = 0.0
        self._is_noted, self._detail = False, ""
        self._flutter_a = self._last_off_a = self._deficit_nm_s = self._command_a = 0.0
        self._speed = self._model = self._bias = 0.0
        self._code = 0
        self._doubt = 0.0, math.inf
        self._shown_a = self._shown_doubt_a = self._base_a = 0.0
        self._shown_readings = 0

    def differs(self, code: int, command_nm: float, flowing_nm: float, speed_rad_s: float) -> float:
        """Measured minus expected current, A; 0 within the limits. `flowing_nm` is the current's torque at SYNC."""
        command_a = command_nm * self._amperes
        change_a = flowing_nm * self._amperes - command_a
        expected_a = command_a + self._weight * change_a
        if expected_a < 0.0:
            expected_a = -expected_a
        off_a = code * self._step_a - expected_a
        allowed_a = STEP_FRACTION * (change_a if change_a > 0.0 else -change_a)
        since_a = off_a - self._base_a
        self._shown_a += since_a if command_a > 0.0 else -since_a
        self._shown_doubt_a += allowed_a
        self._shown_readings += 1
        change_off_a, self._last_off_a = off_a - self._last_off_a, off_a
        flutter_a = self._flutter_a
        flutter_a += FLUTTER_GAIN * ((change_off_a if change_off_a > 0.0 else -change_off_a) - allowed_a - flutter_a)
        self._flutter_a = flutter_a
        slow_a = self._slow_a
        self._slow_a = slow_a + self._slow_gain * (off_a - slow_a)
        limit_a = self._moving_a + allowed_a
        is_within = -limit_a < off_a < limit_a
        if is_within and flutter_a < (0.5 * self._flutter_limit_a if self.cycles else self._flutter_limit_a):
            if self.cycles and self._beyond_cycles and self._flutter_cycles >= BRIEF_CYCLES:
                self._note()
            self.cycles = 0
            if self._flutter_cycles:
                self._flutter_cycles = max(self._flutter_cycles - CALMING, 0.0)
            return 0.0
        along_rad_s = speed_rad_s if command_a > 0.0 else -speed_rad_s
        is_short = expected_a > (self._supply_v - self._emf_v * along_rad_s) / self._ohm
        is_unknown = not -self._fastest_rad_s < speed_rad_s < self._fastest_rad_s
        if self.is_given_up or is_unknown or (off_a < 0.0 and is_short):
            self._flutter_a = 0.0
            return 0.0
        if not self.cycles:
            self._learned_a = slow_a
        self._code, self._command_a = code, command_a
        return off_a

    def mark(self) -> None:
        """The arm's acceleration is taken from now on. What differs already, its model has learned by and by."""
        self._base_a = self._slow_a
        self._shown_a = self._shown_doubt_a = 0.0
        self._shown_readings = 0

    def shows(self, missing_nm: float) -> bool:
        """Whether the currents since `mark` have differed by what the arm misses, N·m: two witnesses of one failure."""
        readings = self._shown_readings
        if self.is_given_up or not readings:
            return False
        shown_a, missing_a = self._shown_a / readings, missing_nm * self._amperes
        if abs(shown_a) < self._flutter_limit_a + self._shown_doubt_a / readings:
            return False
        return ACTS_SHARE < missing_a / shown_a < 1.0 / ACTS_SHARE

    def forget(self) -> None:
        """Start over after a cycle of unknown length."""
        self.cycles, self._flutter_a = 0, 0.0
        self._ballot.clear()

    def judge(
        self, off_a: float, speed_rad_s: float, model_rad_s: float, bias_rad_s2: float, mobility: float,
        doubt_rad_s2: float, noisiness: float,
    ) -> None:  # fmt: skip
        """Judge a difference by the joint's speed, ∫model, acceleration bias and mobility (rad/s² per N·m).

        `doubt_rad_s2` is what the model may be off by for other reasons; `noisiness` as in `Ballot.verdict`.
        """
        command_a = self._command_a
        self.cycles += 1
        detail = f"{off_a:+.2f} A from the {command_a:+.2f} A commanded"
        sign = 1.0 if command_a >= 0.0 else -1.0
        pushed_nm, self._pushed_nm = self._pushed_nm, sign * (off_a - self._learned_a) / self._amperes
        if self.cycles == 1:
            self._speed, self._model, self._bias, self._deficit_nm_s = speed_rad_s, model_rad_s, bias_rad_s2, 0.0
            self._unexplained_cycles, self._is_noted = 0, False
            self._beyond_cycles = self._haste = 0.0
            self._readings, self._detail = 0, detail
            self._ballot.open_window()
            self._ballot.cast(0.0, 0.0, 0.0)
            self._judge_lasting(off_a, detail)
            return
        self._deficit_nm_s += self._period_s * pushed_nm
        due = self._deficit_nm_s * mobility
        elapsed_s = (self.cycles - 1) * self._period_s
        unexplained = speed_rad_s - self._speed - (model_rad_s - self._model) - elapsed_s * self._bias
        self._ballot.cast(due, unexplained, elapsed_s)
        self._doubt = doubt_rad_s2, noisiness
        verdict = self._ballot.verdict(doubt_rad_s2, noisiness)
        if verdict > 0 and self._readings >= TOLD_READINGS[0]:
            self._report("current-mismatch", f"{detail}, and the arm goes with it", None)
        elif verdict < 0 and self._readings >= TOLD_READINGS[1]:
            self._blame_sense(detail)
        if self.cycles:
            self._judge_lasting(off_a, detail)

    def _judge_lasting(self, off_a: float, detail: str) -> None:
        """Not decided yet: report it, and decide after a time limit."""
        flutters = self._flutter_a > self._flutter_limit_a
        self._flutter_cycles = max(self._flutter_cycles + (1.0 if flutters else -CALMING), 0.0)
        self._readings += abs(off_a) > 0.5 * self._moving_a
        if self._beyond_cycles or abs(off_a) > self._limit_a:
            self._haste = min(max(abs(off_a) / self._full_a, self._haste), 1.0)
            self._beyond_cycles += self._haste
            self._detail = detail
        if self._beyond_cycles >= NOTED_CYCLES or self._flutter_cycles >= FLUTTER_NOTED_CYCLES:
            self._note()
        is_large = abs(off_a) > UNEXPLAINED_SHARE * self._limit_a
        weight = 2 if self._flutter_a > 0.5 * self._flutter_limit_a else 1
        self._unexplained_cycles = self._unexplained_cycles + weight if is_large else 0
        if self._unexplained_cycles > UNEXPLAINED_CYCLES or self._flutter_cycles > FLUTTER_CYCLES:
            self._report("current-mismatch", f"{detail}, and the sense cannot be blamed", None)

    def _note(self) -> None:
        """It is reported, once: amplifier or sense."""
        if self._is_noted:
            return
        self._is_noted = True
        if self._ballot.lean(*self._doubt) < -WORTH_MENTION:
            detail = f"{self._detail}: rather the sense than the amplifier"
            self._report("current-sense-mismatch", detail, Reaction.DEGRADED)
        else:
            self._report("current-mismatch", f"{self._detail}: amplifier or sense", Reaction.DEGRADED)

    def _blame_sense(self, detail: str) -> None:
        at_end = self._code in self._end_codes
        name = "current-sense-range" if at_end else "current-sense-mismatch"
        self.is_given_up = self._report(name, f"code {self._code}" if at_end else detail, None)
        self.cycles = 0
