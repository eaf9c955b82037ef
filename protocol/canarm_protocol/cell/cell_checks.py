"""Whether the parts of a cell fit together: names, node-IDs, slots, wiring, times, ranges.

The schema in `model.py` says what a single value may be; here are the rules about several. Each problem is one line:
key, value, and what would be right.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from ..canopen.frames import HIGHEST_NODE_ID
from ..cards import KINDS, Wire
from .carried import carried_problems
from .homing import homing_problems
from .model import Bus, Card, Cell, Channel, Command, leaves
from .robot_checks import joint_problems, robot_problems
from .sensing import channel_scale, fitted_sensor
from .sensors import SENSOR_KINDS, AnalogueSensor

BENCH_NODE_IDS = range(0x70, HIGHEST_NODE_ID + 1)
"""With a lower node-ID, the bench node's COB-IDs would clash with its telemetry and its further SDO channels."""
LONGEST_TITLE = 200
MOST_JOINTS = 32
"""The bench node has COB-IDs for this many joints."""


def problems(cell: Cell) -> Iterator[str]:
    """Everything about a cell that does not fit together."""
    if not cell.title.isprintable() or len(cell.title) > LONGEST_TITLE:
        yield f"title = {cell.title!r}: must be one line of at most {LONGEST_TITLE} printable characters"
    yield from _bus_problems(cell.bus)
    yield from _repeated("robot.number", [robot.number for robot in cell.robot])
    yield from _repeated("robot.name", [robot.name for robot in cell.robot])
    for robot in cell.robot:
        yield from _repeated(f"robot {robot.name!r}.joint.name", [joint.name for joint in robot.joint])
    yield from _repeated("joint.name", cell.joint_names)
    yield from _repeated("card.name", [card.name for card in cell.card])
    if len(cell.joints) > MOST_JOINTS:
        yield f"robot.joint: {len(cell.joints)} joints; a cell has at most {MOST_JOINTS}"
    yield from _repeated("control.joint.name", [each.name for each in cell.control.joint])
    for each in cell.control.joint:
        if each.name not in cell.joint_names:
            yield f"control.joint {each.name!r}: no such joint; this cell has {_listed(cell.joint_names)}"
        for key in each.without_whole(cell.control):
            yield f"control.joint {each.name!r}.{key}: the cell has no [control.{key}] that it could differ from"
    for robot in cell.robot:
        yield from robot_problems(robot)
    for name, joint in zip(cell.joint_names, cell.joints, strict=True):
        yield from joint_problems(name, joint)
    if cell.object is not None:
        yield from carried_problems(cell.object, cell.robot)
    yield from _card_problems(cell)
    yield from _silence_problems(cell)
    robots = {robot.name for robot in cell.robot}
    wiring = list(_wiring_problems(cell))
    yield from wiring
    if not wiring and all(card.robot in robots for card in cell.card):
        yield from _unwired(cell)
        yield from _scan_problems(cell)
        yield from _counter_problems(cell)
        yield from homing_problems(cell)
        yield from _hand_problems(cell)


def _bus_problems(bus: Bus) -> Iterator[str]:
    timeout_ms = bus.heartbeat_timeout_ms
    if timeout_ms < 2 * bus.heartbeat_ms:
        yield (
            f"bus.heartbeat_timeout_ms = {timeout_ms}: must be at least twice heartbeat_ms = {bus.heartbeat_ms}, "
            "or one late heartbeat stops the robot"
        )
    if timeout_ms * 1000 < 2 * bus.cycle_us:
        yield (
            f"bus.heartbeat_timeout_ms = {timeout_ms}: must be at least two cycles (cycle_us = {bus.cycle_us}), "
            "the controller sends no more often than that"
        )
    if bus.bench_node_id not in BENCH_NODE_IDS:
        first, last = BENCH_NODE_IDS[0], BENCH_NODE_IDS[-1]
        yield f"bus.bench_node_id = 0x{bus.bench_node_id:02X}: must be 0x{first:02X} to 0x{last:02X}"
    if bus.controller_node_id == bus.bench_node_id:
        yield f"bus.controller_node_id = 0x{bus.controller_node_id:02X}: is bench_node_id; on the bench bus they meet"


