"""The parts of an emulated bench, and how virtual time passes in them: what falls due is done in order.

What a frame, a SYNC or an NMT command does never enters.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Sequence
from typing import NamedTuple

from canarm_protocol.canopen.dictionary import eds_text, load_dictionary
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.model import Card, Cell
from canarm_protocol.clock import Clock

from ..bench_node.assessor import Assessor
from ..bench_node.bench_device import BenchDevice
from ..bench_node.bench_node import BenchNode
from ..bench_node.bus_figures import BusFigures
from ..bench_node.detection_objects import DetectionObjects
from ..bench_node.fault_objects import FaultObjects
from ..bus_record import Record
from ..cards.rack import Rack
from ..node.slave import Slave
from ..robot.carried import ObjectState
from ..robot.timeline import Timeline
from ..robot.truth import Truth
from ..robot.world import JointState, World
from ..timing import MILLISECOND, NEVER
from .card_nodes import CardNodes
from .fault_hooks import FaultHooks, Faults, SecondCard
from .input_scan import InputScan
from .rest import RestWatch
from .robot_bus import RobotBus

RUN_ON_NS = 500_000_000
"""When the sender of SYNC is lost in lockstep, the world runs on for the heartbeat time and this long after it."""
IDLE_STEP_NS = 5_000_000
"""The world moves in steps of this length while there is no SYNC."""
SILENT_CYCLES = 4
"""After this many cycles without SYNC, `on_cycle` is called all the same: tests look at what the arm does then."""
SETTLE_NS = 100_000_000
"""Frames that the wire has not carried after this time will never be carried: nobody is left to acknowledge them."""


class CycleTruth(NamedTuple):
    """The world at a SYNC: cycle since NMT start, its time, and the true state of every joint, and of an object."""

    cycle: int
    time_ns: int
    joints: Sequence[JointState]
    object: ObjectState | None = None


class BenchTime(ABC):
    """A bench as far as its time goes: `advance` lets it pass; `run_on` and `settle` wait for something to end."""

    def __init__(self, cell: Cell, truth: Truth, clock: Clock, seed: int, with_wire: bool = False) -> None:
        self.cell, self.clock = cell, clock
        self._is_lockstep, self._cycle_ns, self._has_object = clock is Clock.SYNC, cell.bus.cycle_ns, bool(cell.object)
        self.on_cycle: Callable[[CycleTruth], None] | None = None
        self.on_rested: Callable[[int], None] | None = None
        """Called when time has run on before a new controller, with the ns that it took."""
        self._may_move = False
        """Whether the arms may have been left moving by a controller."""
        self.overruns = 0
        """SYNCs that arrived while the converters were still busy with the last one's scan."""
        self.world = World(cell, truth, seed)
        self.assessor = Assessor(cell)
        self.rack = Rack(cell, self.world, truth)
        self.hooks = FaultHooks()
        """What faults have changed."""
        self._faults: Faults | None = None
        self._next_sync_ns = 0
        self._may_move_on = False
        self._last_cycle_ns = 0
        self._askers: list[Slave] = []
        self._asked: list[list[PdoLayout]] = []
        """The TPDOs that the last SYNC asked each of `_askers` for, and `_pdos` all of them: the same nearly always."""
        self._pdos: list[tuple[Slave, PdoLayout]] = []
        self._scan = InputScan(self.rack, self.world, self.hooks)
        self._time = Timeline(self.world)
        self.nodes = CardNodes(self._time, self.hooks, self._nmt)
        self.slaves = self.nodes.slaves
        """The cards as nodes, in the cell's order."""
        self.bus = RobotBus(cell, clock, self._time, self.nodes, self.hooks, with_wire, self._sync)
        self.wire, self.trouble = self.bus.wire, self.bus.trouble
        self._off = self.trouble.off
        self.slaves.extend(self.make_card(card, card.node_id) for card in cell.card)
        figures = BusFigures(self.wire, self.trouble, [slave.node_id for slave in self.slaves])
        faults = FaultObjects(self._time_and_run)
        detections = DetectionObjects(lambda: self._time.time_ns)
        self.device = BenchDevice(
            cell, self.assessor, figures, faults, detections, self._set_emergency_stop, lambda: self.power_cycle()
        )
        self.device.truth = self.world.state()
        self.device.refused_directions = lambda: self.world.illegal_directions
        self.node = BenchNode(cell, clock, self._time, self.device, with_wire)
        self._node_slave = self.node.slave

    @property
    def time_ns(self) -> int:
        """Virtual time since the bench was made."""
        return self._time.time_ns

    @property
    def cycle(self) -> int:
        """The last SYNC's number since NMT start; -1 before the first."""
        return self._time.cycle

    @property
    def run(self) -> int:
        """How many runs NMT start has begun so far."""
        return self._time.run

    @property
    def begin_ns(self) -> int | None:
        """Time of cycle 0; None before."""
        return self._time.begin_ns

    @property
    def records(self) -> list[Record]:
        """Frames on the robot's bus."""
        return self.bus.records

    @records.setter
    def records(self, records: list[Record]) -> None:
        self.bus.records = records

    @property
    def bench_records(self) -> list[Record]:
        """Frames on the bench bus."""
        return self.node.records

    @bench_records.setter
    def bench_records(self, records: list[Record]) -> None:
        self.node.records = records

    @property
    def ignored_frames(self) -> int:
        """Frames of clients on the robot's bus that nobody took."""
        return self.bus.ignored_frames

    @property
    def is_operational(self) -> bool:
        """Whether a card is in OPERATIONAL."""
        return self.nodes.is_operational

    def make_card(self, card: Card, name: Hashable) -> Slave:
        """A card named `name` on the robot's bus: one of the cell's, or a second one, which is wired to nothing.

        It has not booted, and the caller must add it to `nodes`.
        """
        node_id = card.node_id
        device = self.rack.spare(card) if isinstance(name, SecondCard) else self.rack.devices[node_id]
        dictionary, emit = load_dictionary(card.model, node_id), self.bus.way_out(node_id, name)
        eds = eds_text(card.model).encode()
        slave = Slave(card.name, node_id, dictionary, device, emit, self.clock.value, eds)
        slave.bus_name = name
        if self.clock is Clock.WALL:
            slave.boot_ns = self.cell.bus.boot_ms * MILLISECOND
        return slave

    @property
    def next_due_ns(self) -> int:
        """When `advance` has something to send."""
        due_ns, other_ns, scan_ns = self.nodes.next_due_ns, self._node_slave.next_due_ns, self._scan.due_ns
        if other_ns < due_ns:
            due_ns = other_ns
        if scan_ns < due_ns:
            due_ns = scan_ns
        if self.wire is not None and (wire_due_ns := self.wire.next_due_ns) < due_ns:
            due_ns = wire_due_ns
        return due_ns if self._faults is None else min(due_ns, self.hooks.due_ns)

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass, on the wall clock or while nobody sends SYNC; a time in the past is no error."""
        time = self._time
        while (due_ns := self.next_due_ns) <= until_ns:
            self._run_due(due_ns)
        if until_ns > time.time_ns:
            time.time_ns = until_ns
            if until_ns - self.world.time_ns > IDLE_STEP_NS:
                self.world.advance(until_ns)
                self._tell_idle_truth()
                if self._faults is not None:
                    self._faults.update(until_ns, time.cycle)
        if self.wire is not None and self.clock is Clock.WALL:
            self.bus.carry(self.wire, until_ns)

    def run_on(self) -> None:
        """In lockstep, without SYNC: let time run on until the cards are safe and the arms at rest."""
        time = self._time
        timeouts_ns = [slave.watch_due_ns for slave in self.slaves if slave.watch_due_ns != NEVER]
        timeouts_ns.append(time.time_ns + self.cell.bus.heartbeat_timeout_ms * 1_000_000)
        end_ns = max(timeouts_ns) + RUN_ON_NS
        rest = RestWatch(time.time_ns, end_ns)
        while rest.waits(time.time_ns):
            step_end_ns = time.time_ns + IDLE_STEP_NS
            self.advance(min(step_end_ns, end_ns) if time.time_ns < end_ns else step_end_ns)
            time.catch_up()
            rest.look(time.time_ns, self.world.state())
            self._tell_idle_truth()
            if self._faults is not None:
                self._faults.update(time.time_ns, time.cycle)
        self._next_sync_ns = time.time_ns
        self._may_move = False

    def come_to_rest(self) -> None:
        """In lockstep, let time run on if a controller has ended while the arms moved, however it has."""
        if self.clock is Clock.SYNC and self._may_move and not self.is_operational:
            before_ns = self._time.time_ns
            self.run_on()
            if self.on_rested is not None:
                self.on_rested(self._time.time_ns - before_ns)

    def settle(self) -> None:
        """At the end of a run, let the wire carry the frames that still wait."""
        wire, limit_ns = self.wire, self._time.time_ns + SETTLE_NS
        while wire is not None and (due_ns := wire.next_due_ns) <= limit_ns:
            self.advance(due_ns)

    def attach_faults(self, faults: Faults) -> None:
        """Tell `faults` of time as it passes from now on."""
        self._faults = faults

    def _time_and_run(self) -> tuple[int, int, bool, int | None]:
        """Virtual time, cycle, and whether a run is on: fault times count from its cycle 0, whose time is the last."""
        begin_ns = self.begin_ns
        return self._time.time_ns, self._time.cycle, self.is_operational and begin_ns is not None, begin_ns

    def catch_up(self) -> None:
        """The world moves on to the bench's time."""
        self._time.catch_up()

    def _tell_idle_truth(self) -> None:
        """Without SYNC, show the truth always, and call `on_cycle` until the cards have acted."""
        joints, time = self.world.state(), self._time
        self.device.truth = joints
        silence_ns = time.time_ns - self._last_cycle_ns
        limit_ns = self.cell.bus.heartbeat_timeout_ms * 1_000_000 + RUN_ON_NS
        is_told = SILENT_CYCLES * self.cell.bus.cycle_ns < silence_ns <= limit_ns
        if is_told and time.cycle >= 0 and self.on_cycle is not None:
            self.on_cycle(CycleTruth(time.cycle, time.time_ns, joints, self.world.object))

    def _run_due(self, due_ns: int) -> None:
        wire = self.wire
        if wire is not None and wire.next_due_ns <= due_ns:
            self.bus.carry(wire, due_ns)
        self._time.reach(due_ns)
        if self._faults is not None:
            self.hooks.release(due_ns)
        if self._scan.due_ns <= due_ns:
            self._scan.finish(due_ns)
        if self.nodes.next_due_ns <= due_ns:
            self.nodes.run_timers(due_ns)
        if self._node_slave.next_due_ns <= due_ns:
            self._node_slave.run_timers(due_ns)

    @abstractmethod
    def power_cycle(self) -> None:
        """Everything off and on again."""

    @abstractmethod
    def _set_emergency_stop(self, is_on: bool) -> None:
        """Open the supply of every amplifier, or close it again."""

    @abstractmethod
    def _sync(self, frame: Frame, origin: object, missed_by: Collection[object] = ()) -> None:
        """A SYNC is on the bus."""

    @abstractmethod
    def _nmt(self, data: bytes) -> None:
        """The data of an NMT command are on the bus."""
