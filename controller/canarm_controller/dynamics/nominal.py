"""Chooses the form of the dynamics for the robots of a cell: the closed form if there is one, else Newton-Euler."""

from collections.abc import Sequence

from canarm_protocol.cell.model import Robot

from .arm import Arm
from .planar_pair import NominalArm, is_planar_pair
from .serial_arm import SerialArm
from .several import SeveralArms


def nominal_arm(robot: Robot) -> Arm:
    """The arm of a robot's nominal parameters: in closed form where there is one.

    Raises `DynamicsError` for more than 7 joints, or a parameter that is not finite.
    """
    return NominalArm.from_robot(robot) if is_planar_pair(robot) else SerialArm.from_robot(robot)


def cell_arm(robots: Sequence[Robot], joint_names: Sequence[str]) -> Arm:
    """The arms of all robots of a cell as one, joints in the order of `joint_names`, the cell's names for them.

    Raises `DynamicsError` as `nominal_arm` does.
    """
    arms = [nominal_arm(robot) for robot in robots]
    return arms[0] if len(arms) == 1 else SeveralArms(tuple(arms), tuple(joint_names))
