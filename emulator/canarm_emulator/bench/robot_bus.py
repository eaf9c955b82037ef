"""How frames get on the robot's bus: from cards, clients and faults, at once or through the wire model.

Owns the record of the bus, the wire and its trouble. What a SYNC does, and why time passes, belongs to the bench.
"""

from collections.abc import Callable, Collection, Hashable

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Frame, NmtState
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from ..bus_record import Record, new_record
from ..node.slave import Emit, Slave
from ..robot.timeline import Timeline
from ..wire.bus_trouble import BusTrouble, origin_of, wire_name
from ..wire.error_frames import error_frame
from ..wire.wire import Wire
from ..wire.wire_events import StateChange
from .card_nodes import CardNodes
from .fault_hooks import FaultHooks

_SYNC, _HEARTBEAT, _LAST_HEARTBEAT = int(Cob.SYNC), int(Cob.HEARTBEAT), Cob.HEARTBEAT + HIGHEST_NODE_ID
_BOOT_UP = bytes((NmtState.BOOT_UP,))
_NMT_AND_SDO = frozenset(
    [Cob.NMT]
    + [base + node_id for base in (Cob.SDO_TO_CLIENT, Cob.SDO_TO_SERVER) for node_id in range(1, HIGHEST_NODE_ID + 1)]
)


OnSync = Callable[[Frame, object, Collection[object]], None]
"""Takes a SYNC on the bus, its origin, and the names of nodes that have missed it."""


