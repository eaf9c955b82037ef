"""Whether cyclic traffic fits a CAN bus: worst-case response times, load, and the arithmetic in words.

After R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN) schedulability analysis: Refuted,
revisited and revised", Real-Time Systems 35 (2007) 239-272, section 3. Numbers only: no frame is sent, nothing waits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..canopen.frames import Cob, Frame, sync_frame, time_frame
from ..transport.bits import INTERMISSION_BITS, arbitration_key, worst_case_bits
from .model import Cell
from .wiring import CardNode, card_nodes

SECOND_NS = 10**9
SDO_BYTES = 8


@dataclass(frozen=True, slots=True)
class Message:
    """A periodic message: `bits` is its worst-case length with stuff bits and intermission.

    `jitter_ns` is the queuing jitter: how late it may be queued in its period. Without `deadline_ns` the deadline is
    the period.
    """

    name: str
    can_id: int
    bits: int
    period_ns: int
    jitter_ns: int = 0
    deadline_ns: int | None = None
    is_extended: bool = False

    @property
    def limit_ns(self) -> int:
        """The deadline: as given, or the period."""
        return self.period_ns if self.deadline_ns is None else self.deadline_ns

    @property
    def priority(self) -> int:
        """What arbitration compares: the lowest is sent first."""
        return arbitration_key(Frame(self.can_id, b"", self.is_extended))


@dataclass(frozen=True, slots=True)
class Response:
    """Worst-case response time of a message, queued to last bit of intermission; None when it is not bounded."""

    message: Message
    worst_ns: int | None

    @property
    def is_in_time(self) -> bool:
        """Whether the deadline is always met."""
        return self.worst_ns is not None and self.worst_ns <= self.message.limit_ns


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether the traffic fits, the load as a share of time (1 is a full bus), and the lines of the arithmetic."""

    fits: bool
    load: float
    lines: tuple[str, ...]


def bus_load(messages: Sequence[Message], bitrate: int) -> float:
    """Share of time that the messages take with worst-case stuffing, at `bitrate` bit/s: sum of bits over period."""
    return sum(message.bits / message.period_ns for message in messages) * SECOND_NS / bitrate


def response_times(messages: Sequence[Message], bitrate: int) -> tuple[Response, ...]:
    """Worst-case response times by priority at `bitrate` bit/s; unbounded if the busy period does not end.

    Assumes that every CAN controller offers its most urgent message first, and that a message may be queued any time.
    """
    bit_ns = SECOND_NS / bitrate
    ordered = sorted(messages, key=lambda message: message.priority)
    return tuple(
        Response(message, _response_ns(message, ordered[:place], ordered[place + 1 :], bit_ns))
        for place, message in enumerate(ordered)
    )


def _response_ns(message: Message, higher: Sequence[Message], lower: Sequence[Message], bit_ns: float) -> int | None:
    """Equations 10 to 14 of the paper: the longest response of all instances in the level-m busy period."""
    equal_or_higher = [*higher, message]
    if bus_load(equal_or_higher, 1) * bit_ns / SECOND_NS >= 1.0:
        return None
    own_ns = _duration_ns(message, bit_ns)
    blocking_ns = max((_duration_ns(other, bit_ns) for other in lower), default=0)

    def busy(length_ns: int) -> int:
        return blocking_ns + _interference(equal_or_higher, length_ns, bit_ns)

    instances = _ceil(_fixed_point(busy, own_ns) + message.jitter_ns, message.period_ns)
    step_ns = round(bit_ns)
    worst_ns = 0
    waiting_ns = blocking_ns
    for instance in range(instances):
        ahead_ns = blocking_ns + instance * own_ns

        def queued(length_ns: int, ahead_ns: int = ahead_ns) -> int:
            return ahead_ns + _interference(higher, length_ns + step_ns, bit_ns)

        waiting_ns = _fixed_point(queued, max(waiting_ns, ahead_ns))
        worst_ns = max(worst_ns, message.jitter_ns + waiting_ns - instance * message.period_ns + own_ns)
    return worst_ns


def _interference(messages: Sequence[Message], length_ns: int, bit_ns: float) -> int:
    return sum(_ceil(length_ns + other.jitter_ns, other.period_ns) * _duration_ns(other, bit_ns) for other in messages)


def _fixed_point(function: Callable[[int], int], start: int) -> int:
    value = start
    while (following := function(value)) != value:
        value = following
    return value


def _duration_ns(message: Message, bit_ns: float) -> int:
    return round(message.bits * bit_ns)


