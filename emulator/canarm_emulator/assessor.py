"""Compares the true motion with the reference that a controller reports: the bench's own judgement of a run.

The reference arrives late and in batches; the truth of the last cycles is kept until it does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from canarm_protocol.cell import Cell, Quantity
from canarm_protocol.wiring import sensor_scale

from .world import JointState

SETTLING_CYCLES = 1024
"""Cycles at the start that are left out: the motion is still blending in."""
KEPT_CYCLES = 4096


@dataclass(slots=True)
class JointScore:
    """Running figures of one joint. Errors are true minus reference angle, in steps of the joint's position sensor."""

    lsb_rad: float
    samples: int = 0
    sum_of_squares: float = 0.0
    max_lsb: float = 0.0
    peak_current_a: float = 0.0
    saturated_cycles: int = 0

    @property
    def rms_lsb(self) -> float:
        """Root mean square of the error; 0 while there are no samples."""
        return math.sqrt(self.sum_of_squares / self.samples) if self.samples else 0.0


class Assessor:
    """Figures of a run, begun anew at every cycle 0."""

    def __init__(self, cell: Cell) -> None:
        self._lsb_rad = [sensor_scale(joint, Quantity.POTENTIOMETER).step for joint in cell.joints]
        self._limit_a = [joint.amplifier.max_current_a * (1.0 - 1e-9) for joint in cell.joints]
        self._truth: list[tuple[int, Sequence[JointState]] | None] = [None] * KEPT_CYCLES
        self.scores = [JointScore(lsb) for lsb in self._lsb_rad]

    def begin(self) -> None:
        """Forget the last run."""
        self.scores = [JointScore(lsb) for lsb in self._lsb_rad]
        self._truth = [None] * KEPT_CYCLES

    def truth(self, cycle: int, joints: Sequence[JointState]) -> None:
        """The true state at the SYNC of `cycle`."""
        self._truth[cycle % KEPT_CYCLES] = (cycle, joints)
        for joint, score, limit in zip(joints, self.scores, self._limit_a, strict=True):
            current = joint.current_a if joint.current_a >= 0.0 else -joint.current_a
            if current > score.peak_current_a:
                score.peak_current_a = current
            if joint.command_a >= limit or -joint.command_a >= limit:
                score.saturated_cycles += 1

    def reference(self, tick: int, joint: int, angle_rad: float) -> None:
        """The reference of one joint at `tick`; one that is too old or of a cycle that never was is dropped."""
        kept = self._truth[tick % KEPT_CYCLES]
        if kept is None or kept[0] != tick or tick < SETTLING_CYCLES:
            return
        score = self.scores[joint]
        error = (kept[1][joint].angle_rad - angle_rad) / score.lsb_rad
        score.samples += 1
        score.sum_of_squares += error * error
        score.max_lsb = max(score.max_lsb, abs(error))
