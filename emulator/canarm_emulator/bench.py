"""The emulated test bench, without any input or output: frames and times go in, frames come out.

Owns virtual time, the order of events on the robot's bus and what a SYNC does. Sockets, wall clocks and files belong to
the runner. The same object runs in a process of its own or inside a test.
"""

from collections.abc import Callable, Container, Hashable, Sequence
from dataclasses import dataclass
from itertools import count, repeat
from typing import TYPE_CHECKING, NamedTuple

from canarm_protocol.bench_objects import BUS_LOAD, bench_dictionary
from canarm_protocol.cell import Card, Cell
from canarm_protocol.clock import Clock
from canarm_protocol.dictionary import load_dictionary
from canarm_protocol.errors import FrameError
from canarm_protocol.faults import FaultScript
from canarm_protocol.frames import Cob, Frame, NmtCommand, NmtState, parse_nmt, time_frame
from canarm_protocol.pdo import PdoLayout

from .assessor import Assessor
from .bench_device import BenchDevice
from .bus_figures import BusFigures
from .bus_trouble import BusTrouble, origin_of, wire_name
from .card_port import CardPort
from .error_frames import error_frame
from .fault_hooks import CycleLength, FaultHooks, SecondCard
from .fault_objects import FaultObjects
from .pdo_rules import SYNCHRONOUS_TYPES
from .rack import Rack
from .slave import NEVER, Slave
from .truth import Truth
from .wire import StateChange, Wire
from .world import JointState, World

if TYPE_CHECKING:
    from .faults.engine import FaultEngine
    from .faults.messages import MessagePoint

RUN_ON_NS = 500_000_000
"""How long after the heartbeat time the world runs on when the sender of SYNC is lost in lockstep."""
IDLE_STEP_NS = 5_000_000
"""The world follows in pieces of this length while no SYNC asks for more."""
SILENT_CYCLES = 4
"""After so many cycles without SYNC the truth is told nevertheless: a test wants to see what the arm does then."""
SETTLE_NS = 100_000_000
"""What a wire has not carried after so much time, it never will: nobody is left to acknowledge."""
HIGHEST_NODE_ID = 127
_SYNC, _OPERATIONAL = int(Cob.SYNC), NmtState.OPERATIONAL
BOOT_UP = bytes((NmtState.BOOT_UP,))
SDO_BASES = (Cob.SDO_TO_CLIENT, Cob.SDO_TO_SERVER)


class Record(NamedTuple):
    """A frame on a bus: its time, and the client that sent it (None: a node of the bench).

    An error frame's origin is what happened on the wire, an `ErrorFrame` or a `StateChange`.
    """

    time_ns: int
    frame: Frame
    origin: object = None


class CycleTruth(NamedTuple):
    """The world at a SYNC: cycle since NMT start, its time, the true state of every joint."""

    cycle: int
    time_ns: int
    joints: Sequence[JointState]


class _Taker(NamedTuple):
    """What a node, by its name on the bus, does with the data of frames of one COB-ID."""

    name: Hashable
    take: Callable[[bytes], None]


@dataclass(slots=True)
class _Scan:
    """Process data between SYNC and the end of the conversions."""

    due_ns: int
    pdos: list[tuple[Slave, PdoLayout]]


