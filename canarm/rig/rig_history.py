"""A rig's memory of a run: the last controlled cycles in a ring, then the truth through the stop.

Filled cycle by cycle; `rig_joint.py` answers questions about it.
"""

import struct
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from canarm_controller.bus.assessment import JointFigures
from canarm_emulator.bench.bench import CycleTruth
from canarm_emulator.bench_node.assessor import Assessor
from canarm_protocol.cell.model import Cell

from ..usage import UsageError
from .rig_joint import SIGNALS, TRUE_SIGNALS, Floats, Span


class Event(NamedTuple):
    """An event: virtual time in s, what happened, and its details."""

    time_s: float
    event: str
    detail: str


class History:
    """The course of a run; see `canarm.rig.rig_joint.Source`. `size` bounds the number of controlled cycles kept.

    A row holds the time, then `SIGNALS` of every joint.
    """

    def __init__(self, cell: Cell, size: int, assessor: Assessor, controlled: Callable[[], int]) -> None:
        self.rows: Floats = np.zeros((size, 1 + len(SIGNALS) * len(cell.joints)))
        self._memory = self.rows.data
        self._size, self._row = size, struct.Struct(f"{self.rows.shape[1]}d")
        self._assessor, self._controlled = assessor, controlled
        self._stop: list[CycleTruth] = []

    def tick(self, cycle: int, row: Sequence[float]) -> None:
        """The row of controlled cycle number `cycle`, from 0."""
        self._row.pack_into(self._memory, cycle % self._size * self._row.size, *row)

    def stopping(self, last: CycleTruth | None, truth: CycleTruth) -> None:
        """The truth at a SYNC of the stop; `last` is that of the SYNC in whose cycle the stop began."""
        if not self._stop and last is not None and last.cycle >= self._controlled():
            self._stop.append(last)
        self._stop.append(truth)

    def column(self, joint: int, signal: str) -> Floats:
        """One signal over the controlled cycles, oldest first."""
        place = 0 if signal == "time_s" else 1 + joint * len(SIGNALS) + SIGNALS.index(signal)
        values, cycles = self.rows[:, place], self._controlled()
        size = len(values)
        if cycles <= size:
            return values[:cycles].copy()
        return np.roll(values, -(cycles % size))

    def span(self, joint: int, signal: str) -> Span:
        """One signal with cycles and times; a true signal continues through the stop."""
        times_s, values = self.column(joint, "time_s"), self.column(joint, signal)
        controlled = self._controlled()
        cycles = np.arange(controlled - len(values), controlled)
        field = SIGNALS.index(signal)
        if field >= TRUE_SIGNALS or not self._stop:
            return Span(cycles, times_s, values)
        return Span(
            np.append(cycles, [truth.cycle for truth in self._stop]),
            np.append(times_s, [truth.time_ns * 1e-9 for truth in self._stop]),
            np.append(values, [truth.joints[joint][field] for truth in self._stop]),
        )

    def figures(self, joint: int) -> JointFigures:
        """The bench's figures so far."""
        score = self._assessor.scores[joint]
        return JointFigures(
            rms_lsb=score.rms_lsb if score.samples else None,
            max_lsb=score.max_lsb if score.samples else None,
            peak_current_a=score.peak_current_a,
            saturated_cycles=score.saturated_cycles,
            speed_ripple=score.speed_ripple or None,
        )


def history_of(cell: Cell, size: int, assessor: Assessor, controlled: Callable[[], int]) -> History:
    """A memory of `size` cycles. Raises `UsageError` if there is not that much."""
    try:
        return History(cell, size, assessor, controlled)
    except (MemoryError, ValueError, OverflowError):
        seconds = size * cell.bus.cycle_s
        raise UsageError(f"history_s {seconds:g}: {size:.2g} cycles do not fit into memory; take less") from None
