"""Which robots still rest on their supports: each does until the first of its own bridges is on while time passes.

Two robots that carry an object rest together.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell

from .drives import DriveModel


class Parking:
    """Every robot of a cell rests at first."""

    __slots__ = ("_resting",)

    def __init__(self, cell: Cell) -> None:
        resting = [list(range(block.start, block.stop)) for block in cell.blocks]
        if cell.object is not None:
            names = [robot.name for robot in cell.robot]
            master, slave = names.index(cell.object.master), names.index(cell.object.slave)
            resting[master] += resting[slave]
            del resting[slave]
        self._resting = resting

    @property
    def joints(self) -> list[int]:
        """The joints (indices into `Cell.joints`) that a support carries."""
        return [joint for robot in self._resting for joint in robot]

    def free(self, drives: Sequence[DriveModel]) -> bool:
        """Free each robot that has a bridge on. Whether any was freed."""
        resting = [robot for robot in self._resting if not any(drives[joint].is_on for joint in robot)]
        is_changed = len(resting) < len(self._resting)
        self._resting = resting
        return is_changed
