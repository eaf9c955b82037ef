"""Judges whether each joint's following error is normal for the law, given amplifiers at their limit.

Owns what excuses an error. Of the sensors it only knows whether a joint is sound.
"""

from collections.abc import Callable, Sequence

from ..laws.base import Cycle
from .nominal import JointNominal
from .surprise import ArmReport
from .thresholds import JUDGED_AT_RAD_S, Thresholds
from .timing import Timing

NORMAL_FACTOR, FOLLOWING_CYCLES = 2.0, 4
"""A following error is abnormal at this factor of normal, if it grows in this many readings."""


def normal_rad(nominal: JointNominal, limits: Thresholds, following_lsb: float, bears_weight: bool) -> float:
    """The normal error of a joint in a loop of 12 rad/s: the law's, or the sag of an arm whose weight nothing bears."""
    sag_rad = nominal.weight_nm * nominal.mobility_per_kg_m2[0] / JUDGED_AT_RAD_S**2
    return max(following_lsb * limits.following_unit, 0.0 if bears_weight else sag_rad)


class FollowingWatch:
    """State of all joints. `normal_rad` are normal errors in a loop of 12 rad/s. For joint `index`, `is_upset`
    tells whether its speed has recently been unexpected, and `may_saturate` whether nothing else is wrong with it.
    """

    def __init__(
        self, natural_frequency_rad_s: Sequence[float], normal_rad: Sequence[float], joints: Sequence[Thresholds],
        positions_lsb: Sequence[float], timing: Timing, report: ArmReport, is_upset: Callable[[int], bool],
        may_saturate: Callable[[int], bool],
    ) -> None:  # fmt: skip
        self._report, self._is_upset, self._may_saturate = report, is_upset, may_saturate
        self._positions_lsb, self._timing = positions_lsb, timing
        self._standing_rad_s = [joint.standing for joint in joints]
        self._limits_rad = [
            NORMAL_FACTOR * max(1.0, JUDGED_AT_RAD_S / omega) ** 2 * normal
            for normal, omega in zip(normal_rad, natural_frequency_rad_s, strict=True)
        ]
        self._following = [0] * len(joints)
        self._saturated = [0] * len(joints)
        self._jammed = [0] * len(joints)
        self._unsaturated = (False,) * len(joints)
        self._excused_until = timing.beginning
        self._is_following = False
        self.forgiven_until = -1
        """Until this cycle, an amplifier that was at its limit excuses the arm's motion."""

    def gap(self, count: int) -> None:
        """Measurements are missing."""
        self._excused_until = max(self._excused_until, count + self._timing.beginning)

    def recover(self, count: int) -> None:
        """The arm moved when the run began, and its reference stood."""
        self._excused_until = max(self._excused_until, count + self._timing.recovery)

    def step(self, count: int, cycle: Cycle) -> None:
        """Judge the following error of cycle `count`, once its reference is known."""
        if cycle.saturated == self._unsaturated:
            for position, reference, limit in zip(
                cycle.position_rad, cycle.reference_rad, self._limits_rad, strict=True
            ):
                if not -limit < position - reference < limit:
                    break
            else:
                if self._is_following:
                    self._following = [0] * len(self._following)
                    self._is_following = False
                return
        for index, (position, reference) in enumerate(zip(cycle.position_rad, cycle.reference_rad, strict=True)):
            error = position - reference
            limit = self._limits_rad[index]
            if -limit < error < limit:
                self._following[index] = 0
                if cycle.saturated[index]:
                    self._excuse(count, index)
                continue
            self._lag(count, index, cycle, error)

    def _lag(self, count: int, index: int, cycle: Cycle, error: float) -> None:
        """A joint is further from its reference than normal for the law."""
        detail = f"{error / self._positions_lsb[index]:+.1f} LSB from the reference"
        standing_rad_s = self._standing_rad_s[index]
        if cycle.saturated[index] and self._may_saturate(index):
            self._excuse(count, index)
            if self._saturated[index] == self._timing.saturated:
                self._report(
                    "saturation", index, f"amplifier at its limit, {detail}{self._against(index, cycle)}", None
                )
            stands = abs(cycle.velocity_rad_s[index]) < standing_rad_s and self._is_upset(index)
            self._jammed[index] = self._jammed[index] + 1 if stands else 0
            if self._jammed[index] >= self._timing.jammed:
                self._report("following-error", index, f"{detail}, and all current does not move it", None)
            return
        self._saturated[index] = 0
        rate = cycle.velocity_rad_s[index] - cycle.reference_rad_s[index]
        is_growing = error * rate > 0.0 or abs(rate) < standing_rad_s
        self._following[index] += 1 if is_growing else 0
        self._is_following = True
        if self._following[index] >= FOLLOWING_CYCLES and count > max(self.forgiven_until, self._excused_until):
            self._report("following-error", index, detail, None)

    def _against(self, index: int, cycle: Cycle) -> str:
        """What to say of a joint that a current along its speed does not drive: a weight pulls it, or a wrong sign."""
        speed_rad_s = cycle.velocity_rad_s[index]
        is_against = abs(speed_rad_s) > self._standing_rad_s[index] and speed_rad_s * cycle.applied_nm[index] < 0.0
        return ", moving against its current" if is_against else ""

    def _excuse(self, count: int, index: int) -> None:
        """The amplifier has been at its limit long enough to excuse what follows."""
        self._saturated[index] += 1
        if self._saturated[index] >= self._timing.saturated and self._may_saturate(index):
            self.forgiven_until = count + self._timing.recovery
