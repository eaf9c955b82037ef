"""Measured against commanded current of one joint: has the amplifier failed, or its sense?

Owns the winding's lag and the vote of the arm's acceleration. Sensors of the motion must not enter.
"""

import math

from canarm_protocol.cell import Joint, Quantity, Supervision
from canarm_protocol.wiring import sensor_scale

from .detection import Reaction
from .witness import HIGHEST_CODE, Report

STEP_FRACTION = 0.2
"""Of a change of command, allowed on top: the time constant is known to about a quarter, e^-0.8 to 0.09, and the code
of the DAC is rounded."""
SMALLEST_CYCLES, JUDGED_CYCLES = 2, 8
DECISIVE_LSB = 4.0
"""Steps of the tachometer: when the missing torque should have made so much speed, it can be seen whether it did."""
SUPPLY_SHARE = 0.85
"""Of what the supply can drive against the back-EMF: near that, the amplifier need not follow."""


class CurrentWatch:
    """One joint: the sense gives |i| at its own time after SYNC; the command acts at SYNC, through the winding."""

    __slots__ = (
        "_amperes", "_bias", "_code", "_command_a", "_deficit_nm_s", "_emf_v", "_limit_a", "_model", "_ohm",
        "_period_s", "_report", "_speed", "_speed_lsb", "_step_a", "_supply_v", "_weight", "cycles", "is_given_up",
    )  # fmt: skip

    def __init__(
        self, joint: Joint, limits: Supervision, skew_s: float, speed_lsb: float, period_s: float, report: Report
    ) -> None:
        motor = joint.motor
        self._report = report
        self._step_a = sensor_scale(joint, Quantity.CURRENT_SENSE).step
        self._limit_a = limits.current_mismatch_a
        self._weight = math.exp(-skew_s / (motor.winding_mh * 1e-3 / motor.winding_ohm))
        self._supply_v, self._ohm = joint.amplifier.supply_v, motor.winding_ohm / SUPPLY_SHARE
        self._emf_v = motor.back_emf_v_s_rad
        self._amperes = 1.0 / motor.torque_per_ampere
        self._period_s, self._speed_lsb = period_s, speed_lsb
        self.cycles = 0
        """For how long measurement and command have differed."""
        self.is_given_up = False
        """Whether the sense has been found wrong; it is not looked at any more."""
        self._deficit_nm_s = self._speed = self._model = self._bias = self._command_a = 0.0
        self._code = 0

    def differs(self, code: int, command_nm: float, last_nm: float, speed_rad_s: float) -> float:
        """What is measured beyond what should be, A; 0 within the limits. `last_nm` was commanded a cycle earlier."""
        command_a = command_nm * self._amperes
        change_a = last_nm * self._amperes - command_a
        expected_a = command_a + self._weight * change_a
        if expected_a < 0.0:
            expected_a = -expected_a
        off_a = code * self._step_a - expected_a
        limit_a = self._limit_a + STEP_FRACTION * (change_a if change_a > 0.0 else -change_a)
        if -limit_a < off_a < limit_a:
            self.cycles = 0
            return 0.0
        along_rad_s = speed_rad_s if command_a > 0.0 else -speed_rad_s
        if self.is_given_up or (off_a < 0.0 and expected_a > (self._supply_v - self._emf_v * along_rad_s) / self._ohm):
            return 0.0
        self._code, self._command_a = code, command_a
        return off_a

    def judge(self, off_a: float, speed_rad_s: float, model_rad_s: float, bias_rad_s2: float, mobility: float) -> None:
        """Look into a difference: speed, ∫model and acceleration bias of the joint, rad/s² a N·m of it."""
        command_a = self._command_a
        self.cycles += 1
        if self.cycles == 1:
            self._speed, self._model, self._bias, self._deficit_nm_s = speed_rad_s, model_rad_s, bias_rad_s2, 0.0
            return
        sign = 1.0 if command_a >= 0.0 else -1.0
        self._deficit_nm_s += self._period_s * sign * off_a / self._amperes
        due = self._deficit_nm_s * mobility
        elapsed_s = (self.cycles - 1) * self._period_s
        unexplained = speed_rad_s - self._speed - (model_rad_s - self._model) - elapsed_s * self._bias
        is_clear = abs(due) > DECISIVE_LSB * self._speed_lsb
        if self.cycles <= SMALLEST_CYCLES or not (is_clear or self.cycles >= JUDGED_CYCLES):
            return
        detail = f"{off_a:+.2f} A from the {command_a:+.2f} A commanded"
        if unexplained * due > 0.5 * due * due or (off_a > 0.0 and abs(unexplained) > 0.5 * abs(due)):
            # An amplifier that gives too little can still help to hold the arm; one that gives too much cannot.
            self._report("current-mismatch", detail, Reaction.HOLD if off_a < 0.0 else None)
            self.cycles = 0
        elif self.cycles >= JUDGED_CYCLES:
            at_end = self._code in (0, HIGHEST_CODE)
            name = "current-sense-range" if at_end else "current-sense-mismatch"
            self.is_given_up = self._report(name, f"code {self._code}" if at_end else detail, None)
            self.cycles = 0
