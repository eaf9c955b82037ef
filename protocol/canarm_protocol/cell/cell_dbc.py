"""The CAN databases of a cell: every message of the robot's bus and of the bench bus, its signals in physical units.

Offsets, COB-IDs and scales come from the dictionaries and the wiring; only names, units and comments are here.
"""

from collections.abc import Iterator, Mapping

from canopen.objectdictionary import datatypes

from ..canopen.dictionary import Dictionary, default_value, variable_at
from ..canopen.frames import HIGHEST_NODE_ID, Cob, ErrorCode, NmtCommand, NmtState
from ..canopen.pdo import MappedObject, PdoLayout, read_layouts
from .bench_objects import (
    ACTIVE_FAULTS,
    BEGUN_FAULTS,
    CONTROLLER_CHANNEL,
    CONTROLLER_STATE,
    CONTROLLER_STATES,
    CURRENT_COMMAND,
    CYCLE,
    DETECTION_PIECE,
    DETECTIONS,
    DIVIDER,
    EMERGENCY_STOP,
    FEED_FORWARD,
    INTERNAL,
    INTERNALS,
    LATE,
    MEASURED_ANGLE,
    MEASURED_SPEED,
    REFERENCE,
    TICK,
    TRUE_ANGLE,
    TRUE_COMMAND,
    TRUE_CURRENT,
    TRUE_SPEED,
    bench_dictionary,
)
from .configuration import SYNC_COUNTER
from .dbc_file import ANY_NODE, NAME_LENGTH, Database, Message, Signal, short_names
from .model import SENSOR_KINDS, Cell, Command, Joint, Quantity
from .table import DEGREE
from .wiring import CardNode, DirectionBits, HandBits, WiredSignal, card_nodes, wired_signals

CONTROLLER, BENCH = "controller", "bench"
ROBOT_BUS, BENCH_BUS = "can0", "bench"
SIGNAL_NAMES = {
    CYCLE: "cycle",
    ACTIVE_FAULTS: "active_faults",
    BEGUN_FAULTS: "begun_faults",
    EMERGENCY_STOP: "emergency_stop",
    DETECTIONS: "detections",
    DETECTION_PIECE: "detection_text",
    TRUE_ANGLE: "true_angle",
    TRUE_SPEED: "true_speed",
    TRUE_CURRENT: "motor_current",
    TRUE_COMMAND: "amplifier_command",
    TICK: "tick",
    LATE: "late_cycles",
    CONTROLLER_STATE: "state",
    REFERENCE: "reference",
    MEASURED_ANGLE: "measured_angle",
    MEASURED_SPEED: "measured_speed",
    CURRENT_COMMAND: "current_command",
    FEED_FORWARD: "feed_forward",
    **{INTERNAL + number: f"internal_{number + 1}" for number in range(INTERNALS)},
}
"""Signal names of the bench node's objects, as short as the format asks for."""
_JOINT_NAME_LENGTH = NAME_LENGTH - 1 - max(map(len, (*SIGNAL_NAMES.values(), *Command, *SENSOR_KINDS)))
_NODE_NAME_LENGTH = NAME_LENGTH - len("_SDO_response_9")
_LATCH_WORDS: Mapping[str, type[DirectionBits | HandBits]] = {Command.DIRECTION: DirectionBits, Command.GRIP: HandBits}
_UNITS = {
    Quantity.POSITION: "deg",
    Quantity.VELOCITY: "rad/s",
    Quantity.CURRENT: "A",
    None: "A",
}
REVERSED = "a reversed drive: counter-clockwise drives the joint towards negative angles"
_CYCLIC_TYPES = range(1, 241)
_SDO_SERVERS = range(0x1200, 0x1280)
_SDO_COMMANDS = {
    0x23: "write 4 bytes",
    0x27: "write 3 bytes",
    0x2B: "write 2 bytes",
    0x2F: "write 1 byte",
    0x40: "read",
    0x43: "is 4 bytes",
    0x47: "is 3 bytes",
    0x4B: "is 2 bytes",
    0x4F: "is 1 byte",
    0x60: "written",
    0x80: "abort",
}
"""Command specifiers of expedited transfers and abort (CiA 301, 7.2.4.3)."""
_DAY_MS = 86_400_000


