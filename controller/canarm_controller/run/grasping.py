"""The beginning of a run whose object waits on a stand: empty hands are homed, led to it and closed.

Owns the loop of the empty hands, when they close, and what the stand bears meanwhile. Cards and frames never enter.
"""

import math
from collections.abc import Sequence

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import HandBits, InputSlot

from ..reference.file_trajectory import OwnBeginning
from ..reference.limits import Limits
from ..reference.moved import Rest
from .loop import ControlLoop

SETTLING_S = 0.4
"""Rest before the hands close, and once they bear all of the object."""
ACTS_CYCLES = 2
"""A command that is computed in one cycle acts from the SYNC of the next on, and is seen in the one after that."""


class AtObject(OwnBeginning, Rest):
    """The hands rest where they close."""


class Grasping:
    """One start: `loop` has the empty hands until it `is_due` that `laden` takes over.

    Raises `ControllerError` where the empty hands cannot be led.
    """

    def __init__(self, cell: Cell, slots: Sequence[InputSlot], laden: ControlLoop) -> None:
        assert cell.object is not None
        self.cell = cell.model_copy(update={"object": None})
        """Without the object."""
        planned = laden.trajectory
        pose_rad = planned.sample(0, 1, laden.period_s).position_rad[0]
        rest = AtObject(Limits.of(self.cell), pose_rad, planned.amplitude_rad)
        self.loop = ControlLoop(self.cell, slots, type(laden.law), rest, laden.feedforward_kind)
        self._laden, self._period_s = laden, laden.period_s
        self._closing_cycles = math.ceil(cell.object.closing_s / self._period_s) + ACTS_CYCLES
        self._sinking_cycles = math.ceil(cell.object.taken_up_s / self._period_s)
        self._begun_at: int | None = None
        self._held_at: int | None = None
        self._steps_nm: Sequence[float] = ()
        """By how much the torques of the two loops differed when the hands had closed."""

    @property
    def is_empty(self) -> bool:
        """Whether the hands have nothing yet."""
        return self._held_at is None

    def bits(self, tick: int) -> HandBits:
        """What both hands are told in cycle `tick`, once homed: to close, from when they have come to rest."""
        if self._begun_at is None:
            rests_at = math.ceil((self.loop.trajectory.approach_s + SETTLING_S) / self._period_s)
            if tick < rests_at:
                return HandBits.KEEP
            self._begun_at = tick
        return HandBits.KEEP if self.borne(tick) == 0.0 else HandBits.CLOSE

    def is_due(self, tick: int) -> bool:
        """Whether the hands hold the object by now."""
        return self._begun_at is not None and tick >= self._begun_at + self._closing_cycles

    def hand_over(self, tick: int) -> ControlLoop:
        """The laden loop, begun in cycle `tick` where the empty hands are. Raises `ControllerError`."""
        self._held_at = tick
        self._laden.take_over(self.loop, tick, self._sinking_cycles * self._period_s + SETTLING_S)
        return self._laden

    def borne(self, tick: int) -> float:
        """The share of the weight that the stand bears."""
        return 1.0 if self._held_at is None else max(1.0 - (tick - self._held_at) / self._sinking_cycles, 0.0)

    def relieved(self, torque_nm: Sequence[float], tick: int) -> Sequence[float]:
        """The laden loop's torques (N·m), come to from those of the empty hands as the weight does."""
        share = self.borne(tick)
        if self.is_empty or not share:
            return torque_nm
        if not self._steps_nm:
            last_nm = self.loop.cycle.applied_nm
            self._steps_nm = [before - torque for before, torque in zip(last_nm, torque_nm, strict=True)]
        return [torque + share * step for torque, step in zip(torque_nm, self._steps_nm, strict=True)]
