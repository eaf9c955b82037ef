"""What a rig knows of the object that two robots carry: where it is, and the forces of the hands."""

from collections import deque

import numpy as np

from canarm_emulator.robot.carried import ObjectState
from canarm_protocol.cell.model import Carried, Cell
from canarm_protocol.shown import printable

from ..usage import UsageError
from .rig_joint import Floats, Joints


class RigObject:
    """The true object. Histories have one row per SYNC that is kept (`history_s` of `Rig`), oldest first.

    Positions are in m and forces in N, along the world's axes; forces are those of the hands on the object.
    """

    def __init__(self, carried: Carried, size: int) -> None:
        self._carried = carried
        self._kept: deque[tuple[float, ObjectState]] = deque(maxlen=size)

    def keep(self, time_s: float, state: ObjectState) -> tuple[str, ...]:
        """Take the truth of a SYNC. Returns the hands that have lost the object since the last."""
        before = self._kept[-1][1].lost if self._kept else ()
        self._kept.append((time_s, state))
        return tuple(hand for hand in state.lost if hand not in before)

    def __repr__(self) -> str:
        if not self._kept:
            return "<carried object: not known before the first cycle>"
        lost = f"lost by {', '.join(self.state.lost)}" if self.state.lost else "held by both hands"
        place = ", ".join(f"{each:.3f}" for each in self.state.position_m)
        return printable(f"<carried object: {len(self._kept)} cycles kept, {lost}, master's grip at {place} m>")

    @property
    def state(self) -> ObjectState:
        """The truth at the last SYNC. Raises `UsageError` before the first."""
        if not self._kept:
            raise UsageError("object: not known before the first cycle; run() first")
        return self._kept[-1][1]

    @property
    def is_held(self) -> bool:
        """Whether both hands hold it."""
        return not self.state.lost

    @property
    def time_s(self) -> Floats:
        """Virtual time of each SYNC."""
        return np.array([time_s for time_s, _ in self._kept])

    @property
    def position_m(self) -> Floats:
        """The master's grip, (cycles, 3)."""
        return self._vectors("position_m")

    @property
    def quaternion(self) -> Floats:
        """Its turn (w, x, y, z), (cycles, 4): the turned x axis points along the object."""
        return self._vectors("quaternion").reshape(-1, 4)

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
        return np.array([state.squeeze_n for _, state in self._kept])

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
        return np.array([getattr(state, name) for _, state in self._kept], dtype=np.float64).reshape(
            len(self._kept), -1
        )


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