def _silence_problems(cell: Cell) -> Iterator[str]:
    silent_ms, heartbeat_ms = cell.supervision.silent_card_ms, cell.bus.heartbeat_ms
    if silent_ms is not None and silent_ms < 2 * heartbeat_ms:
        yield (
            f"supervision.silent_card_ms = {silent_ms}: must be at least twice bus.heartbeat_ms = {heartbeat_ms}, "
            "or one late heartbeat stops the robot"
        )


def _card_problems(cell: Cell) -> Iterator[str]:
    numbers = {robot.name: robot.number for robot in cell.robot}
    slots: dict[tuple[str, int], Card] = {}
    nodes: dict[int, Card] = {}
    for card in cell.card:
        where, number = f"card {card.name!r}", numbers.get(card.robot)
        if number is None:
            yield f'{where}.robot = "{card.robot}": no such robot; this cell has {_listed(numbers)}'
        other = slots.setdefault((card.robot, card.slot), card)
        if other is not card:
            yield f"{where}.slot = {card.slot}: card {other.name!r} of the same robot is there; slots are 1 to 7"
        hint = f"; by slot it would be 0x{0x10 * number + card.slot:02X}" if number is not None else ""
        other = nodes.setdefault(card.node_id, card)
        if other is not card:
            yield f"{where}.node_id = 0x{card.node_id:02X}: card {other.name!r} has it already{hint}"
        if card.node_id == cell.bus.controller_node_id:
            yield f"{where}.node_id = 0x{card.node_id:02X}: is bus.controller_node_id{hint}"


def _wiring_problems(cell: Cell) -> Iterator[str]:
    joints = {robot.name: [joint.name for joint in robot.joint] for robot in cell.robot}
    holding = {robot.name for robot in cell.robot if robot.when_lost == "hold"}
    wired: dict[tuple[str, str], str] = {}
    for card in cell.card:
        allowed, count = leaves(card.kind.takes), card.kind.channels
        highest = card.kind.highest_error_value(card)
        seen: set[int] = set()
        for channel in card.channel:
            where = f"card {card.name!r}.channel {channel.number}"
            if channel.number in seen:
                yield f"{where}: is listed twice; give each wire its own channel"
            if channel.number > count:
                yield f"{where}: card model {card.model} has channels 1 to {count}"
            if card.robot in joints and channel.joint not in joints[card.robot]:
                known = _listed(joints[card.robot])
                yield f"{_signal(where, channel)}: robot {card.robot!r} has no joint {channel.joint!r}; it has {known}"
            elif channel.leaf not in allowed:
                yield f"{_signal(where, channel)}: card model {card.model} takes <joint>.{_listed(allowed, ' or ')}"
            elif channel.leaf in SENSOR_KINDS and card.robot in joints and fitted_sensor(cell, card, channel) is None:
                yield f"{_signal(where, channel)}: the joint has no [robot.joint.sensors.{channel.leaf}]"
            elif channel.error_value > highest:
                right = f"must be from 0 to {highest}" if highest else "an input has none; leave it out"
                yield f"{where}.error_value = {channel.error_value}: {right}"
            elif channel.error_value and card.robot in holding:
                yield (
                    f'{where}.error_value = {channel.error_value}: robot {card.robot!r} has when_lost = "hold", its '
                    "outputs keep their values; leave it out"
                )
            elif (card.robot, channel.signal) in wired:
                other = wired[card.robot, channel.signal]
                yield f"{_signal(where, channel)}: is wired to {other} already; wire it once"
            seen.add(channel.number)
            wired.setdefault((card.robot, channel.signal), where)


