"""Bounded memory of a run: the rows that are kept, and the controller's references until their rows have come.

Only received values by cycle; errors, rates and texts are derived elsewhere.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .history import COLUMNS, Column, History

_NO_TICK = -1
RECENT_ROWS = 256
"""What comes later than so many rows after its own is not kept."""


class RowStore:
    """The last `capacity` rows at least, as one stretch of an array, so that a `History` needs no copy.

    A full array is not overwritten but left to those who draw from it: a screen that stands still keeps its data.
    """

    def __init__(self, capacity: int, joints: int) -> None:
        self._capacity, self._joints = capacity, joints
        self._begin = self._end = 0
        self.changes = 0
        """Grows with each addition and each clearing."""
        self._allocate()

    def append(self, cycle: int, row: NDArray[np.float32]) -> None:
        """Add a row (joints, COLUMNS); it is copied."""
        if self._end == len(self._cycles):
            old = self._rows(self._capacity - 1)
            self._allocate()
            self._begin, self._end = 0, len(old.cycles)
            self._cycles[: self._end], self._values[: self._end] = old.cycles, old.values
        self._cycles[self._end], self._values[self._end] = cycle, row
        self._end += 1
        self._begin = max(self._begin, self._end - self._capacity)
        self.changes += 1

    def clear(self) -> None:
        """Forget all rows; whoever draws from them keeps them."""
        self._allocate()
        self._begin = self._end = 0
        self.changes += 1

    def history(self, most: int | None = None) -> History:
        """The rows that are kept, or the last `most` of them; read-only. References may still be filled in."""
        rows = self._rows(most)
        for array in (rows.cycles, rows.values):
            array.flags.writeable = False
        return rows

    def put(self, cycle: int, joint: int, column: int, values: Sequence[float]) -> None:
        """Write further values of `joint`, from `column` on, into the row of `cycle`, if there is one."""
        rows = self._rows(RECENT_ROWS)
        row = int(np.searchsorted(rows.cycles, cycle))
        if row < len(rows.cycles) and rows.cycles[row] == cycle:
            rows.values[row, joint, column : column + len(values)] = values

    def fill_references(self, references: "ReferenceRing", most: int, lsb_rad: NDArray[np.float64]) -> None:
        """Fill in references, and errors, of those of the last `most` rows whose reference has come since."""
        rows = self._rows(most)
        open_rows = np.flatnonzero(np.isnan(rows.values[:, :, Column.REFERENCE]).any(axis=1))
        if not len(open_rows):
            return
        found = references.at(rows.cycles[open_rows])
        with np.errstate(invalid="ignore", over="ignore"):
            error = (rows.values[open_rows, :, Column.ANGLE] - found) / lsb_rad
            error[~np.isfinite(error)] = np.nan
            rows.values[open_rows, :, Column.REFERENCE] = found
            rows.values[open_rows, :, Column.ERROR] = error

    def _rows(self, most: int | None) -> History:
        begin = self._begin if most is None else max(self._begin, self._end - most)
        return History(self._cycles[begin : self._end], self._values[begin : self._end])

    def _allocate(self) -> None:
        self._cycles = np.zeros(2 * self._capacity, dtype=np.int64)
        self._values = np.full((2 * self._capacity, self._joints, COLUMNS), np.nan, dtype=np.float32)


class ReferenceRing:
    """The references of each joint for the last `capacity` ticks, by tick."""

    def __init__(self, capacity: int, joints: int) -> None:
        self._ticks = np.full((joints, capacity), _NO_TICK, dtype=np.int64)
        self._angles_rad = np.zeros((joints, capacity), dtype=np.float64)
        self._capacity = capacity
        self.last_ticks = [_NO_TICK] * joints
        """The newest tick of each joint; -1 if there is none."""
        self.changes = 0
        """Grows with each addition and each clearing."""

    def put(self, joint: int, tick: int, angle_rad: float) -> None:
        """Keep the reference of `joint` at `tick`."""
        slot = tick % self._capacity
        self._ticks[joint, slot] = tick
        self._angles_rad[joint, slot] = angle_rad
        self.last_ticks[joint] = tick
        self.changes += 1

    def clear(self, joint: int) -> None:
        """Forget the references of one joint."""
        self._ticks[joint] = _NO_TICK
        self.last_ticks[joint] = _NO_TICK
        self.changes += 1

    def at(self, ticks: NDArray[np.int64]) -> NDArray[np.float64]:
        """References in rad at `ticks` (n,), NaN where missing; shape (n, joints)."""
        slots = ticks % self._capacity
        found = np.where(self._ticks[:, slots] == ticks, self._angles_rad[:, slots], np.nan)
        return np.ascontiguousarray(found.T)