def _ceil(dividend: int, divisor: int) -> int:
    return -(-dividend // divisor)


def message_bits(data_length: int, is_extended: bool = False) -> int:
    """Worst-case bits of a message with its intermission: C_m of the paper over the bit time."""
    return worst_case_bits(data_length, is_extended) + INTERMISSION_BITS


def cell_messages(cell: Cell, nodes: Sequence[CardNode] | None = None, with_time: bool = False) -> tuple[Message, ...]:
    """The cell's cyclic traffic: SYNC, RPDOs, TPDOs by their transmission type, heartbeats of controller and cards.

    `nodes` are the cell's `card_nodes`, if the caller has them. `with_time` adds TIME once per cycle, which carries
    lockstep time and is on no real bus. EMCY is not cyclic, and SDO only where error values are written anew as the
    arms move: a request and its answer, with whichever card.
    """
    nodes = card_nodes(cell) if nodes is None else nodes
    bus = cell.bus
    cycle_ns, heartbeat_ns = bus.cycle_ns, bus.heartbeat_ms * 1_000_000
    messages = [Message("SYNC", Cob.SYNC, message_bits(len(sync_frame(1).data)), cycle_ns)]
    if with_time:
        messages.append(Message("TIME", Cob.TIME, message_bits(len(time_frame(0).data)), cycle_ns))
    for node in nodes:
        for layout in (*node.rpdos, *node.tpdos):
            every = layout.transmission_type if layout.kind == "tpdo" and 1 <= layout.transmission_type <= 240 else 1
            name = f"{layout.kind.upper()}{layout.number} of {node.card.name}"
            messages.append(Message(name, layout.cob_id, message_bits(layout.size), every * cycle_ns))
    messages += _refresh_messages(cell, nodes)
    senders = [("controller", bus.controller_node_id), *((node.card.name, node.card.node_id) for node in nodes)]
    messages += [
        Message(f"heartbeat of {name}", Cob.HEARTBEAT + node_id, message_bits(1), heartbeat_ns)
        for name, node_id in senders
    ]
    return tuple(sorted(messages, key=lambda message: message.priority))


def _refresh_messages(cell: Cell, nodes: Sequence[CardNode]) -> list[Message]:
    """One SDO download at a time. By the lowest node-ID: below all process data and above all heartbeats is any."""
    every_ns = cell.carry_refresh_cycles * cell.bus.cycle_ns
    carried = {robot.name for robot in cell.robot if robot.when_lost == "carry"}
    ids = [node.card.node_id for node in nodes if node.card.robot in carried and node.card.kind.is_output]
    if not every_ns or not ids:
        return []
    return [
        Message(f"SDO {what} error value", cob + min(ids), message_bits(SDO_BYTES), every_ns)
        for what, cob in (("answer to an", Cob.SDO_TO_CLIENT), ("write of an", Cob.SDO_TO_SERVER))
    ]


def cell_verdict(cell: Cell, nodes: Sequence[CardNode] | None = None, with_time: bool = False) -> Verdict:
    """Whether the cell's cyclic traffic fits: no response later than its period, the cycle's chain within the cycle.

    The chain is SYNC, the converters' scan, TPDOs, the controller's computing, RPDOs; each of its three bursts may
    be blocked by a frame of lower priority. It must end before the next SYNC, or outputs act a cycle late.
    """
    nodes = card_nodes(cell) if nodes is None else nodes
    bus = cell.bus
    messages = cell_messages(cell, nodes, with_time)
    load = bus_load(messages, bus.bitrate)
    responses = response_times(messages, bus.bitrate)
    cycle = [message for message in messages if message.period_ns == bus.cycle_ns]
    cycle_bits = sum(message.bits for message in cycle)
    available = bus.bitrate * bus.cycle_us // 1_000_000
    lines = [
        f"{bus.bitrate} bit/s x {bus.cycle_us} us = {available} bits per cycle; "
        "lengths are with worst-case stuffing and intermission",
        f"every cycle: {' + '.join(f'{message.name} {message.bits}' for message in cycle)} = {cycle_bits} bits",
        f"load with all that is cyclic: {100 * load:.1f} %",
    ]
    late = [response for response in responses if not response.is_in_time]
    for response in responses:
        message = response.message
        worst = "without a bound" if response.worst_ns is None else f"at most {response.worst_ns / 1000:.0f} us"
        mark = "" if response.is_in_time else ": TOO LATE"
        lines.append(f"{message.name} 0x{message.can_id:03X}: {worst}, limit {message.limit_ns / 1000:.0f} us{mark}")
    chain_ns, chain_line = _chain(cell, nodes, messages)
    lines.append(chain_line)
    fits = not late and chain_ns <= bus.cycle_ns
    if fits:
        lines.append(f"fits: {(bus.cycle_ns - chain_ns) / 1000:.0f} us of {bus.cycle_us} us are left")
    else:
        lines.append("does not fit: raise bus.bitrate or bus.cycle_us, or wire fewer channels")
    return Verdict(fits, load, tuple(lines))


def _chain(cell: Cell, nodes: Sequence[CardNode], messages: Sequence[Message]) -> tuple[int, str]:
    """Length of the chain from SYNC to the last RPDO, and the line that adds it up."""
    bus = cell.bus
    bit_ns = SECOND_NS / bus.bitrate
    inputs = sum(message_bits(layout.size) for node in nodes for layout in node.tpdos)
    outputs = sum(message_bits(layout.size) for node in nodes for layout in node.rpdos)
    sync = next(message.bits for message in messages if message.can_id == Cob.SYNC)
    longest = max((each for each in messages if each.can_id >= Cob.SDO_TO_CLIENT), key=lambda each: each.bits)
    blocking, kind = longest.bits, "heartbeat" if longest.can_id >= Cob.HEARTBEAT else "SDO"
    scan_us = max((node.card.channel_us * _inputs(node) for node in nodes), default=0)
    total_ns = round((sync + inputs + outputs + 3 * blocking) * bit_ns) + (scan_us + bus.compute_delay_us) * 1000
    sync_us, inputs_us, outputs_us, blocking_us = (
        f"{bits * bit_ns / 1000:.0f}" for bits in (sync, inputs, outputs, blocking)
    )
    terms = (
        f"SYNC {sync_us} + scan {scan_us} + TPDOs {inputs_us} + computing {bus.compute_delay_us} + RPDOs {outputs_us} "
        f"+ 3 x {blocking_us} (before each burst the longest {kind}, on the wire already)"
    )
    mark = "" if total_ns <= bus.cycle_ns else ": TOO LONG"
    return total_ns, f"chain of a cycle: {terms} = {total_ns / 1000:.0f} us of {bus.cycle_us} us{mark}"


def _inputs(node: CardNode) -> int:
    """Channels that a card converts after a SYNC."""
    return sum(len(layout.objects) for layout in node.tpdos)
