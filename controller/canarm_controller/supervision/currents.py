"""Compares measured and commanded current of one joint: has the amplifier failed, or its sense?

Owns the winding's lag and the vote of the arm's acceleration; motion sensors are not used here.
"""

import math

from .detection import Reaction
from .limits import Report
from .nominal import JointNominal, SensorNominal
from .thresholds import Thresholds
from .timing import Timing
from .vote import Ballot

STEP_FRACTION = 0.2
"""Extra tolerance, as a share of a command change: the time constant is known to about a quarter, e^-0.8 to 0.09, and
the code of the DAC is rounded."""
FLUTTER_GAIN = 0.25
"""Changes of the difference between readings are averaged over about four."""
SMALLEST_CYCLES, NOTED_CYCLES = 2, 8
FLUTTER_NOTED_CYCLES, FLUTTER_CYCLES, CALMING = 3, 16, 0.25
"""A current that does not follow is reported; unless the sense proves to be the cause, torque is switched off."""
DECISIVE_GRAINS = 4.0
"""Grains of speed that the missing torque should have caused before its effect is judged."""
UNEXPLAINED_SHARE, UNEXPLAINED_CYCLES = 1.2, 16
"""Share of the limit, and cycles: a difference this large and long, not blamed on the sense, switches torque off; in
half that time if it flutters by half the flutter limit, as no offset or gain error does."""
FASTEST_SHARE = 0.98
"""Share of the tachometer's range beyond which the back-EMF is unknown."""
SUPPLY_SHARE = 0.85
"""Share of the current that the supply can drive against the back-EMF: near it, the amplifier may not follow."""