def robot_database(cell: Cell) -> Database:
    """The robot's bus: controller and cards."""
    nodes = card_nodes(cell)
    names = short_names((CONTROLLER, *(_key(node) for node in nodes)), _NODE_NAME_LENGTH)
    cards = tuple(names[_key(node)] for node in nodes)
    joints = short_names(cell.joint_names, _JOINT_NAME_LENGTH)
    messages = list(_network_messages(cell, nodes, cards))
    messages.append(_heartbeat(cell, CONTROLLER, cell.bus.controller_node_id, cards))
    for node, card in zip(nodes, cards, strict=True):
        node_id, to_controller = node.card.node_id, (CONTROLLER,)
        messages.append(_emergency(card, node_id, to_controller))
        messages.append(_heartbeat(cell, card, node_id, to_controller))
        messages += _sdo_messages(card, node.dictionary, {0: CONTROLLER})
        for layout in (*node.rpdos, *node.tpdos):
            signals = tuple(
                wired_signal(wired, joints[cell.joint_names[wired.joint]], cell.joints[wired.joint])
                for wired in wired_signals(cell, node, layout)
            )
            messages.append(_pdo(cell, card, CONTROLLER, layout, signals))
    comments = [f"{node.card.model} card in slot {node.card.slot} of {node.card.robot}" for node in nodes]
    described = {
        CONTROLLER: "Controller under test: NMT master, SYNC producer",
        **dict(zip(cards, comments, strict=True)),
    }
    return Database(f"{cell.name}_{ROBOT_BUS}", cell.bus.bitrate, described, tuple(messages))


def bench_database(cell: Cell) -> Database:
    """The bench bus: the bench node's telemetry, what the controller reports to it, its SDO channels."""
    dictionary, node_id = bench_dictionary(cell), cell.bus.bench_node_id
    joints = list(short_names(cell.joint_names, _JOINT_NAME_LENGTH).values())
    messages = [
        _emergency(BENCH, node_id, ()),
        _heartbeat(cell, BENCH, node_id, (), is_cyclic=False),
        *_sdo_messages(BENCH, dictionary, {CONTROLLER_CHANNEL: CONTROLLER}),
    ]

    def read(index: int, subindex: int) -> int:
        return default_value(dictionary, index, subindex)

    for layout in (*read_layouts(dictionary, "rpdo", read), *read_layouts(dictionary, "tpdo", read)):
        signals = tuple(
            _bench_signal(dictionary, mapped, start_bit, joints)
            for mapped, start_bit in zip(layout.objects, layout.bit_offsets, strict=True)
        )
        messages.append(_pdo(cell, BENCH, CONTROLLER, layout, signals, _telemetry_ms(cell, layout)))
    described = {
        CONTROLLER: "Controller under test: reports what it does",
        BENCH: "Emulated test bench: sends the true state while it sees a listener's heartbeat",
    }
    return Database(f"{cell.name}_{BENCH_BUS}", cell.bus.bitrate, described, tuple(messages))


def _network_messages(cell: Cell, nodes: tuple[CardNode, ...], cards: tuple[str, ...]) -> Iterator[Message]:
    node_ids = {0: "all", **{node.card.node_id: card for node, card in zip(nodes, cards, strict=True)}}
    commands = Signal("command", 0, 8, maximum=255, choices=_words(NmtCommand, "-"))
    node_id = Signal("node_id", 8, 8, maximum=HIGHEST_NODE_ID, choices=node_ids)
    yield Message(Cob.NMT, "NMT", 2, CONTROLLER, cards, (commands, node_id), comment="NMT node control")
    counter = (Signal("counter", 0, 8, minimum=1, maximum=SYNC_COUNTER),)
    comment = "Inputs are scanned; outputs received since the last one act"
    period_ms = cell.bus.cycle_us / 1000
    yield Message(Cob.SYNC, "SYNC", len(counter), CONTROLLER, cards, counter, period_ms, comment)
    clock = (
        Signal("milliseconds", 0, 28, maximum=_DAY_MS - 1, unit="ms", comment="Since midnight"),
        Signal("days", 32, 16, maximum=0xFFFF, unit="d", comment="Since 1984-01-01"),
    )
    yield Message(Cob.TIME, "TIME", 6, ANY_NODE, (CONTROLLER,), clock, comment="In lockstep: ends a cycle")


def _emergency(name: str, node_id: int, receivers: tuple[str, ...]) -> Message:
    signals = (
        Signal("error_code", 0, 16, maximum=0xFFFF, choices=_words(ErrorCode)),
        Signal("error_register", 16, 8, maximum=0xFF, comment="Bits as in 0x1001: 0 generic, 4 communication"),
        Signal("manufacturer", 24, 40, maximum=(1 << 40) - 1),
    )
    return Message(Cob.EMERGENCY + node_id, f"{name}_EMCY", 8, name, receivers, signals)


def _heartbeat(cell: Cell, name: str, node_id: int, receivers: tuple[str, ...], is_cyclic: bool = True) -> Message:
    states = Signal("state", 0, 8, maximum=0x7F, choices=_words(NmtState, "-"))
    period_ms = float(cell.bus.heartbeat_ms) if is_cyclic else None
    return Message(Cob.HEARTBEAT + node_id, f"{name}_heartbeat", 1, name, receivers, (states,), period_ms)


