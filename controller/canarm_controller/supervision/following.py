"""The following error of each joint, and amplifiers at their limit: is it more than is normal for the law?

Owns what excuses an error. Residuals of sensors must not enter, beyond whether a joint is sound.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.cell.model import Cell

from ..laws.base import Cycle
from .surprise import ArmReport

NORMAL_FACTOR, JAMMED_CYCLES = 2.0, 20
"""A following error is abnormal at twice what is normal; a joint that does not even move then is jammed."""
STANDING_RAD_S = 0.06
JUDGED_AT_RAD_S = 12.0
"""Natural frequency at which laws state their normal following error; a softer loop lags by its inverse square more."""
BEGINNING_CYCLES = 200
"""Half a second in which a law learns what the arm carries: a payload that sags then is no failure."""
UNSATURATED = (False, False)
FOLLOWING_CYCLES, SATURATED_CYCLES, RECOVERY_CYCLES = 4, 40, 800
"""A following error must grow for so long; an amplifier be at its limit for so long; and after that the arm has 2 s to
come back."""
GAP_CYCLES = 200
"""Half a second to come back after cycles without a measurement: the law had to do with predictions."""


class FollowingWatch:
    """State of all joints. `is_upset` and `may_saturate` tell of joint `index` whether its speed has surprised lately,
    and whether nothing else is wrong with it.
    """

    def __init__(
        self, cell: Cell, following_lsb: float, positions_lsb: Sequence[float], report: ArmReport,
        is_upset: Callable[[int], bool], may_saturate: Callable[[int], bool],
    ) -> None:  # fmt: skip
        self._report, self._is_upset, self._may_saturate = report, is_upset, may_saturate
        self._positions_lsb = positions_lsb
        softness = max(1.0, JUDGED_AT_RAD_S / cell.control.natural_frequency_rad_s) ** 2
        self._limits_rad = [NORMAL_FACTOR * softness * following_lsb * lsb for lsb in positions_lsb]
        self._following = [0] * len(positions_lsb)
        self._saturated = [0] * len(positions_lsb)
        self._jammed = [0] * len(positions_lsb)
        self._excused_until = BEGINNING_CYCLES
        self.forgiven_until = -1
        """Until this cycle an amplifier that was at its limit excuses what the arm does."""

    def gap(self, count: int) -> None:
        """Measurements are missing."""
        self._excused_until = max(self._excused_until, count + GAP_CYCLES)

    def step(self, count: int, cycle: Cycle) -> None:
        """Judge the following error of cycle `count`, once its reference is known."""
        (x1, x2), (wanted1, wanted2), (limit1, limit2) = cycle.position_rad, cycle.reference_rad, self._limits_rad
        if -limit1 < x1 - wanted1 < limit1 and -limit2 < x2 - wanted2 < limit2 and cycle.saturated == UNSATURATED:
            self._following[0] = self._following[1] = 0
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
        """The joint is further from its reference than is normal for the law."""
        detail = f"{error / self._positions_lsb[index]:+.1f} LSB from the reference"
        if cycle.saturated[index] and self._may_saturate(index):
            self._excuse(count, index)
            if self._saturated[index] == SATURATED_CYCLES:
                self._report("saturation", index, f"amplifier at its limit, {detail}", None)
            stands = abs(cycle.velocity_rad_s[index]) < STANDING_RAD_S and self._is_upset(index)
            self._jammed[index] = self._jammed[index] + 1 if stands else 0
            if self._jammed[index] >= JAMMED_CYCLES:
                self._report("following-error", index, f"{detail}, and all current does not move it", None)
            return
        self._saturated[index] = 0
        rate = cycle.velocity_rad_s[index] - cycle.reference_rad_s[index]
        is_growing = error * rate > 0.0 or abs(rate) < STANDING_RAD_S
        self._following[index] += 1 if is_growing else 0
        if self._following[index] >= FOLLOWING_CYCLES and count > max(self.forgiven_until, self._excused_until):
            self._report("following-error", index, detail, None)

    def _excuse(self, count: int, index: int) -> None:
        """The amplifier has been at its limit for long enough to excuse what follows."""
        self._saturated[index] += 1
        if self._saturated[index] >= SATURATED_CYCLES and self._may_saturate(index):
            self.forgiven_until = count + RECOVERY_CYCLES
