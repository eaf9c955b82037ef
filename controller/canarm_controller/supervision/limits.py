"""What the detectors of a joint share: how they report, what a code can be, and how wide their limits are just now.

The limits of the cell are for nominal noise. A sensor that is noisier from the start is not broken: limits go with the
noise that is measured. What is done with a limit must not enter.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Supervision

from .detection import Reaction

Report = Callable[[str, str, Reaction | None], bool]
"""Detector, detail and, where it is not the table's, the reaction. False if that detector is switched off."""

HIGHEST_CODE = 255
NOISE_MASK = 3
"""Noise is measured in every fourth cycle,"""
NOISE_SAMPLES = 256
"""over so many of them, 2.5 s; in the beginning over those that there are, the nominal counting as eight."""
PRIOR_SAMPLES = 8
NOMINAL_LSB2 = 0.18
"""0.3 LSB of noise and rounding of 1/sqrt(12) LSB: 0.42 LSB squared."""
ALLOWANCE = 1.15
"""A standard deviation from 100 samples is wrong by 7 %; twice that widens nothing yet."""
WIDENING_LSB2 = 0.999 * NOMINAL_LSB2 * ALLOWANCE**2
"""Below this limits surely are the nominal ones."""
SLOW_LSB = 0.2
"""Root mean square of the filtered angle residual; 0.09 for white noise. An elastic drive wire twists by more."""
HIGHEST_FACTOR = 2.3
"""1.5 LSB of position drift: half the floor of the potentiometer."""
HIGHEST_JUMP_FACTOR, FIRST_SAMPLES = 1.5, 32
"""At first, while the base of the angle is a single reading, jumps have the widest limit."""
DOUBT_LSB = 2.7
"""A speed off by this is no fault, but remembered for a second: a payload of ±50 % leaves 2.2."""


class JointLimits:
    """Limits of one joint's residuals in rad and rad/s."""

    __slots__ = (
        "_angle_lsb2", "_cell", "_is_nominal", "_position_lsb", "_samples", "_slow_lsb2", "_speed_lsb", "_speed_lsb2",
        "doubt", "drift", "jump", "step", "swing",
    )  # fmt: skip

    def __init__(self, cell: Supervision, position_lsb: float, speed_lsb: float) -> None:
        self._cell, self._position_lsb, self._speed_lsb = cell, position_lsb, speed_lsb
        self.start()

    def start(self) -> None:
        """Nominal noise, until it is measured."""
        self._samples = PRIOR_SAMPLES
        self._angle_lsb2 = self._speed_lsb2 = NOMINAL_LSB2
        self._slow_lsb2 = 0.0
        self._set()

    def learn(self, astray_rad: float, mismatch_rad: float, change_rad_s: float) -> None:
        """Take residuals of one cycle: the angle's, the same filtered, and the change of the speed's in a cycle.

        What is beyond three standard deviations counts as that: a single spike is no noise.
        """
        samples = self._samples
        if samples < NOISE_SAMPLES:
            samples = self._samples = samples + 1
        slow = mismatch_rad / self._position_lsb
        angle = (astray_rad - mismatch_rad) / self._position_lsb
        speed = change_rad_s / self._speed_lsb
        angle2, speed2, slow_lsb2 = angle * angle, 0.5 * speed * speed, self._slow_lsb2
        angle_lsb2, speed_lsb2 = self._angle_lsb2, self._speed_lsb2
        highest = 9.0 * angle_lsb2
        angle_lsb2 += ((angle2 if angle2 < highest else highest) - angle_lsb2) / samples
        highest = 9.0 * speed_lsb2
        speed_lsb2 += ((speed2 if speed2 < highest else highest) - speed_lsb2) / samples
        slow_lsb2 += (slow * slow - slow_lsb2) / samples
        self._angle_lsb2, self._speed_lsb2, self._slow_lsb2 = angle_lsb2, speed_lsb2, slow_lsb2
        if samples & NOISE_MASK:
            return
        if angle_lsb2 > WIDENING_LSB2 or speed_lsb2 > WIDENING_LSB2 or slow_lsb2 > SLOW_LSB**2 or not self._is_nominal:
            self._set()

    def _set(self) -> None:
        cell = self._cell
        angle = min(max((self._angle_lsb2 / NOMINAL_LSB2) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        speed = min(max((self._speed_lsb2 / NOMINAL_LSB2) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        slow = min(self._slow_lsb2**0.5 / SLOW_LSB, HIGHEST_FACTOR)
        is_first = self._samples < PRIOR_SAMPLES + FIRST_SAMPLES
        jump = HIGHEST_JUMP_FACTOR if is_first else min(angle, HIGHEST_JUMP_FACTOR)
        self._is_nominal = jump == speed == angle == 1.0 and slow <= 1.0
        self.jump = jump * cell.position_jump_lsb * self._position_lsb
        self.drift = max(angle, slow) * cell.position_drift_lsb * self._position_lsb
        self.step = speed * cell.speed_jump_lsb * self._speed_lsb
        self.swing = speed * cell.speed_drift_lsb * self._speed_lsb
        self.doubt = speed * min(DOUBT_LSB, cell.speed_jump_lsb) * self._speed_lsb
