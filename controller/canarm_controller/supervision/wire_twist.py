"""How far a joint's wire is twisted: the motor, where the tachometer sits, is ahead of the arm that it carries.

Whether a wire is elastic, and how much, is learned from the angle's residual; the box bounds it. Owns the learning.
What is done with a residual must not enter.
"""

from .nominal import JointNominal
from .thresholds import POSITION_DRIFT, UNLEARNED_TWIST, Thresholds
from .uncertainty import WIRE

SMOOTHING = 1.0 / 3.0
"""Of a torque once in 10 ms: a law that answers each step of a sensor makes it jump, and no wire follows that."""


class WireTwist:
    """One joint. `twist_rad` is the motor's angle less the joint's, as far as base and offset have not taken it up.

    They are a linear filter of the angle. The wire's torque goes through the same one; what is left of the angle is
    then the compliance times what is left of the torque, by recursive least squares. Their weight
    only grows: a wire is what it is, and one that softens is to be noticed.
    """

    __slots__ = (
        "_base_nm", "_first2", "_largest", "_offset_nm_s", "_period_s", "_readings", "_rotor", "_sum2", "_torque_nm",
        "_twist_rad",
        "compliance", "twist_rad",
    )  # fmt: skip

    def __init__(self, joint: JointNominal, thresholds: Thresholds, readings: int, period_s: float) -> None:
        usual = 1.0 / joint.wire_stiffness_nm_rad
        self._largest, self._rotor = usual / WIRE[0], joint.rotor_kg_m2
        self._readings, self._period_s = readings, readings * period_s
        self._twist_rad = thresholds.twist
        self._first2 = (thresholds.noise_rad / usual) ** 2
        self.start()

    def start(self) -> None:
        """Nothing is twisted yet, and the wire may be rigid."""
        self._torque_nm = self._base_nm = self._offset_nm_s = 0.0
        self._sum2 = self._first2
        self.compliance = self.twist_rad = 0.0

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
        self._torque_nm += SMOOTHING * (drive_nm - self._rotor * acceleration_rad_s2 - self._torque_nm)
        left_nm = self._torque_nm - self._base_nm
        self._base_nm += self._period_s * self._offset_nm_s + (1.0 - (1.0 - base_gain) ** self._readings) * left_nm
        self._offset_nm_s += self._readings * offset_gain * left_nm
        self._sum2 += left_nm * left_nm
        compliance = self.compliance - (astray_rad + self.compliance * left_nm) * left_nm / self._sum2
        compliance = self.compliance = min(max(compliance, 0.0), self._largest)
        self.twist_rad = compliance * left_nm
