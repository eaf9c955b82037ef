"""Shared by a joint's detectors: reporting, possible codes, and the present width of their limits.

The cell's limits are for nominal noise. A sensor that is noisier from the start is not broken: limits scale with the
measured noise.
"""

from collections.abc import Callable

from .detection import Reaction
from .thresholds import WIRE_OVERSHOOT, Thresholds

Report = Callable[[str, str, Reaction | None], bool]
"""Detector, detail, and the reaction if it is not the table's. False if that detector is switched off."""

NOISE_MASK = 3
"""Noise is measured in every fourth cycle,"""
NOISE_SAMPLES = 256
"""over this many samples, 2.5 s; at first over those taken so far, with the nominal counting as eight."""
PRIOR_SAMPLES = 8
NOMINAL = 0.18
"""Grains squared: 0.3 of noise and rounding of 1/sqrt(12) make 0.42 grains."""
ALLOWANCE = 1.15
"""A standard deviation from 100 samples is off by 7 %; up to twice that, limits are not widened."""
WIDENING = 0.999 * NOMINAL * ALLOWANCE**2
"""Below this variance, limits are the nominal ones."""
SLOW = 0.2
"""Grains, root mean square of the filtered angle residual; 0.09 for white noise. An elastic wire twists by more."""
HIGHEST_FACTOR = 2.3
"""1.5 grains of position drift: half the error at which a position sensor counts as wrong."""
HIGHEST_JUMP_FACTOR, FIRST_SAMPLES = 1.5, 32
"""At first, while the base of the angle is a single reading, the limit of jumps is widest."""


class JointLimits:
    """Limits of one joint's residuals in rad and rad/s."""

    __slots__ = (
        "_angle2", "_is_nominal", "_nominal", "_per_angle", "_per_speed", "_samples", "_slow2", "_speed2", "_twist",
        "doubt", "drift", "jump", "step", "swing",
    )  # fmt: skip

    def __init__(self, nominal: Thresholds) -> None:
        self._nominal = nominal
        self._per_angle, self._per_speed = 1.0 / nominal.position_grain, 1.0 / nominal.speed_grain
        self.start()

    def start(self) -> None:
        """Nominal noise, until it is measured."""
        self._samples = PRIOR_SAMPLES
        self._angle2 = self._speed2 = NOMINAL
        self._slow2 = 0.0
        self._twist = WIRE_OVERSHOOT * self._nominal.twist
        self._set()

    def settle(self) -> None:
        """What the arm twists its wires by is known now."""
        if self._twist:
            self._twist = 0.0
            self._set()

    def learn(self, astray_rad: float, mismatch_rad: float, change_rad_s: float) -> None:
        """Take residuals of one cycle: the angle's, the same filtered, and the change of the speed's in a cycle.

        Residuals are clipped at three standard deviations: a single spike is no noise.
        """
        samples = self._samples
        if samples < NOISE_SAMPLES:
            samples = self._samples = samples + 1
        slow = mismatch_rad * self._per_angle
        angle = (astray_rad - mismatch_rad) * self._per_angle
        speed = change_rad_s * self._per_speed
        new_angle2, new_speed2, slow2 = angle * angle, 0.5 * speed * speed, self._slow2
        angle2, speed2 = self._angle2, self._speed2
        highest = 9.0 * angle2
        angle2 += ((new_angle2 if new_angle2 < highest else highest) - angle2) / samples
        highest = 9.0 * speed2
        speed2 += ((new_speed2 if new_speed2 < highest else highest) - speed2) / samples
        slow2 += (slow * slow - slow2) / samples
        self._angle2, self._speed2, self._slow2 = angle2, speed2, slow2
        if samples & NOISE_MASK:
            return
        if angle2 > WIDENING or speed2 > WIDENING or slow2 > SLOW**2 or not self._is_nominal:
            self._set()

    def _set(self) -> None:
        nominal = self._nominal
        angle = min(max((self._angle2 / NOMINAL) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        speed = min(max((self._speed2 / NOMINAL) ** 0.5 / ALLOWANCE, 1.0), HIGHEST_FACTOR)
        slow = min(self._slow2**0.5 / SLOW, HIGHEST_FACTOR)
        is_first = self._samples < PRIOR_SAMPLES + FIRST_SAMPLES
        jump = HIGHEST_JUMP_FACTOR if is_first else min(angle, HIGHEST_JUMP_FACTOR)
        self._is_nominal = jump == speed == angle == 1.0 and slow <= 1.0
        self.jump = jump * nominal.jump + self._twist
        self.drift = max(angle, slow) * nominal.drift
        self.step = speed * nominal.step
        self.swing = speed * nominal.swing
        self.doubt = speed * nominal.doubt
