"""What a rig knows of the object that two robots carry: where it is, and the forces of the hands."""

from collections import deque

import numpy as np

from canarm_emulator.robot.carried import ObjectState
from canarm_protocol.cell.model import Carried, Cell
from canarm_protocol.shown import printable

from ..usage import UsageError
from .rig_joint import Floats, Joints

_COLUMNS = {
    "position_m": slice(1, 4),
    "quaternion": slice(4, 8),
    "master_force_n": slice(8, 11),
    "slave_force_n": slice(11, 14),
    "squeeze_n": slice(14, 15),
}
"""The columns of what is kept; the first is the time. Plain numbers: see `kept_frames.KeptFrames`."""
_WIDTH = 15


class RigObject:
    """The true object. Histories have one row per SYNC that is kept (`history_s` of `Rig`), oldest first.

    Positions are in m and forces in N, along the world's axes; forces are those of the hands on the object.
    """

    def __init__(self, carried: Carried, size: int) -> None:
        self._carried = carried
        self._kept: deque[float] = deque(maxlen=_WIDTH * size)
        """Of each SYNC the time, then what `_COLUMNS` names."""
        self._state: ObjectState | None = None

    def keep(self, time_s: float, state: ObjectState) -> tuple[str, ...]:
        """Take the truth of a SYNC. Returns the hands that have lost the object since the last."""
        before, self._state = self._state, state
        position_m, quaternion, master_n, slave_n, squeeze_n, is_in_master, is_in_slave, _ = state
        self._kept.extend((time_s, *position_m, *quaternion, *master_n, *slave_n, squeeze_n))
        if is_in_master and is_in_slave:
            return ()
        lost = () if before is None else before.lost
        return tuple(hand for hand in state.lost if hand not in lost)

    def __repr__(self) -> str:
        if self._state is None:
            return "<carried object: not known before the first cycle>"
        lost = f"lost by {', '.join(self.state.lost)}" if self.state.lost else "held by both hands"
        lost = lost if self.state.lost or self.is_held else "on its stand"
        place, cycles = ", ".join(f"{each:.3f}" for each in self.state.position_m), len(self._kept) // _WIDTH
        return printable(f"<carried object: {cycles} cycles kept, {lost}, master's grip at {place} m>")

    @property
    def state(self) -> ObjectState:
        """The truth at the last SYNC. Raises `UsageError` before the first."""
        if self._state is None:
            raise UsageError("object: not known before the first cycle; run() first")
        return self._state

    @property
    def is_held(self) -> bool:
        """Whether both hands hold it."""
        return self.state.is_in_master and self.state.is_in_slave

    @property
    def time_s(self) -> Floats:
        """Virtual time of each SYNC."""
        return self._rows()[:, 0]

    @property
    def position_m(self) -> Floats:
        """The master's grip, (cycles, 3)."""
        return self._vectors("position_m")

    @property
    def quaternion(self) -> Floats:
        """Its turn (w, x, y, z), (cycles, 4): the turned x axis points along the object."""
        return self._vectors("quaternion")

    @property
    def master_force_n(self) -> Floats:
        """(cycles, 3)."""
        return self._vectors("master_force_n")

    @property
    def slave_force_n(self) -> Floats:
        """(cycles, 3)."""
        return self._vectors("slave_force_n")

    @property
    def squeeze_n(self) -> Floats:
        """The slave's force along the object, (cycles,): positive where the hands press it together."""
        return self._vectors("squeeze_n")[:, 0]

    @property
    def grip_force_n(self) -> Floats:
        """The greater of the two hands' forces, (cycles,)."""
        both = np.stack([self.master_force_n, self.slave_force_n])
        return np.asarray(np.sqrt((both**2).sum(axis=2)).max(axis=0))

    @property
    def slip_force_n(self) -> float:
        """The force at which the nominal hand slips."""
        return self._carried.slip_force_n

    def _vectors(self, name: str) -> Floats:
        return self._rows()[:, _COLUMNS[name]]

    def _rows(self) -> Floats:
        return np.array(self._kept, dtype=np.float64).reshape(-1, _WIDTH)


class Carrying:
    """What a rig adds for robots that carry: `object`, and joints by robot."""

    cell: Cell
    joints: Joints
    _object: RigObject | None

    @property
    def object(self) -> RigObject:
        """The object that two robots carry. Raises `UsageError` if the cell has none."""
        __tracebackhide__ = True
        if self._object is None:
            raise UsageError(f"cell {self.cell.name!r} has no object")
        return self._object

    @property
    def robots(self) -> dict[str, Joints]:
        """The joints of each robot, by the robot's name and theirs in it."""
        joints = iter(self.joints.values())
        return {robot.name: Joints((joint.name, next(joints)) for joint in robot.joint) for robot in self.cell.robot}
