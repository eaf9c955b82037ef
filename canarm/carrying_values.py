"""What cards must give a robot that is to be carried without a controller: the currents of its weight at home.

Owns what a cell's file has to say of them. What cards do with error values never enters.
"""

import math
from collections.abc import Iterator

from canarm_controller.dynamics import cell_arm
from canarm_controller.run.carrying import CarryingCodes
from canarm_protocol.cell.model import Card, Cell, Channel, Command
from canarm_protocol.cell.wiring import DirectionBits, bridge_directions, command_scale

CARRY = "carry"


def with_carrying_values(cell: Cell) -> Cell:
    """`cell`, with the error values that robots whose `when_lost` is "carry" need. Raises `DynamicsError`."""
    robots = {robot.name for robot in cell.robot if robot.when_lost == CARRY}
    if not robots:
        return cell
    values = _carrying_values(cell)

    def carrying(card: Card, channel: Channel) -> Channel:
        value = values.get((cell.far_joint(card, channel), channel.leaf))
        return channel if value is None else channel.model_copy(update={"error_value": value})

    cards = [
        card.model_copy(update={"channel": tuple(carrying(card, channel) for channel in card.channel)})
        if card.robot in robots
        else card
        for card in cell.card
    ]
    return cell.model_copy(update={"card": tuple(cards)})


def carrying_problems(cell: Cell) -> Iterator[str]:
    """A line for each joint whose error values leave more than its friction holds at home. Raises `DynamicsError`."""
    robots = [robot for robot in cell.robot for _ in robot.joint]
    if not any(robot.when_lost == CARRY for robot in robots):
        return
    given = {
        (cell.far_joint(card, channel), channel.leaf): channel.error_value
        for card in cell.card
        for channel in card.channel
    }
    needed = _carrying_values(cell)
    rows = zip(robots, cell.joints, cell.joint_names, _weights_nm(cell), strict=True)
    for index, (robot, joint, name, weight_nm) in enumerate(rows):
        if robot.when_lost != CARRY:
            continue
        code, bits = given[index, Command.CURRENT], given[index, Command.DIRECTION]
        ways = dict(zip(bridge_directions(cell, index), (-1.0, 1.0), strict=True))
        way = ways.get(DirectionBits(bits), 0.0)
        left_nm = way * command_scale(cell, index)(code) * abs(joint.motor.torque_per_ampere)
        if abs(left_nm - weight_nm) > joint.motor.coulomb_friction_nm:
            yield (
                f'robot {robot.name!r}.when_lost = "carry": error_value {code} of the current of joint {name!r} and '
                f"{bits} of its direction are {left_nm:.3g} N m; at home its weight is {weight_nm:.3g} N m, friction "
                f"holds {joint.motor.coulomb_friction_nm:.3g} of it: must be {needed[index, Command.CURRENT]} and "
                f"{needed[index, Command.DIRECTION]}"
            )


def _weights_nm(cell: Cell) -> tuple[float, ...]:
    arm = cell_arm(cell.laden, cell.joint_names)
    return tuple(arm.gravity([math.radians(joint.home_deg) for joint in cell.joints]))


def _carrying_values(cell: Cell) -> dict[tuple[int, str], int]:
    return CarryingCodes(cell).of(_weights_nm(cell))
