"""Which joints still rest on the arm's parking support, as far as the controller can know.

A robot leaves it when the first of its bridges is on: when a command is worth a code of its DAC. What is expected of a
joint that rests belongs to the watch of the arm.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import command_codec


class Support:
    """The resting joints: until `calm_cycles` after their robot was first driven, unless they move before.

    A joint moves that is faster than `standing_rad_s`, or further than `moved_rad` from where it was.
    """

    def __init__(
        self, cell: Cell, standing_rad_s: Sequence[float], moved_rad: Sequence[float], calm_cycles: int
    ) -> None:
        self._standing_rad_s, self._moved_rad, self._calm_cycles = standing_rad_s, moved_rad, calm_cycles
        self._least_nm = [
            joint.motor.torque_per_ampere * joint.drive.max_current_a * 0.5 / command_codec(cell, index).full_scale
            for index, joint in enumerate(cell.joints)
        ]
        self._robots = [range(block.start, block.stop) for block in cell.blocks]
        self.start((0.0,) * len(self._least_nm))

    def start(self, position_rad: Sequence[float]) -> None:
        """All robots are parked at these angles."""
        self._parked, self._from_rad = self._robots, position_rad
        self.joints = list(range(len(self._least_nm)))
        """Resting joints."""
        self._calm_until = [0] * len(self._least_nm)
        self.began_moving = False
        """Whether a robot has never been parked: it moved before it was driven."""

    def leave(
        self, cycle: int, acted_nm: Sequence[float], position_rad: Sequence[float], speed_rad_s: Sequence[float]
    ) -> Sequence[int]:
        """Bring `joints` up to date in `cycle`, in which `acted_nm` acts. Returns joints now first driven.

        A robot that moves before it is driven has never been parked.
        """
        freed: list[int] = []
        parked: list[range] = []
        for robot in self._parked:
            moves = any(self._is_off(joint, position_rad, speed_rad_s) for joint in robot)
            self.began_moving = self.began_moving or moves
            if moves or any(abs(acted_nm[joint]) >= self._least_nm[joint] for joint in robot):
                freed += robot
            else:
                parked.append(robot)
        self._parked = parked
        for joint in freed:
            self._calm_until[joint] = cycle + self._calm_cycles
        waiting = {joint for robot in parked for joint in robot}
        self.joints = [
            joint
            for joint in self.joints
            if not self._is_off(joint, position_rad, speed_rad_s)
            and (joint in waiting or cycle < self._calm_until[joint])
        ]
        return freed

    def _is_off(self, joint: int, position_rad: Sequence[float], speed_rad_s: Sequence[float]) -> bool:
        """Whether it moves, or has moved."""
        return (
            abs(speed_rad_s[joint]) >= self._standing_rad_s[joint]
            or abs(position_rad[joint] - self._from_rad[joint]) >= self._moved_rad[joint]
        )
