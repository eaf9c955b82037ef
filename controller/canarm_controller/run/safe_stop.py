"""The end of a run: torque off or the arm held, cycle after cycle, until it stands still and the cards can be left.

A robot that is never to be without torque is left with what holds it. The reason of the stop, and frames, never enter.
"""

from collections.abc import Callable, Iterable, Sequence
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
    """The stop of one run: `begin` it, then take a `step` a cycle. Below `standing_rad_s` a joint stands still.

    `hold` begins to brake and hold the arm from the state of a cycle on. `keeps` tells for each joint whether its robot
    is never to be without torque (`Robot.holds`): it is held whatever has happened, and left with what its cards give
    it then. Of its joints those in doubt get what carries their weight, or nothing.
    """

    def __init__(
        self, loop: ControlLoop, hold: Callable[[Cycle], SafeHold], standing_rad_s: Sequence[float],
        keeps: Sequence[bool],
    ) -> None:  # fmt: skip
        self.keeps_all = all(keeps)
        """Whether no robot ever is to be without torque."""
        self.keeps_any = any(keeps)
        self._loop, self._begin_hold, self._standing_rad_s, self._keeps = loop, hold, standing_rad_s, keeps
        self._standstill_cycles = max(round(STANDSTILL_S / loop.period_s), LEAST_STANDSTILL_CYCLES)
        self._hold: SafeHold | None = None
        self._held = [False] * len(keeps)
        self.frozen: frozenset[int] = frozenset()
        """Joints in doubt of such robots."""
        self._torque_nm: Sequence[float] | None = None
        self._is_leaving = False
        self._cycles = self._still_cycles = 0

    @property
    def holds(self) -> bool:
        """Whether any joint is held instead of left without torque."""
        return any(self._held)

    def begin(self, is_hold: bool) -> None:
        """Hold every joint, or only those of robots that are never to be without torque."""
        self._held = [True] * len(self._keeps) if is_hold else list(self._keeps)

    def fail(self) -> None:
        """Something else has failed: nothing is held any more but robots that always are."""
        self._held = [held and keeps for held, keeps in zip(self._held, self._keeps, strict=True)]

    def doubt(self, joints: Iterable[int], is_drive: bool) -> None:
        """A stop names these joints: of robots that always are held, none follows its sensors any more.

        Without a drive (`is_drive`) that does what it is told a joint is better left alone.
        """
        for joint in joints:
            if self._keeps[joint]:
                self.frozen |= {joint}
                self._held[joint] = self._held[joint] and not is_drive

    def begin_cycle(self, is_planned: bool) -> bool:
        """Begin a cycle of the stop; returns whether its inputs must be measured: those of the first mostly are."""
        self._cycles += 1
        return self._cycles > 1 or is_planned or not self.holds

    def step(self, is_planned: bool, has_inputs: bool) -> StopStep:
        """What to do in this cycle of a stop that was planned or not; `has_inputs`: of any joint."""
        if has_inputs:
            self._still_cycles = self._still_cycles + 1 if stands_still(self._loop.cycle, self._standing_rad_s) else 0
        waits = not is_planned or self.holds
        limit = int(STOPPING_S / self._loop.period_s) if waits else FINAL_CYCLES
        is_over = self._cycles > limit or (waits and self._still_cycles >= self._standstill_cycles)
        if not self.holds:
            return StopStep(None, is_over)
        is_left_so = all(keeps for held, keeps in zip(self._held, self._keeps, strict=True) if held)
        if is_over and (is_left_so or self._is_leaving):
            return StopStep(None, is_over)
        if is_over:
            self._is_leaving = True
            self.fail()
            self._cycles = int(STOPPING_S / self._loop.period_s) - FINAL_CYCLES
            self._still_cycles = 0
        elif has_inputs or (self._torque_nm is None and self.keeps_any):
            self._torque_nm = self._holding_nm()
        elif not self.keeps_any:
            return StopStep(None)
        return StopStep(self._of_held(self._torque_nm))

    def _holding_nm(self) -> Sequence[float]:
        loop = self._loop
        if self._hold is None:
            self._hold = self._begin_hold(loop.cycle)
        return self._hold.torque_nm(loop.cycle, self.frozen)

    def _of_held(self, torque_nm: Sequence[float] | None) -> Sequence[float] | None:
        if torque_nm is None or not self.holds:
            return None
        return [torque if held else 0.0 for torque, held in zip(torque_nm, self._held, strict=True)]


def stands_still(cycle: Cycle, standing_rad_s: Sequence[float]) -> bool:
    """Whether the measured speed of every joint is below its limit."""
    return all(abs(speed) < limit for speed, limit in zip(cycle.velocity_rad_s, standing_rad_s, strict=True))