class RobotBus:
    """The robot's bus with the cards of `cell`; `nodes` take what is on it.

    With `with_wire` frames take their time: all of them on the wall clock; in lockstep those of a running cycle except
    SYNC, TIME, NMT and SDO.
    """

    def __init__(
        self,
        cell: Cell,
        clock: Clock,
        timeline: Timeline,
        nodes: CardNodes,
        hooks: FaultHooks,
        with_wire: bool,
        on_sync: OnSync,
    ) -> None:
        self.records: list[Record] = []
        """What was on the bus, in order; whoever drives the bench empties it."""
        self.ignored_frames = 0
        self.missed_by: Collection[object] = ()
        """Nodes that have missed the frame that is being delivered."""
        node_ids = [card.node_id for card in cell.card]
        self.wire = Wire(cell.bus.bitrate, node_ids) if with_wire else None
        """The wire model, where one was asked for."""
        self.trouble = BusTrouble(self.wire)
        """What has gone wrong on the wire."""
        self._off = self.trouble.off
        self._leaving: set[Hashable] = set()
        """Clients that have left while the wire still carried what they had sent."""
        self._timeline, self._nodes, self._hooks = timeline, nodes, hooks
        self._card_ids, self._on_sync = frozenset(node_ids), on_sync
        self._is_timed = clock is Clock.WALL
        self._compute_delay_ns = 0 if self._is_timed else cell.bus.compute_delay_us * 1000

    @property
    def is_cycling(self) -> bool:
        """Whether SYNCs drive a run. Until then time stands still in lockstep, and frames arrive at once."""
        return self._timeline.cycle >= 0 and self._nodes.is_operational

    @property
    def time_passes(self) -> bool:
        """Whether later events will come: always on the wall clock, in lockstep while SYNCs drive a run."""
        return self._is_timed or self.is_cycling

    @property
    def is_silent(self) -> bool:
        """Whether nobody has anything to send. No frame is half sent between two steps of the bench."""
        return self.wire is None or not any(node.queue for node in self.wire.nodes.values())

    def is_lost(self, origin: object) -> bool:
        """Whether a client's frames do not get on the bus."""
        return bool(self._off) and wire_name(origin) in self._off

    def hearers(self, sender: object, now_ns: int) -> list[Slave]:
        """The cards that hear a SYNC while some node is in bus-off or faulty."""
        if self.is_lost(sender):
            return []
        sees = self._hooks.sees_sync
        return [each for each in self._nodes.running if each.bus_name not in self._off and sees(each, now_ns)]

    def way_out(self, node_id: int, name: Hashable) -> Emit:
        """Sends a card's frames to the bus, through the card's faults and those of messages."""
        hooks, timeline, nodes, off = self._hooks, self._timeline, self._nodes, self._off
        is_wired, unplugged = self.wire is not None, self.trouble.unplugged

        def emit(time_ns: int, frame: Frame) -> None:
            if hooks.cards and name in hooks.cards:
                passed = hooks.sent(node_id, frame)
                if passed is None:
                    return
                frame = passed
            if hooks.from_cards is not None and name not in unplugged:
                hooks.from_cards.take(max(time_ns, timeline.time_ns), frame, name)
            elif is_wired or off or frame.can_id in nodes.takers:
                self.put_out(time_ns, frame, name)
            else:
                self.records.append(new_record(Record, (time_ns, frame, None)))

        return emit

    def put_out(self, time_ns: int, frame: Frame, name: Hashable) -> None:
        """A frame of the card `name` gets on the bus."""
        wire, off = self.wire, self._off
        if wire is not None and self._is_carried(frame):
            if not off or name not in self.trouble.unplugged:
                wire.offer(max(time_ns, wire.time_ns), frame, name)
            return
        if off and name in off:
            return
        self.records.append(Record(time_ns, frame))
        for taker in self._nodes.takers.get(frame.can_id, ()):
            if taker.name != name and taker.name not in off:
                taker.take(frame.data)

    def take_in(self, time_ns: int, frame: Frame, origin: object) -> None:
        """A frame of a client gets on the bus."""
        if self.wire is not None and (self._is_carried(frame) or self.is_lost(origin)):
            self._queue(self.wire, frame, wire_name(origin))
        else:
            self._arrive(new_record(Record, (time_ns, frame, origin)), self._off)

    def intrude(self, time_ns: int, frame: Frame, origin: Hashable) -> None:
        """A frame of an intruder gets on the bus. The intruder can queue one frame."""
        wire = self.wire
        if wire is None or not self.time_passes:
            self._arrive(Record(time_ns, frame, origin), self._off)
            return
        if origin not in wire.nodes:
            wire.attach(origin)
        if not wire.nodes[origin].queue:
            wire.offer(max(time_ns, wire.time_ns), frame, origin)

    def is_attached(self, origin: object) -> bool:
        """Whether the wire knows a client."""
        return self.wire is not None and wire_name(origin) in self.wire.nodes

    def leave(self, origin: object) -> None:
        """A client has left; what it sent before is still carried."""
        if self.wire is not None and self.is_attached(origin):
            self._leaving.add(wire_name(origin))
            self._detach_leaving(self.wire)

    def expel(self, name: Hashable) -> None:
        """An intruder or a second card leaves the bus with what it has not sent."""
        wire = self.wire
        if wire is not None and name in wire.nodes:
            self.trouble.forget(name)
            wire.detach(name)

    def recover(self, name: Hashable) -> None:
        """A node that `trouble` holds in bus-off begins its recovery; `name` is its name on the wire.

        Raises `ValueError` for one that is not on the wire, or without a wire.
        """
        wire = self.wire
        if wire is None:
            raise ValueError(f"node {name!r} is on no wire; this bench was made without the wire model")
        if self.is_silent:
            # The wire's clock is at the last frame that it has carried.
            self.carry(wire, max(self._timeline.time_ns, wire.time_ns))
        wire.recover(name)

    def carry(self, wire: Wire, until_ns: int) -> None:
        """What the wire has carried by `until_ns` arrives, each frame at its end."""
        timeline, off = self._timeline, self._off
        for delivery in wire.advance(until_ns):
            end_ns, frame, sender = delivery.end_ns, delivery.frame, delivery.sender
            timeline.reach(end_ns)
            is_card = sender in self._card_ids or sender in self._hooks.doubles
            missed_by = {*delivery.missed_by, sender} if is_card else delivery.missed_by
            if off:
                missed_by = missed_by | off
            origin = None if is_card else origin_of(sender)
            if frame.can_id == _SYNC and is_sync(frame):
                self._on_sync(frame, origin, missed_by)
            else:
                self._arrive(Record(end_ns, frame, origin), missed_by, is_card)
        if wire.events:
            self._take_events(wire)
        if self._leaving:
            self._detach_leaving(wire)

    def _arrive(self, record: Record, missed_by: Collection[object], is_card: bool = False) -> None:
        """A whole frame has been on the bus: log it and deliver it.

        A frame that nobody takes counts as ignored, unless a card has sent it.
        """
        self.records.append(record)
        can_id, data, is_extended, is_remote = record[1]
        takers = self._nodes.takers.get(can_id)
        if takers is None or is_extended or is_remote:
            is_answered = is_remote and not is_extended and self._nodes.answer_remote(can_id, self._off)
            self.ignored_frames += not (is_answered or is_card)
            return
        self.missed_by = missed_by
        for name, take in takers:
            if name not in missed_by:
                take(data)

    def _is_carried(self, frame: Frame) -> bool:
        """Whether a frame goes through the wire model, if there is one."""
        return self._is_timed or (self._timeline.cycle >= 0 and not _is_service(frame) and self._nodes.is_operational)

    def _queue(self, wire: Wire, frame: Frame, name: Hashable) -> None:
        """Queue a client's frame; in lockstep, the controller's computing time later."""
        if name not in wire.nodes:
            wire.attach(name)
        if self._leaving:
            self._leaving.discard(name)
        wire.offer(max(self._timeline.time_ns + self._compute_delay_ns, wire.time_ns), frame, name)

    def _detach_leaving(self, wire: Wire) -> None:
        """Clients that have left, and have nothing more to send, are off the wire."""
        for name in [name for name in self._leaving if not wire.nodes[name].queue]:
            self._leaving.discard(name)
            self.expel(name)

    def _take_events(self, wire: Wire) -> None:
        """Report errors on the wire to everybody, and changes of a card's error state to the card."""
        timeline, events = self._timeline, list(wire.events)
        wire.events.clear()
        for event in events:
            was = self.trouble.note(event)
            time_ns, name = event[0], event.node if isinstance(event, StateChange) else event.sender
            timeline.reach(time_ns)
            self.records.append(Record(timeline.time_ns, error_frame(event, was, wire.nodes.get(name)), event))
            if isinstance(event, StateChange):
                self._nodes.on_error_state(event.node, event.state)


def is_sync(frame: Frame) -> bool:
    """Whether it is a SYNC (0x1005 is fixed)."""
    return frame.can_id == _SYNC and not frame.is_extended and not frame.is_remote


def _is_service(frame: Frame) -> bool:
    """NMT with the boot-up message that answers it, and SDO."""
    can_id = frame.can_id
    if can_id not in _NMT_AND_SDO and not (_HEARTBEAT < can_id <= _LAST_HEARTBEAT and frame.data == _BOOT_UP):
        return False
    return not (frame.is_extended or frame.is_remote)