def _sdo_messages(name: str, dictionary: Dictionary, clients: dict[int, str]) -> Iterator[Message]:
    """Requests and responses of every SDO server; `clients` names the client of a channel."""
    signals = (
        Signal("command", 0, 8, maximum=0xFF, choices=_SDO_COMMANDS),
        Signal("index", 8, 16, maximum=0xFFFF),
        Signal("subindex", 24, 8, maximum=0xFF),
        Signal("data", 32, 32, maximum=0xFFFF_FFFF),
    )
    for index in sorted(set(dictionary) & set(_SDO_SERVERS)):
        channel = index - _SDO_SERVERS.start
        client, suffix = clients.get(channel, ANY_NODE), f"_{channel}" if channel else ""
        for subindex, what, sender, receiver in ((1, "request", client, name), (2, "response", name, client)):
            cob_id = default_value(dictionary, index, subindex)
            receivers = () if receiver == ANY_NODE else (receiver,)
            comment = "Expedited transfers; segments carry seven bytes of data after the command"
            yield Message(cob_id, f"{name}_SDO_{what}{suffix}", 8, sender, receivers, signals, comment=comment)


def _pdo(
    cell: Cell, name: str, other: str, layout: PdoLayout, signals: tuple[Signal, ...], cycle_ms: float | None = None
) -> Message:
    sender, receiver = (other, name) if layout.kind == "rpdo" else (name, other)
    if layout.transmission_type in _CYCLIC_TYPES:
        cycle_ms = layout.transmission_type * cell.bus.cycle_us / 1000
    title = f"{name}_{layout.kind.upper()}{layout.number}"
    return Message(layout.cob_id, title, layout.size, sender, (receiver,), signals, cycle_ms)


def _telemetry_ms(cell: Cell, layout: PdoLayout) -> float | None:
    return DIVIDER * cell.bus.cycle_us / 1000 if layout.kind == "tpdo" else None


def wired_signal(wired: WiredSignal, joint: str, driven: Joint) -> Signal:
    """A wired signal in physical units; `joint` is the name of its joint in the format, `driven` the joint."""
    words = _LATCH_WORDS.get(wired.leaf)
    per_unit = 1.0 / DEGREE if wired.quantity is Quantity.POSITION else 1.0
    factor, offset = wired.factor * per_unit, _tidy(wired.offset * per_unit)
    lowest, highest = sorted(_tidy(factor * raw + offset) for raw in (wired.lowest_raw, wired.highest_raw))
    return Signal(
        f"{joint}_{wired.leaf}",
        wired.start_bit,
        wired.bit_length,
        is_signed=wired.is_signed,
        factor=factor,
        offset=offset,
        minimum=lowest,
        maximum=highest,
        unit="" if words else _UNITS[wired.quantity],
        choices=_words(words, "-") if words else {},
        comment=REVERSED if wired.leaf == Command.DIRECTION and driven.motor.direction < 0 else "",
    )


def _bench_signal(dictionary: Dictionary, mapped: MappedObject, start_bit: int, joints: list[str]) -> Signal:
    variable = variable_at(dictionary, mapped.index, mapped.subindex)
    assert variable is not None, "read_layouts has found it in the dictionary"
    entry = dictionary[mapped.index]
    short = SIGNAL_NAMES.get(mapped.index, f"object_{mapped.index:04X}")
    is_float = variable.data_type == datatypes.REAL32
    _, _, unit = entry.name.partition(", ")
    return Signal(
        f"{joints[mapped.subindex - 1]}_{short}" if mapped.subindex else short,
        start_bit,
        mapped.bits,
        is_signed=variable.data_type in datatypes.SIGNED_TYPES,
        is_float=is_float,
        maximum=0 if is_float else (1 << mapped.bits) - 1,
        unit=unit,
        choices=CONTROLLER_STATES if mapped.index == CONTROLLER_STATE else {},
        comment=entry.name,
    )


def _words(
    values: type[NmtCommand | NmtState | ErrorCode | DirectionBits | HandBits], joiner: str = " "
) -> dict[int, str]:
    return {int(value): value.name.lower().replace("_", joiner) for value in values}


def _key(node: CardNode) -> str:
    """The name of a card's node, also where a card has the controller's name."""
    return node.card.name if node.card.name != CONTROLLER else f"{CONTROLLER}_card"


def _tidy(value: float) -> float:
    """`value` with 12 digits: the others are rounding errors of the conversion."""
    return float(f"{value:.12g}")
