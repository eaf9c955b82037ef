"""What is kept of a run: a row per telemetry cycle with everything that is known of each joint. Values only.

Rows are written by the feed, or come from a record; errors are derived there. Nothing is drawn here.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.bench_objects import INTERNALS


class Column(IntEnum):
    """The values of one joint in a row; NaN where not known."""

    ANGLE = 0
    """True, rad."""
    SPEED = 1
    """True, rad/s."""
    CURRENT = 2
    """In the motor, A."""
    COMMAND = 3
    """Of the amplifier, A."""
    MEASURED = 4
    """Angle that the controller has measured, rad."""
    MEASURED_SPEED = 5
    """rad/s."""
    ASKED = 6
    """Current that the law has asked for, A."""
    FEEDFORWARD = 7
    """Torque, N m."""
    INTERNAL = 8
    """First of the law's internal values."""
    REFERENCE = 8 + INTERNALS
    """rad."""
    ERROR = 9 + INTERNALS
    """True angle minus reference, in steps of the position sensor."""


COLUMNS = len(Column) + INTERNALS - 1
TRUE_COLUMNS = 4
"""What the bench sends: angle, speed, current, command."""
REPORTED_COLUMNS = 4 + INTERNALS
"""What the controller says, from `MEASURED` on."""


def _no_cycles() -> NDArray[np.int64]:
    return np.zeros(0, dtype=np.int64)


def _no_values() -> NDArray[np.float32]:
    return np.zeros((0, 0, COLUMNS), dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Rows in the order of their cycles: `cycles` (n,) and `values` (n, joints, COLUMNS). Nobody may write them."""

    cycles: NDArray[np.int64] = field(default_factory=_no_cycles)
    values: NDArray[np.float32] = field(default_factory=_no_values)

    def between(self, first: int, last: int) -> "History":
        """The rows of the cycles `first` to `last`, both included; a view, no copy."""
        begin, end = np.searchsorted(self.cycles, first, "left"), np.searchsorted(self.cycles, last, "right")
        return History(self.cycles[begin:end], self.values[begin:end])

    def row_at(self, cycle: int) -> int | None:
        """The place of the last row that is not later than `cycle`; None before the first."""
        place = int(np.searchsorted(self.cycles, cycle, "right")) - 1
        return place if place >= 0 else None
