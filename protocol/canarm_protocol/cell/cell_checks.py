"""Whether the parts of a cell fit together: names, node-IDs, slots, wiring, times, ranges.

What one value may be, the schema in `cell.py` says; here are the rules that look at several. Each problem is one line:
key, value, and what would be right.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from .model import CHANNEL_COUNT, CHANNELS_OF, Bus, Card, CardModel, Cell, Channel, Joint, Quantity

BENCH_NODE_IDS = range(0x70, 0x80)
"""Below them, the COB-IDs of the bench node would meet those of its telemetry and its further SDO channels."""
HIGHEST_ERROR_VALUE = {CardModel.DAC0808: 255, CardModel.LATCH: 0b10, CardModel.ADC0809: 0}
"""Of an output channel: an 8-bit code; two direction bits, of which 11 is refused."""
MOST_JOINTS = 32
"""The bench node's COB-IDs are laid out for as many."""


def problems(cell: Cell) -> Iterator[str]:
    """Everything about a cell that does not fit together."""
    yield from _bus_problems(cell.bus)
    yield from _repeated("robot.number", [robot.number for robot in cell.robot])
    yield from _repeated("robot.name", [robot.name for robot in cell.robot])
    yield from _repeated("joint.name", cell.joint_names)
    yield from _repeated("card.name", [card.name for card in cell.card])
    if len(cell.joints) > MOST_JOINTS:
        yield f"robot.joint: {len(cell.joints)} joints; a cell has at most {MOST_JOINTS}"
    for joint in cell.joints:
        yield from _joint_problems(joint)
    yield from _card_problems(cell)
    wiring = list(_wiring_problems(cell))
    yield from wiring or _unwired(cell)
    if not wiring:
        yield from _scan_problems(cell)


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


def _joint_problems(joint: Joint) -> Iterator[str]:
    where, sensors = f"joint {joint.name!r}", joint.sensors
    low, high = joint.limits_deg
    full_v, zero_v, tachometer_v = sensors.full_scale_v, sensors.potentiometer_zero_v, sensors.tachometer_zero_v
    if not low < high:
        yield f"{where}.limits_deg = [{low:g}, {high:g}]: must be [lower, upper] with lower < upper"
    elif not low <= joint.home_deg <= high:
        yield f"{where}.home_deg = {joint.home_deg:g}: must lie within limits_deg = [{low:g}, {high:g}]"
    if not tachometer_v or tachometer_v >= full_v:
        yield f"{where}.sensors.tachometer_zero_v = {tachometer_v:g}: must lie between 0 and full_scale_v = {full_v:g}"
    if zero_v > full_v:
        yield f"{where}.sensors.potentiometer_zero_v = {zero_v:g}: must be at most full_scale_v = {full_v:g}"
        return
    range_deg = sensors.potentiometer_range_deg
    lowest, highest = -range_deg * zero_v / full_v, range_deg * (1.0 - zero_v / full_v)
    if low < lowest or high > highest:
        yield (
            f"{where}.limits_deg = [{low:g}, {high:g}]: the potentiometer sees {lowest:g} to {highest:g} degrees; "
            "stay within"
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
    wired: dict[str, str] = {}
    for card in cell.card:
        allowed, count = CHANNELS_OF[card.model], CHANNEL_COUNT[card.model]
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
            elif channel.quantity not in allowed:
                yield f"{_signal(where, channel)}: card model {card.model} takes <joint>.{_listed(allowed, ' or ')}"
            elif channel.error_value > HIGHEST_ERROR_VALUE[card.model]:
                highest = HIGHEST_ERROR_VALUE[card.model]
                right = f"must be from 0 to {highest}" if highest else "an input has none; leave it out"
                yield f"{where}.error_value = {channel.error_value}: {right}"
            elif channel.signal in wired:
                yield f"{_signal(where, channel)}: is wired to {wired[channel.signal]} already; wire it once"
            seen.add(channel.number)
            wired.setdefault(channel.signal, where)


def _unwired(cell: Cell) -> Iterator[str]:
    wired = {channel.signal for card in cell.card for channel in card.channel}
    for joint in cell.joint_names:
        for quantity in Quantity:
            if f"{joint}.{quantity}" not in wired:
                models = _listed((model for model, allowed in CHANNELS_OF.items() if quantity in allowed), " or ")
                yield f'card.channel: "{joint}.{quantity}" is not wired; a channel of card model {models} takes it'


def _scan_problems(cell: Cell) -> Iterator[str]:
    """An ADC converts all its wired channels in every cycle, against one reference voltage."""
    bus, joints = cell.bus, {joint.name: joint for joint in cell.joints}
    for card in cell.card:
        if card.model is not CardModel.ADC0809:
            continue
        scan_us = len(card.channel) * card.conversion_us
        if scan_us + bus.compute_delay_us > bus.cycle_us:
            yield (
                f"card {card.name!r}.conversion_us = {card.conversion_us}: a scan of {len(card.channel)} channels and "
                f"bus.compute_delay_us = {bus.compute_delay_us} do not fit into bus.cycle_us = {bus.cycle_us}"
            )
        references = {joints[channel.joint].sensors.full_scale_v: channel.joint for channel in card.channel}
        if len(references) > 1:
            listed = _listed(f"{volts:g} ({joint})" for volts, joint in references.items())
            yield f"card {card.name!r}: its joints' sensors.full_scale_v must be the same; they are {listed}"


def _repeated(key: str, values: Sequence[object]) -> Iterator[str]:
    for value, count in Counter(values).items():
        if count > 1:
            yield f"{key} = {value!r}: is used {count} times; each must be unique"


def _signal(where: str, channel: Channel) -> str:
    return f'{where}.signal = "{channel.signal}"'


def _listed(names: Iterable[object], joiner: str = ", ") -> str:
    return joiner.join(map(str, names))
