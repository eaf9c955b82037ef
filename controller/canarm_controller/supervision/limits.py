"""What the detectors of a joint share: how they report, what a code can be, and how wide their limits are just now.

The limits of the cell are for nominal noise. A sensor that is noisier from the start is not broken: limits go with the
noise that is measured. What is done with a limit must not enter.
"""

from collections.abc import Callable

from canarm_protocol.cell import Supervision

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
        "_angle_lsb2", "_cell", "_position_lsb", "_samples", "_slow_lsb2", "_speed_lsb", "_speed_lsb2", "doubt",
        "drift", "jump", "step", "swing",
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
        samples = self._samples = self._samples + 1 if self._samples < NOISE_SAMPLES else NOISE_SAMPLES
        angle = ((astray_rad - mismatch_rad) / self._position_lsb) ** 2
        speed = 0.5 * (change_rad_s / self._speed_lsb) ** 2
        self._angle_lsb2 += (min(angle, 9.0 * self._angle_lsb2) - self._angle_lsb2) / samples
        self._speed_lsb2 += (min(speed, 9.0 * self._speed_lsb2) - self._speed_lsb2) / samples
        self._slow_lsb2 += ((mismatch_rad / self._position_lsb) ** 2 - self._slow_lsb2) / samples
        if not samples & NOISE_MASK or samples == NOISE_SAMPLES:
            self._set()

    def _set(self) -> None:
        cell = self._cell
        angle = min(max((self._angle_lsb2 / NOMINAL_LSB2) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        speed = min(max((self._speed_lsb2 / NOMINAL_LSB2) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        slow = min(self._slow_lsb2**0.5 / SLOW_LSB, HIGHEST_FACTOR)
        is_first = self._samples < PRIOR_SAMPLES + FIRST_SAMPLES
        jump = HIGHEST_JUMP_FACTOR if is_first else min(angle, HIGHEST_JUMP_FACTOR)
        self.jump = jump * cell.position_jump_lsb * self._position_lsb
        self.drift = max(angle, slow) * cell.position_drift_lsb * self._position_lsb
        self.step = speed * cell.speed_jump_lsb * self._speed_lsb
        self.swing = speed * cell.speed_drift_lsb * self._speed_lsb
        self.doubt = speed * min(DOUBT_LSB, cell.speed_jump_lsb) * self._speed_lsb
