"""How far a joint's wire is twisted: the motor, where the tachometer sits, is ahead of the arm that it carries.

Whether a wire is elastic, and how much, is learned from the angle's residual; the box bounds it. Owns the learning.
What is done with a residual must not enter.
"""

from .nominal import JointNominal
from .thresholds import POSITION_DRIFT, UNLEARNED_TWIST, Thresholds
from .uncertainty import WIRE

SMOOTHING = 1.0 / 3.0
"""Of a torque once in 10 ms: a law that answers each step of a sensor makes it jump, and no wire follows that."""

ZERO_LSB = 0.5
"""Steps by which the zero of a tachometer may be off where nothing is known of it: 0.01 rad/s of konkuk1's."""


class WireTwist:
    """One joint. `twist_rad` is the motor's angle less the joint's, as far as base and offset have not taken it up.

    They are a linear filter of the angle. The wire's torque goes through the same one; what is left of the angle is
    then the compliance times what is left of the torque. So is the error of the first reading, from which the angle is
    counted, and that of the tachometer's zero, a ramp: the first is as large as the twist, and fades as slowly as the
    arm's weight that the wire takes up at the start. All three are found together, by recursive least squares. They
    forget nothing: a wire is what it is, and one that softens is to be noticed.
    """

    __slots__ = (
        "_base_nm", "_base_ramp", "_base_step", "_covariance", "_largest", "_noise2", "_offset_nm_s", "_offset_ramp",
        "_offset_step", "_period_s", "_ramp", "_readings", "_rotor", "_state", "_torque_nm", "_twist_rad", "_usual2",
        "_zero2", "compliance", "twist_rad",
    )  # fmt: skip

    def __init__(self, joint: JointNominal, thresholds: Thresholds, readings: int, period_s: float) -> None:
        usual = 1.0 / joint.wire_stiffness_nm_rad
        self._largest, self._rotor = usual / WIRE[0], joint.rotor_kg_m2
        self._readings, self._period_s = readings, readings * period_s
        self._twist_rad = thresholds.twist
        self._noise2, self._usual2 = thresholds.noise_rad**2, usual**2
        self._zero2 = (ZERO_LSB * joint.speed.step) ** 2 if joint.speed else 0.0
        self.start()

    def start(self) -> None:
        """Nothing is twisted yet, and the wire may be rigid."""
        self._torque_nm = self._base_nm = self._offset_nm_s = 0.0
        self._state = 0.0, 0.0, 0.0
        self._covariance = self._usual2, 0.0, 0.0, self._noise2, 0.0, self._zero2
        self._base_step = self._offset_step = self._ramp = self._base_ramp = self._offset_ramp = 0.0
        self.compliance = self.twist_rad = 0.0

    def count_anew(self) -> None:
        """The angle is counted from another reading."""
        c11, _, c13, _, _, c33 = self._covariance
        self._covariance = c11, 0.0, c13, self._noise2, 0.0, c33
        compliance, _, zero = self._state
        self._state = compliance, 0.0, zero
        self._base_step = self._offset_step = 0.0

    @property
    def is_elastic(self) -> bool:
        """Whether it gives by more than half of what the stiffest of the box does."""
        return self.compliance > 0.5 * self._largest * WIRE[0] / WIRE[1]

    @property
    def unlearned_rad(self) -> float:
        """What of the twist is not known, as the compliance is learned to a third and the weight turns by half."""
        return POSITION_DRIFT * UNLEARNED_TWIST * self._twist_rad * self.compliance / self._largest

    def take(
        self, drive_nm: float, acceleration_rad_s2: float, astray_rad: float, base_gain: float, offset_gain: float
    ) -> None:
        """Drive less friction, N·m, and the joint's acceleration; the angle's residual and how it is learned from."""
        period_s = self._period_s
        self._torque_nm += SMOOTHING * (drive_nm - self._rotor * acceleration_rad_s2 - self._torque_nm)
        by_base, by_offset = 1.0 - (1.0 - base_gain) ** self._readings, self._readings * offset_gain
        left_nm = self._torque_nm - self._base_nm
        self._base_nm += period_s * self._offset_nm_s + by_base * left_nm
        self._offset_nm_s += by_offset * left_nm
        step = 1.0 - self._base_step
        self._base_step += period_s * self._offset_step + by_base * step
        self._offset_step += by_offset * step
        self._ramp += period_s
        ramp = self._ramp - self._base_ramp
        self._base_ramp += period_s * self._offset_ramp + by_base * ramp
        self._offset_ramp += by_offset * ramp
        self._learn(astray_rad, -left_nm, step, ramp)
        compliance = self.compliance = min(max(self._state[0], 0.0), self._largest)
        self.twist_rad = compliance * left_nm

    def _learn(self, astray_rad: float, by1: float, by2: float, by3: float) -> None:
        """One step of recursive least squares; the angle's residual is by1, by2, by3 times the unknowns, and noise."""
        x1, x2, x3 = self._state
        c11, c12, c13, c22, c23, c33 = self._covariance
        p1, p2, p3 = (
            c11 * by1 + c12 * by2 + c13 * by3,
            c12 * by1 + c22 * by2 + c23 * by3,
            c13 * by1 + c23 * by2 + c33 * by3,
        )
        scale = 1.0 / (self._noise2 + by1 * p1 + by2 * p2 + by3 * p3)
        off = scale * (astray_rad - by1 * x1 - by2 * x2 - by3 * x3)
        self._state = x1 + p1 * off, x2 + p2 * off, x3 + p3 * off
        self._covariance = (
            c11 - scale * p1 * p1, c12 - scale * p1 * p2, c13 - scale * p1 * p3,
            c22 - scale * p2 * p2, c23 - scale * p2 * p3, c33 - scale * p3 * p3,
        )  # fmt: skip
