"""Bounded memory of a run: the bench's samples and the controller's references in preallocated arrays.

Only received values by cycle; errors, rates and texts are derived elsewhere.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FIELDS = 4
"""Values per joint in a sample: angle (rad), speed (rad/s), current (A), command (A)."""
_NO_TICK = -1


class SampleRing:
    """The last `capacity` samples: cycle and `FIELDS` values per joint, in order of arrival."""

    def __init__(self, capacity: int, joints: int) -> None:
        self._cycles = np.zeros(capacity, dtype=np.int64)
        self._rows = np.zeros((capacity, joints * FIELDS), dtype=np.float64)
        self._values = self._rows.reshape(capacity, joints, FIELDS)
        self._capacity = capacity
        self._written = 0
        self.changes = 0
        """Grows with each addition and each clearing."""

    def append(self, cycle: int, row: Sequence[float]) -> None:
        """Add one sample; `row` has `FIELDS` values for each joint in turn."""
        slot = self._written % self._capacity
        self._cycles[slot] = cycle
        self._rows[slot] = row
        self._written += 1
        self.changes += 1

    def clear(self) -> None:
        """Forget all samples."""
        self._written = 0
        self.changes += 1

    def since(self, cycle: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Copies of the samples from `cycle` on, oldest first: cycles (n,) and values (n, joints, FIELDS)."""
        count = min(self._written, self._capacity)
        order = np.arange(self._written - count, self._written) % self._capacity
        order = order[self._cycles[order] >= cycle]
        return self._cycles[order], self._values[order]


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