class Bench:
    """The robot's side of a cell, and the bench node.

    `on_cycle` is called with the truth at every SYNC after NMT start, and for a while after SYNCs have ended. Frames on
    the robot's bus, those received included, gather in order in `records`; those on the bench bus in `bench_records`.
    Whoever drives it empties both.

    `with_wire` lets frames take the time that the wire needs, one after the other by arbitration, stamped with the end
    of the frame: all of them on the wall clock; in lockstep those of a running cycle but for SYNC and TIME, which carry
    time itself, and NMT and SDO, whose answer nobody could wait for while time stands still. No card sees the SYNC of a
    client in bus-off, and a card in bus-off sees none.
    """

    def __init__(self, cell: Cell, truth: Truth, clock: Clock, seed: int, with_wire: bool = False) -> None:
        self.cell, self.clock = cell, clock
        self.time_ns = 0
        self.cycle = -1
        """The last SYNC's number since NMT start; -1 before the first."""
        self.begin_ns: int | None = None
        """When cycle 0 was; None before."""
        self.records: list[Record] = []
        self.bench_records: list[Record] = []
        self.on_cycle: Callable[[CycleTruth], None] | None = None
        self.ignored_frames = 0
        self.overruns = 0
        """SYNCs that arrived while the converters were still busy with the last one's scan."""
        self.world = World(cell, truth, seed)
        self.assessor = Assessor(cell)
        self.rack = Rack(cell, self.world, truth)
        self.hooks = FaultHooks()
        """What faults have changed."""
        self._faults: FaultEngine | None = None
        self._seed = seed
        self.slaves = [self._make_slave(card) for card in cell.card]
        self._running = self.slaves
        """The cards, and second ones with the same node-ID, whose processors run."""
        self._takers: dict[int, list[_Taker]] = {}
        self._next_due_ns = NEVER
        self._next_sync_ns = 0
        self._may_move_on = False
        self._last_cycle_ns = 0
        self._scan: _Scan | None = None
        self.wire = Wire(cell.bus.bitrate, [slave.node_id for slave in self.slaves]) if with_wire else None
        """The wire model, where one was asked for."""
        self.trouble = BusTrouble(self.wire)
        """What has gone wrong on the wire."""
        self._off = self.trouble.off
        self._leaving: set[Hashable] = set()
        """Clients that have left while the wire still carried what they had sent."""
        self._missed_by: Container[object] = ()
        node_ids = [slave.node_id for slave in self.slaves]
        figures = BusFigures(self.wire, self.trouble, node_ids)
        faults = FaultObjects(cell, self.inject, lambda: (self.time_ns, self.cycle))
        self.device = BenchDevice(cell, self.assessor, figures, faults, self.set_emergency_stop)
        self.device.truth = self.world.state()
        self.node = Slave(
            "bench", cell.bus.bench_node_id, bench_dictionary(cell), self.device, self._emit_bench, clock.value
        )
        self._bench_takers: dict[int, Callable[[bytes], None]] = {}

    def _make_slave(self, card: Card, double: SecondCard | None = None) -> Slave:
        node_id, hooks = card.node_id, self.hooks
        name: Hashable = double or node_id

        def emit(time_ns: int, frame: Frame) -> None:
            if hooks.cards and name in hooks.cards:
                passed = hooks.sent(node_id, frame)
                if passed is None:
                    return
                frame = passed
            if hooks.from_cards is not None and name not in self.trouble.unplugged:
                hooks.from_cards.take(max(time_ns, self.time_ns), frame, name)
            elif self.wire is not None or self._off or frame.can_id in self._takers:
                self.put_out(time_ns, frame, name)
            else:
                self.records.append(Record(time_ns, frame))

        dictionary = load_dictionary(card.model, node_id)
        device = self.rack.spare(card) if double else self.rack.devices[node_id]
        slave = Slave(card.name, node_id, dictionary, device, emit, self.clock.value)
        slave.bus_name = name
        return slave

    def put_out(self, time_ns: int, frame: Frame, name: Hashable) -> None:
        """A frame leaves a card for the bus."""
        wire = self.wire
        is_carried = wire is not None and self._is_carried(frame)
        if self._off and name in (self.trouble.unplugged if is_carried else self._off):
            return
        if wire is not None and is_carried:
            wire.offer(max(time_ns, wire.time_ns), frame, name)
            return
        self.records.append(Record(time_ns, frame))
        for taker in self._takers.get(frame.can_id, ()):
            if taker.name != name and taker.name not in self._off:
                taker.take(frame.data)

    def start(self) -> None:
        """Power on: every node boots; the bench node starts itself."""
        for slave in self.slaves:
            slave.boot(self.time_ns)
        self.node.boot(self.time_ns)
        self.node.on_nmt(NmtCommand.START, self.time_ns)
        self._route()
        self._bench_takers = {
            **{cob_id: self._sdo(self.node, cob_id) for cob_id in self.node.sdo_cob_ids},
            **{layout.cob_id: self._rpdo(self.node, layout) for layout in self.node.rpdos},
        }

    @property
    def next_due_ns(self) -> int:
        """When `advance` has something to send."""
        due_ns = self._next_due_ns if self._scan is None else min(self._next_due_ns, self._scan.due_ns)
        if self._faults is not None:
            due_ns = min(due_ns, self.hooks.due_ns)
        return due_ns if self.wire is None else min(due_ns, self.wire.next_due_ns)

    @property
    def is_operational(self) -> bool:
        """Whether a card is in OPERATIONAL."""
        for slave in self.slaves:  # noqa: SIM110  a generator takes five times as long, several times a cycle
            if slave.state is _OPERATIONAL:
                return True
        return False

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass, on the wall clock or while nobody sends SYNC; a time gone by is no error."""
        while self.next_due_ns <= until_ns:
            self._run_due(self.next_due_ns)
        if until_ns > self.time_ns:
            self.time_ns = until_ns
            if until_ns - self.world.time_ns > IDLE_STEP_NS:
                self.world.advance(until_ns)
                self._tell_idle_truth()
                if self._faults is not None:
                    self._faults.update(until_ns, self.cycle)
        if self.wire is not None and self.clock is Clock.WALL:
            self._carry(self.wire, until_ns)

    def run_on(self) -> None:
        """In lockstep, the sender of SYNC is lost: time runs on until the cards' own protection has acted."""
        timeouts_ns = [slave.watch_due_ns for slave in self.slaves if slave.watch_due_ns != NEVER]
        timeouts_ns.append(self.time_ns + self.cell.bus.heartbeat_timeout_ms * 1_000_000)
        end_ns = max(timeouts_ns) + RUN_ON_NS
        while self.time_ns < end_ns:
            self.advance(min(self.time_ns + IDLE_STEP_NS, end_ns))
            self._catch_up(self.time_ns)
            self._tell_idle_truth()
            if self._faults is not None:
                self._faults.update(self.time_ns, self.cycle)
        self._next_sync_ns = self.time_ns

    def move_on(self) -> None:
        """In lockstep, the world goes on to the next SYNC as soon as a cycle's inputs are out.

        Nothing that a cyclic controller sends acts before that SYNC, so this need not wait for it: a runner calls it
        while the controller computes. It always comes before the next frame is taken, so that the bytes are the same.
        """
        if self._may_move_on:
            self._may_move_on = False
            self._catch_up(self._next_sync_ns)

    def settle(self) -> None:
        """Let the wire carry what still waits on it, at the end of a run."""
        wire, limit_ns = self.wire, self.time_ns + SETTLE_NS
        while wire is not None and (due_ns := wire.next_due_ns) <= limit_ns:
            self.advance(due_ns)

    def leave(self, origin: object) -> None:
        """A client has left the robot's bus; what it sent before is still carried."""
        wire, name = self.wire, wire_name(origin)
        if wire is None or name not in wire.nodes:
            return
        if self.clock is Clock.SYNC:
            self.settle()
        self._leaving.add(name)
        self._detach_leaving(wire)

    def _detach_leaving(self, wire: Wire) -> None:
        """Clients that have left, and have nothing more to send, are off the wire."""
        for name in [name for name in self._leaving if not wire.nodes[name].queue]:
            self._leaving.discard(name)
            self.trouble.forget(name)
            wire.detach(name)

    def recover(self, name: Hashable) -> None:
        """A node that `trouble` holds in bus-off begins its recovery; `name` is its name on the wire.

        Raises `ValueError` for one that is not on the wire, or without a wire.
        """
        wire = self.wire
        if wire is None:
            raise ValueError(f"node {name!r} is on no wire; this bench was made without the wire model")
        if _is_silent(wire):
            # The wire's clock stands where it last carried something.
            self._carry(wire, max(self.time_ns, wire.time_ns))
        wire.recover(name)

    def receive(self, frame: Frame, origin: object = None) -> None:
        """A frame arrives on the robot's bus at `time_ns`."""
        self.move_on()
        is_lost = bool(self._off) and wire_name(origin) in self._off
        is_sync = frame.can_id == _SYNC and _is_sync(frame)
        if is_sync and (self.clock is Clock.SYNC or (self.wire is None and not is_lost)):
            self._sync(frame, origin)
        elif self.hooks.towards_cards is not None and not is_lost and not is_sync:
            self.hooks.towards_cards.take(self.time_ns, frame, origin)
        else:
            self.take_in(self.time_ns, frame, origin)

    def take_in(self, time_ns: int, frame: Frame, origin: object) -> None:
        """A frame of a client gets on the bus."""
        is_lost = bool(self._off) and wire_name(origin) in self._off
        if self.wire is not None and (is_lost or self._is_carried(frame)):
            self._queue(self.wire, frame, wire_name(origin))
        else:
            self._arrive(Record(time_ns, frame, origin), self._off)

    def intrude(self, time_ns: int, frame: Frame, origin: Hashable) -> None:
        """A frame of nobody that belongs to the cell gets on the bus. Its sender has room for one frame to wait."""
        wire = self.wire
        if wire is None or not (self._is_cycling or self.clock is Clock.WALL):
            self._arrive(Record(time_ns, frame, origin), self._off)
            return
        if origin not in wire.nodes:
            wire.attach(origin)
        if not wire.nodes[origin].queue:
            wire.offer(max(time_ns, wire.time_ns), frame, origin)

    def expel(self, name: Hashable) -> None:
        """An intruder or a second card leaves the robot's bus with what it has not sent."""
        wire = self.wire
        if wire is not None and name in wire.nodes:
            self.trouble.forget(name)
            wire.detach(name)

    def _arrive(self, record: Record, missed_by: Container[object] = (), is_card: bool = False) -> None:
        """A frame is on the bus as a whole: it is logged, and who is to take it takes it.

        What nobody takes counts as ignored, but for what a card sends.
        """
        self.records.append(record)
        frame = record.frame
        takers = self._takers.get(frame.can_id)
        if frame.is_remote and not frame.is_extended and self._answer_remote(frame.can_id):
            return
        if takers is None or frame.is_extended or frame.is_remote:
            self.ignored_frames += not is_card
            return
        data, self._missed_by = frame.data, missed_by
        for taker in takers:
            if taker.name not in missed_by:
                taker.take(data)

    def _answer_remote(self, can_id: int) -> bool:
        self._catch_up(self.time_ns)
        hearing = [slave for slave in self._running if slave.bus_name not in self._off]
        answers = [slave.on_remote(can_id, self.time_ns) for slave in hearing]
        return any(answers)

    @property
    def _is_cycling(self) -> bool:
        """Whether SYNCs drive a run. Before, time stands still in lockstep, and all frames are there at once."""
        return self.cycle >= 0 and self.is_operational

    def _is_carried(self, frame: Frame) -> bool:
        """Whether a frame goes over the wire, where there is one."""
        return self.clock is Clock.WALL or (self._is_cycling and not _is_service(frame))

    def _queue(self, wire: Wire, frame: Frame, name: Hashable) -> None:
        """A client has a frame to send; in lockstep it took the controller a while to compute it."""
        if name not in wire.nodes:
            wire.attach(name)
        if self._leaving:
            self._leaving.discard(name)
        delay_ns = self.cell.bus.compute_delay_us * 1000 if self.clock is Clock.SYNC else 0
        wire.offer(max(self.time_ns + delay_ns, wire.time_ns), frame, name)

    def _carry(self, wire: Wire, until_ns: int) -> None:
        """What the wire has carried by `until_ns` arrives, each frame at its end."""
        for delivery in wire.advance(until_ns):
            self.time_ns = max(self.time_ns, delivery.end_ns)
            is_card = delivery.sender in self.rack.devices or delivery.sender in self.hooks.doubles
            missed_by = {*delivery.missed_by, delivery.sender} if is_card else delivery.missed_by
            if self._off:
                missed_by = missed_by | self._off
            origin = None if is_card else origin_of(delivery.sender)
            if _is_sync(delivery.frame):
                self._sync(delivery.frame, origin, missed_by)
            else:
                self._arrive(Record(delivery.end_ns, delivery.frame, origin), missed_by, is_card)
        if wire.events:
            self._take_events(wire)
        if self._leaving:
            self._detach_leaving(wire)

    def _take_events(self, wire: Wire) -> None:
        """Errors on the wire are told to everybody, changes of a card's error state to the card."""
        events = list(wire.events)
        wire.events.clear()
        for event in events:
            was = self.trouble.note(event)
            time_ns, name = event[0], event.node if isinstance(event, StateChange) else event.sender
            self.time_ns = max(self.time_ns, time_ns)
            self.records.append(Record(self.time_ns, error_frame(event, was, wire.nodes.get(name)), event))
            if isinstance(event, StateChange):
                self._change_state(event)

    def _change_state(self, change: StateChange) -> None:
        for slave in self._running:
            if slave.bus_name == change.node:
                self._catch_up(self.time_ns)
                slave.on_error_state(change.state, self.time_ns)
        self._route()

    @property
    def faults(self) -> "FaultEngine":
        """What is broken, or will be."""
        if self._faults is None:
            from .faults.engine import FaultEngine

            self._faults = FaultEngine(self, self._seed)
            self.device.faults.attach(self._faults)
        return self._faults

    def inject(self, script: FaultScript) -> str:
        """Do what a fault script asks for; returns what was done. Raises `FaultError` with the reason of a refusal."""
        done = self.faults.accept(script)
        if not self._is_cycling:
            self.catch_up()
            self.faults.update(self.time_ns, self.cycle)
        return done

    def set_emergency_stop(self, is_on: bool) -> None:
        """Open the supply of every amplifier, or close it again."""
        self.catch_up()
        for joint in range(len(self.cell.joints)):
            self.world.set_supply(joint, not is_on)

    def set_message_point(self, is_towards_cards: bool, point: "MessagePoint | None") -> None:
        """Let all frames but SYNC and TIME pass through `point` in one direction."""
        if is_towards_cards:
            self.hooks.towards_cards = point
        else:
            self.hooks.from_cards = point

    def set_cycle_length(self, length: CycleLength | None) -> None:
        """Let lockstep's cycles last as long as `length` says."""
        self.hooks.cycle_length = length

    def node_port(self, node_id: int) -> CardPort:
        """What a fault can do to the card with this node-ID."""
        return CardPort(self, next(slave for slave in self.slaves if slave.node_id == node_id))

    def add_double(self, node_id: int) -> Slave:
        """A second card like that with this node-ID, wired to nothing, is put on the bus; it has not booted."""
        card = next(card for card in self.cell.card if card.node_id == node_id)
        doubles = self.hooks.doubles
        name = next(each for each in map(SecondCard, repeat(node_id), count(1)) if each not in doubles)
        doubles[name] = self._make_slave(card, name)
        if self.wire is not None:
            self.wire.attach(name)
        return doubles[name]

    def remove_double(self, name: Hashable) -> None:
        """A second card is taken away; what is on the wire of it is still carried."""
        self.hooks.doubles.pop(name, None)
        self.expel(name)
        self._route()

    def nodes_changed(self) -> None:
        """A node has booted, stopped or changed its state by itself."""
        self._route()

    def catch_up(self) -> None:
        """The world moves on to the bench's time."""
        self._catch_up(self.time_ns)

    def receive_bench(self, frame: Frame, origin: object = None) -> None:
        """A frame arrives on the bench bus. It never touches the robot's bus."""
        self.bench_records.append(Record(self.time_ns, frame, origin))
        if frame.is_extended or frame.is_remote or not self.device.channels.admit(frame.can_id, origin):
            return
        take = self._bench_takers.get(frame.can_id)
        if take is not None:
            take(frame.data)
        elif Cob.HEARTBEAT < frame.can_id <= Cob.HEARTBEAT + HIGHEST_NODE_ID:
            self.node.on_heartbeat(frame.can_id - Cob.HEARTBEAT, self.time_ns)
            self._schedule()

    def send_telemetry(self) -> None:
        """The bench node sends its TPDOs: for a runner that knows that somebody listens."""
        for layout in self.node.tpdos:
            if self.wire is not None or layout.objects[0].index != BUS_LOAD:
                self.node.send_tpdo(layout, self.time_ns)

    def _sync(self, frame: Frame, origin: object, missed_by: Container[object] = ()) -> None:
        lockstep = self.clock is Clock.SYNC
        if lockstep:
            self.advance(self._next_sync_ns)
        now_ns = self.time_ns
        self.records.append(Record(now_ns, frame, origin))
        world = self.world
        if self._scan is not None:
            self.overruns += 1
        self._catch_up(now_ns)
        is_operational = self.is_operational
        if is_operational and self.cycle < 0:
            self.begin_ns = now_ns
        faults = self._faults
        if faults is not None:
            faults.update(now_ns, self.cycle + is_operational)
            is_operational = self.is_operational
        if lockstep:
            length = self.hooks.cycle_length
            nominal_ns = self.cell.bus.cycle_ns
            self._next_sync_ns = now_ns + (nominal_ns if length is None else max(1, length(nominal_ns, now_ns)))
        slaves = self.slaves if faults is None and not self._off else self._hearers(origin, now_ns)
        if missed_by != ():
            slaves = [slave for slave in slaves if slave.bus_name not in missed_by]
        pdos = [(slave, layout) for slave in slaves for layout in slave.on_sync(frame.data, now_ns)]
        self._hurry()
        if is_operational:
            self._count_cycle(now_ns)
        if self._scan is None and pdos:
            mapped = [(slave.node_id, each) for slave, layout in pdos for each in layout.objects]
            self.rack.convert(mapped if not self.hooks.doubles else list(dict.fromkeys(mapped)))
            self._scan = _Scan(max(world.time_ns, now_ns), pdos)
        if lockstep:
            self.advance(max(world.time_ns, now_ns))
            if self.wire is not None:
                self._finish_transmissions(self.wire)
            self.records.append(Record(self.time_ns, time_frame(self.time_ns)))
            self._may_move_on = True

    def _hearers(self, sender: object, now_ns: int) -> list[Slave]:
        """The cards that hear a SYNC while somebody is in bus-off or broken."""
        if wire_name(sender) in self._off:
            return []
        sees = self.hooks.sees_sync
        return [each for each in self._running if each.bus_name not in self._off and sees(each, now_ns)]

    def _finish_transmissions(self, wire: Wire) -> None:
        """The cycle's inputs reach the controller when the wire has carried them, or never if it is too slow.

        Nobody waits here for a node in bus-off.
        """
        while (due_ns := wire.next_due_ns) < self._next_sync_ns:
            if self._off and _is_silent(wire):
                break
            self.advance(due_ns)

    def _count_cycle(self, now_ns: int) -> None:
        self.cycle += 1
        self._last_cycle_ns = now_ns
        if self.cycle == 0:
            self.assessor.begin()
        joints = self.world.state()
        self.device.cycle, self.device.truth = self.cycle, joints
        self.assessor.truth(self.cycle, joints, self.world.supply_limited_steps)
        if self.on_cycle is not None:
            self.on_cycle(CycleTruth(self.cycle, now_ns, joints))

    def _tell_idle_truth(self) -> None:
        """The truth while no SYNC asks for it: shown always, told to `on_cycle` until the cards have acted."""
        joints = self.device.truth = self.world.state()
        silence_ns = self.time_ns - self._last_cycle_ns
        limit_ns = self.cell.bus.heartbeat_timeout_ms * 1_000_000 + RUN_ON_NS
        is_told = SILENT_CYCLES * self.cell.bus.cycle_ns < silence_ns <= limit_ns
        if is_told and self.cycle >= 0 and self.on_cycle is not None:
            self.on_cycle(CycleTruth(self.cycle, self.time_ns, joints))

    def _run_due(self, due_ns: int) -> None:
        wire = self.wire
        if wire is not None and wire.next_due_ns <= due_ns:
            self._carry(wire, due_ns)
        self.time_ns = max(self.time_ns, due_ns)
        if self._faults is not None:
            self.hooks.release(due_ns)
        scan = self._scan
        if scan is not None and scan.due_ns <= due_ns:
            self._scan = None
            for slave, layout in scan.pdos:
                slave.send_tpdo(layout, due_ns)
        if self._next_due_ns <= due_ns:
            for slave in self._running:
                if slave.next_due_ns <= due_ns:
                    state = slave.state
                    if slave.world_due_ns <= due_ns:
                        self._catch_up(due_ns)
                    slave.run_timers(due_ns)
                    if slave.state is not state:
                        self._route()
            if self.node.next_due_ns <= due_ns:
                self.node.run_timers(due_ns)
            self._schedule()

    def _catch_up(self, now_ns: int) -> None:
        if now_ns > self.world.time_ns:
            self.world.advance(now_ns)

    def _nmt(self, data: bytes) -> None:
        try:
            command, node_id = parse_nmt(data)
        except FrameError:
            self.ignored_frames += 1
            return
        was_operational = self.is_operational
        self._catch_up(self.time_ns)
        for slave in self._running:
            if node_id in (0, slave.node_id) and slave.bus_name not in self._missed_by:
                slave.on_nmt(command, self.time_ns)
        self.device.truth = self.world.state()
        if command is NmtCommand.START and not was_operational:
            self.cycle, self.begin_ns = -1, None
            self._next_sync_ns = max(self.time_ns, self.world.time_ns)
        self._route()

    def _route(self) -> None:
        """Who takes which COB-ID: it changes with NMT states and configuration. Several nodes may take the same one."""
        hooks = self.hooks
        cards = (*self.slaves, *hooks.doubles.values())
        self._running = [slave for slave in cards if slave.bus_name not in hooks.halted]
        takers: dict[int, list[_Taker]] = {Cob.NMT: [_Taker(0, self._nmt)]}
        for slave in self._running:
            name = slave.bus_name
            for cob_id in slave.sdo_cob_ids:
                takers.setdefault(cob_id, []).append(_Taker(name, self._sdo(slave, cob_id)))
            for layout in slave.rpdos:
                takers.setdefault(layout.cob_id, []).append(_Taker(name, self._rpdo(slave, layout)))
            for watched in slave.watched_node_ids:
                takers.setdefault(Cob.HEARTBEAT + watched, []).append(_Taker(name, self._heartbeat(slave, watched)))
        self._takers = takers
        self._schedule()

    def _schedule(self) -> None:
        self._next_due_ns = min([self.node.next_due_ns, *[slave.next_due_ns for slave in self._running]])

    def _hurry(self) -> None:
        """A node may have something to do earlier than was known."""
        for slave in self._running:
            if slave.next_due_ns < self._next_due_ns:
                self._next_due_ns = slave.next_due_ns

    def _sdo(self, slave: Slave, cob_id: int) -> Callable[[bytes], None]:
        is_card = slave is not self.node

        def take(data: bytes) -> None:
            if is_card:
                self._catch_up(self.time_ns)
            slave.on_sdo(cob_id, data, self.time_ns)
            if is_card:
                self._route()
            else:
                self._schedule()

        return take

    def _rpdo(self, slave: Slave, layout: PdoLayout) -> Callable[[bytes], None]:
        acts_at_once = slave is not self.node and layout.transmission_type not in SYNCHRONOUS_TYPES

        def take(data: bytes) -> None:
            if acts_at_once:
                self._catch_up(self.time_ns)
            slave.on_rpdo(layout, data, self.time_ns)
            if slave.next_due_ns < self._next_due_ns:
                self._next_due_ns = slave.next_due_ns

        return take

    def _heartbeat(self, slave: Slave, watched: int) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            if len(data) == 1:
                slave.on_heartbeat(watched, self.time_ns)
                self._schedule()

        return take

    def _emit_bench(self, time_ns: int, frame: Frame) -> None:
        self.bench_records.append(Record(time_ns, frame))


def _is_sync(frame: Frame) -> bool:
    """Whether it is a SYNC (0x1005 is fixed)."""
    return frame.can_id == Cob.SYNC and not frame.is_extended and not frame.is_remote


def _is_service(frame: Frame) -> bool:
    """NMT with the boot-up message that answers it, and SDO."""
    can_id = frame.can_id
    if frame.is_extended or frame.is_remote:
        return False
    if Cob.HEARTBEAT < can_id <= Cob.HEARTBEAT + HIGHEST_NODE_ID:
        return frame.data == BOOT_UP
    return can_id == Cob.NMT or any(base < can_id <= base + HIGHEST_NODE_ID for base in SDO_BASES)


def _is_silent(wire: Wire) -> bool:
    """Whether nobody has anything to send. Between two steps of the bench no frame is half sent."""
    return not any(node.queue for node in wire.nodes.values())