class CurrentWatch:
    """One joint: the sense gives |i| at its own time after SYNC; the command acts at SYNC, through the winding.

    Two ways to differ: by `current_mismatch_a`, or by a difference that flutters, as it does when the current follows
    an old command or noise. Then the arm votes. A sudden difference is judged by the speed that the missing torque
    should cause; of a slow one, only the variations can be distinguished from another payload.
    """

    __slots__ = (
        "_amperes",
        "_ballot",
        "_bias",
        "_code",
        "_command_a",
        "_deficit_nm_s",
        "_emf_v",
        "_end_codes",
        "_fastest_rad_s",
        "_flutter_a",
        "_flutter_cycles",
        "_flutter_limit_a",
        "_is_abrupt",
        "_last_off_a",
        "_limit_a",
        "_model",
        "_ohm",
        "_period_s",
        "_report",
        "_speed",
        "_speed_grain",
        "_step_a",
        "_supply_v",
        "_timing",
        "_unexplained_cycles",
        "_weight",
        "cycles",
        "is_given_up",
    )  # fmt: skip

    def __init__(
        self, joint: JointNominal, sense: SensorNominal, limits: Thresholds, timing: Timing, report: Report
    ) -> None:
        self._report, self._timing = report, timing
        self._step_a, self._end_codes = sense.step, sense.end_codes
        self._limit_a, self._flutter_limit_a = limits.current, limits.flutter
        self._weight = math.exp(-sense.skew_s / joint.winding_s)
        self._supply_v, self._ohm = joint.supply_v, joint.winding_ohm / SUPPLY_SHARE
        self._emf_v = joint.back_emf_v_s_rad
        self._fastest_rad_s = FASTEST_SHARE * joint.fastest_rad_s
        self._amperes = 1.0 / joint.torque_per_ampere
        self._period_s, self._speed_grain = timing.period_s, limits.speed_grain
        self.cycles = 0
        """Number of cycles in which measurement and command have differed."""
        self.is_given_up = False
        """Whether the sense was found wrong, and is ignored."""
        self._ballot = Ballot(limits.speed_grain, timing.window)
        self._is_abrupt = False
        self._unexplained_cycles = 0
        self._flutter_cycles = 0.0
        self._flutter_a = self._last_off_a = self._deficit_nm_s = self._command_a = 0.0
        self._speed = self._model = self._bias = 0.0
        self._code = 0

    def differs(self, code: int, command_nm: float, flowing_nm: float, speed_rad_s: float) -> float:
        """Measured minus expected current, A; 0 within the limits. `flowing_nm` is the current's torque at SYNC."""
        command_a = command_nm * self._amperes
        change_a = flowing_nm * self._amperes - command_a
        expected_a = command_a + self._weight * change_a
        if expected_a < 0.0:
            expected_a = -expected_a
        off_a = code * self._step_a - expected_a
        allowed_a = STEP_FRACTION * (change_a if change_a > 0.0 else -change_a)
        change_off_a, self._last_off_a = off_a - self._last_off_a, off_a
        flutter_a = self._flutter_a
        flutter_a += FLUTTER_GAIN * ((change_off_a if change_off_a > 0.0 else -change_off_a) - allowed_a - flutter_a)
        self._flutter_a = flutter_a
        limit_a = self._limit_a + allowed_a
        is_within = -limit_a < off_a < limit_a
        if is_within and flutter_a < (0.5 * self._flutter_limit_a if self.cycles else self._flutter_limit_a):
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
            self._is_abrupt = not is_within and abs(change_off_a) > 0.5 * self._limit_a
        self._code, self._command_a = code, command_a
        return off_a

    def forget(self) -> None:
        """Start over after a cycle of unknown length."""
        self.cycles, self._flutter_a = 0, 0.0
        self._ballot.clear()

    def judge(self, off_a: float, speed_rad_s: float, model_rad_s: float, bias_rad_s2: float, mobility: float) -> None:
        """Judge a difference by the joint's speed, ∫model, acceleration bias and mobility (rad/s² per N·m)."""
        command_a = self._command_a
        self.cycles += 1
        if self.cycles == 1:
            self._speed, self._model, self._bias, self._deficit_nm_s = speed_rad_s, model_rad_s, bias_rad_s2, 0.0
            self._unexplained_cycles = 0
            self._ballot.open_window()
            return
        sign = 1.0 if command_a >= 0.0 else -1.0
        self._deficit_nm_s += self._period_s * sign * off_a / self._amperes
        due = self._deficit_nm_s * mobility
        elapsed_s = (self.cycles - 1) * self._period_s
        unexplained = speed_rad_s - self._speed - (model_rad_s - self._model) - elapsed_s * self._bias
        detail = f"{off_a:+.2f} A from the {command_a:+.2f} A commanded"
        if self._is_abrupt and self.cycles <= self._timing.abrupt:
            self._judge_abrupt(off_a, due, unexplained, detail)
        elif self._ballot.cast(due, unexplained):
            if self._ballot.is_for:
                self._report("current-mismatch", f"{detail}, and the arm goes with it", None)
            else:
                self._blame_sense(detail)
        if self.cycles:
            self._judge_lasting(off_a, detail)

    def _judge_lasting(self, off_a: float, detail: str) -> None:
        """Not decided yet: report it, and decide after a time limit."""
        flutters = self._flutter_a > self._flutter_limit_a
        self._flutter_cycles = max(self._flutter_cycles + (1.0 if flutters else -CALMING), 0.0)
        if self.cycles == NOTED_CYCLES or self._flutter_cycles == FLUTTER_NOTED_CYCLES:
            self._report("current-mismatch", f"{detail}: amplifier or sense", Reaction.DEGRADED)
        if self._is_abrupt and self.cycles <= self._timing.abrupt:
            return
        is_large = abs(off_a) > UNEXPLAINED_SHARE * self._limit_a
        weight = 2 if self._flutter_a > 0.5 * self._flutter_limit_a else 1
        self._unexplained_cycles = self._unexplained_cycles + weight if is_large else 0
        if self._unexplained_cycles > UNEXPLAINED_CYCLES or self._flutter_cycles > FLUTTER_CYCLES:
            self._report("current-mismatch", f"{detail}, and the sense cannot be blamed", None)

    def _judge_abrupt(self, off_a: float, due: float, unexplained: float, detail: str) -> None:
        """A sudden difference: the speed that it causes tells amplifier and sense apart."""
        is_clear = abs(due) > DECISIVE_GRAINS * self._speed_grain
        if self.cycles <= SMALLEST_CYCLES or not is_clear:
            return
        if unexplained * due > 0.5 * due * due or (off_a > 0.0 and abs(unexplained) > 0.5 * abs(due)):
            self._report("current-mismatch", detail, None)
            self.cycles = 0
        elif self.cycles >= NOTED_CYCLES:
            self._blame_sense(detail)

    def _blame_sense(self, detail: str) -> None:
        at_end = self._code in self._end_codes
        name = "current-sense-range" if at_end else "current-sense-mismatch"
        self.is_given_up = self._report(name, f"code {self._code}" if at_end else detail, None)
        self.cycles = 0