def _hand_problems(cell: Cell) -> Iterator[str]:
    """A hand is at the end of a robot that carries; an object on a stand needs both."""
    hands = cell.hands
    wired = set()
    for card in cell.card:
        for channel in card.channel:
            if channel.leaf == Command.GRIP:
                joint = cell.far_joint(card, channel)
                wired.add(joint)
                if joint not in hands:
                    ends = _listed((f"{cell.joint_names[end]}.{Command.GRIP}" for end in hands), " or ")
                    right = f"must be {ends}" if ends else "no robot of this cell carries an object; leave it out"
                    yield f"{_signal(f'card {card.name!r}.channel {channel.number}', channel)}: {right}"
    if cell.object is not None and cell.object.on_stand:
        for joint in sorted(hands.keys() - wired):
            yield (
                f"object.on_stand = true: {cell.joint_names[joint]}.{Command.GRIP} is not wired; a channel of card "
                "model sc300 takes it"
            )


def _unwired(cell: Cell) -> Iterator[str]:
    wired = {(card.robot, channel.signal) for card in cell.card for channel in card.channel}
    for robot in cell.robot:
        for joint in robot.joint:
            for leaf in (*joint.drive.commands, *(sensor.kind for sensor in joint.sensors.fitted())):
                if (robot.name, f"{joint.name}.{leaf}") not in wired:
                    models = _listed((each.model for each in KINDS.values() if leaf in leaves(each.takes)), " or ")
                    yield f'card.channel: "{joint.name}.{leaf}" is not wired; a channel of card model {models} takes it'


def _scan_problems(cell: Cell) -> Iterator[str]:
    """A converter scans all its wired channels every cycle, against one reference voltage."""
    bus = cell.bus
    for card in cell.card:
        if card.kind.takes is not Wire.VOLTAGE:
            continue
        scan_us = len(card.channel) * card.channel_us
        if scan_us + bus.compute_delay_us > bus.cycle_us:
            yield (
                f"card {card.name!r}.conversion_us = {card.channel_us}: a scan of {len(card.channel)} channels and "
                f"bus.compute_delay_us = {bus.compute_delay_us} do not fit into bus.cycle_us = {bus.cycle_us}"
            )
        references: dict[float, str] = {}
        for channel in card.channel:
            sensor = fitted_sensor(cell, card, channel)
            if isinstance(sensor, AnalogueSensor):
                references.setdefault(sensor.full_scale_v, channel.signal)
        if len(references) > 1:
            listed = _listed(f"{volts:g} ({signal})" for volts, signal in references.items())
            yield f"card {card.name!r}: its sensors' full_scale_v must be the same; they are {listed}"


def _counter_problems(cell: Cell) -> Iterator[str]:
    """A counter that wraps round within its joint's limits shows one code for two angles."""
    for card in cell.card:
        if card.kind.takes is not Wire.PULSES:
            continue
        bits = card.codec.bits
        for channel in card.channel:
            joint, scale = cell.far_joint(card, channel), channel_scale(cell, card, channel)
            low, high = cell.joints[joint].limits_deg
            first, last = sorted(math.degrees(scale(code)) for code in (-(1 << bits - 1), (1 << bits - 1) - 1))
            if low < first or high > last:
                yield (
                    f"joint {cell.joint_names[joint]!r}.limits_deg = [{low:g}, {high:g}]: at "
                    f"{math.degrees(scale.lsb):.3g} degrees a count, counter_bits = {bits} of card {card.name!r} show "
                    f"{first:.4g} to {last:.4g} degrees, then wrap round; stay within, or take more bits or fewer lines"
                )


def _repeated(key: str, values: Sequence[object]) -> Iterator[str]:
    for value, count in Counter(values).items():
        if count > 1:
            yield f"{key} = {value!r}: is used {count} times; each must be unique"


def _signal(where: str, channel: Channel) -> str:
    return f'{where}.signal = "{channel.signal}"'


def _listed(names: Iterable[object], joiner: str = ", ") -> str:
    return joiner.join(map(str, names))
