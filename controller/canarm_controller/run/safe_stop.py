"""The end of a run: torque off or the arm held, cycle after cycle, until it stands still and the cards can be left.

The reason of the stop, and frames, never enter.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..cycle import Cycle
from ..supervision.hold import SafeHold
from .loop import ControlLoop

STANDSTILL_S, LEAST_STANDSTILL_CYCLES = 0.05, 4
"""The arm stands still when every joint has done so for this long."""
STOPPING_S = 2.0
"""A stop waits at most this long for standstill."""
FINAL_CYCLES = 2
"""A run that ends as planned needs two more SYNCs: the zero outputs of the first act at the second."""


class StopStep(NamedTuple):
    """One cycle of a stop: torques in N·m, one per joint, or None for no torque; and whether the stop is over."""

    torque_nm: Sequence[float] | None
    is_over: bool = False


class SafeStop:
    """The stop of one run. `hold` begins to brake and hold the arm from the state of a cycle on; below `standing_rad_s`
    a joint stands still.
    """

    def __init__(self, loop: ControlLoop, hold: Callable[[Cycle], SafeHold], standing_rad_s: Sequence[float]) -> None:
        self.holds = False
        """Whether the arm is held instead of left without torque."""
        self._loop, self._begin_hold, self._standing_rad_s = loop, hold, standing_rad_s
        self._standstill_cycles = max(round(STANDSTILL_S / loop.period_s), LEAST_STANDSTILL_CYCLES)
        self._hold: SafeHold | None = None
        self._cycles = self._still_cycles = 0

    def begin_cycle(self) -> bool:
        """Begin a cycle of the stop; returns whether its inputs must be measured: those of the first already are."""
        self._cycles += 1
        return self._cycles > 1 or not self.holds

    def step(self, is_planned: bool, has_inputs: bool) -> StopStep:
        """What to do in this cycle of a stop that was planned or not."""
        if has_inputs:
            self._still_cycles = self._still_cycles + 1 if stands_still(self._loop.cycle, self._standing_rad_s) else 0
        limit = FINAL_CYCLES if is_planned else int(STOPPING_S / self._loop.period_s)
        is_over = self._cycles > limit or (not is_planned and self._still_cycles >= self._standstill_cycles)
        if self.holds and is_over:
            self.holds = False
            self._cycles = int(STOPPING_S / self._loop.period_s) - FINAL_CYCLES
            self._still_cycles = 0
            return StopStep(None)
        if self.holds and has_inputs:
            return StopStep(self._holding_nm())
        return StopStep(None, is_over)

    def _holding_nm(self) -> Sequence[float]:
        loop = self._loop
        if self._hold is None:
            self._hold = self._begin_hold(loop.cycle)
        return self._hold.torque_nm(loop.cycle)


def stands_still(cycle: Cycle, standing_rad_s: Sequence[float]) -> bool:
    """Whether the measured speed of every joint is below its limit."""
    return all(abs(speed) < limit for speed, limit in zip(cycle.velocity_rad_s, standing_rad_s, strict=True))
