"""Which joints still rest on the arm's parking support, as far as the controller can know.

A robot leaves it when the first of its bridges is on: when a command is worth a code of its DAC. What is expected of a
joint that rests belongs to the watch of the arm.
"""

from collections.abc import Sequence

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import command_codec


class Support:
    """The resting joints: until `calm_cycles` after their robot was first driven, unless they move before."""

    def __init__(self, cell: Cell, standing_rad_s: Sequence[float], calm_cycles: int) -> None:
        self._standing_rad_s, self._calm_cycles = standing_rad_s, calm_cycles
        self._least_nm = [
            joint.motor.torque_per_ampere * joint.drive.max_current_a * 0.5 / command_codec(cell, index).full_scale
            for index, joint in enumerate(cell.joints)
        ]
        self._robots = [range(block.start, block.stop) for block in cell.blocks]
        self.start()

    def start(self) -> None:
        """All robots are parked."""
        self._parked = self._robots
        self.joints = list(range(len(self._least_nm)))
        """Resting joints."""
        self._calm_until = [0] * len(self._least_nm)

    def leave(self, cycle: int, acted_nm: Sequence[float], speed_rad_s: Sequence[float]) -> Sequence[int]:
        """Bring `joints` up to date in `cycle`, in which `acted_nm` acts. Returns joints now first driven."""
        freed: list[int] = []
        parked: list[range] = []
        for robot in self._parked:
            if any(abs(acted_nm[joint]) >= self._least_nm[joint] for joint in robot):
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
            if abs(speed_rad_s[joint]) < self._standing_rad_s[joint]
            and (joint in waiting or cycle < self._calm_until[joint])
        ]
        return freed
