"""The emulated test bench, without any input or output: frames and times go in, frames come out.

Owns why virtual time passes, what a SYNC and an NMT command do, and the cycles of a run. How frames get on the robot's
bus is `robot_bus`'s, the bench bus `bench_node`'s. Sockets, wall clocks and files belong to the runner. The same object
runs in a process of its own or inside a test.
"""

from collections.abc import Callable, Collection, Hashable, Sequence
from typing import NamedTuple

from canarm_protocol.canopen.dictionary import eds_text, load_dictionary
from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand, parse_nmt, time_frame
from canarm_protocol.cell.model import Card, Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FrameError

from ..bench_node.assessor import Assessor
from ..bench_node.bench_device import BenchDevice
from ..bench_node.bench_node import BenchNode
from ..bench_node.bus_figures import BusFigures
from ..bench_node.fault_objects import FaultObjects
from ..bus_record import Record, record
from ..cards.rack import Rack
from ..node.slave import Slave
from ..robot.timeline import Timeline
from ..robot.truth import Truth
from ..robot.world import JointState, World
from ..timing import MILLISECOND, NEVER
from ..wire.wire import Wire
from .card_nodes import CardNodes
from .fault_hooks import FaultHooks, Faults, SecondCard
from .input_scan import InputScan
from .rest import RestWatch
from .robot_bus import RobotBus, is_sync

__all__ = ["Bench", "CycleTruth", "Record"]

RUN_ON_NS = 500_000_000
"""How long after the heartbeat time the world runs on when the sender of SYNC is lost in lockstep."""
IDLE_STEP_NS = 5_000_000
"""The world follows in pieces of this length while no SYNC asks for more."""
SILENT_CYCLES = 4
"""The truth is told after this many cycles without SYNC as well: a test wants to see what the arm does then."""
SETTLE_NS = 100_000_000
"""What a wire has not carried after so much time, it never will: nobody is left to acknowledge."""
_SYNC = int(Cob.SYNC)


class CycleTruth(NamedTuple):
    """The world at a SYNC: cycle since NMT start, its time, the true state of every joint."""

    cycle: int
    time_ns: int
    joints: Sequence[JointState]


class Bench:
    """The robot's side of a cell, and the bench node.

    `on_cycle` is called with the truth at every SYNC after NMT start, and for a while after SYNCs have ended. Frames on
    the robot's bus, those received included, gather in order in `records`; those on the bench bus in `bench_records`.
    Whoever drives it empties both.

    `with_wire` lets frames take the time that the wire needs, one after the other by arbitration, stamped with the end
    of the frame: all of them on the wall clock; in lockstep those of a running cycle but for SYNC and TIME, which carry
    time itself, and NMT and SDO, whose answer nobody could wait for while time stands still. No card sees the SYNC of a
    client in bus-off, and a card in bus-off sees none.

    What breaks it comes from outside, and is told of time once a cycle and whenever it passes without cycles
    (`attach_faults`).
    """

    def __init__(self, cell: Cell, truth: Truth, clock: Clock, seed: int, with_wire: bool = False) -> None:
        self.cell, self.clock = cell, clock
        self.on_cycle: Callable[[CycleTruth], None] | None = None
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
        self.device = BenchDevice(
            cell, self.assessor, figures, faults, self._set_emergency_stop, lambda: self.power_cycle()
        )
        self.device.truth = self.world.state()
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
        """When cycle 0 was; None before."""
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
        """Frames on the robot's bus that nobody took, those of cards left aside."""
        return self.bus.ignored_frames

    @property
    def is_operational(self) -> bool:
        """Whether a card is in OPERATIONAL."""
        return self.nodes.is_operational

    def make_card(self, card: Card, name: Hashable) -> Slave:
        """A card that goes by `name` on the robot's bus: one of the cell's, or a second one, which is wired to nothing.

        It has not booted, and is to be told to `nodes`.
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

    def start(self) -> None:
        """Power on: every node boots; the bench node starts itself."""
        for slave in self.slaves:
            slave.boot(self._time.time_ns)
        self.node.start()
        self.nodes.refresh()

    @property
    def next_due_ns(self) -> int:
        """When `advance` has something to send."""
        due_ns = self.nodes.next_due_ns
        if self._node_slave.next_due_ns < due_ns:
            due_ns = self._node_slave.next_due_ns
        if self._scan.due_ns < due_ns:
            due_ns = self._scan.due_ns
        if self.wire is not None and (wire_due_ns := self.wire.next_due_ns) < due_ns:
            due_ns = wire_due_ns
        return due_ns if self._faults is None else min(due_ns, self.hooks.due_ns)

    def advance(self, until_ns: int) -> None:
        """Let virtual time pass, on the wall clock or while nobody sends SYNC; a time gone by is no error."""
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
        """In lockstep, the sender of SYNC is lost: time runs on until the cards are safe and the arms at rest."""
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

    def power_cycle(self) -> None:
        """Everything off and on again: no emergency stop, arms parked and at rest, every card boots. Time goes on."""
        time = self._time
        self.catch_up()
        self.world.power_on()
        self.device.is_stopped = False
        for slave in self.slaves:
            slave.boot(time.time_ns)
        time.cycle, time.begin_ns = -1, None
        self._next_sync_ns, self._may_move_on = max(time.time_ns, self.world.time_ns), False
        self.assessor.begin()
        self.device.truth = self.world.state()
        self.nodes.refresh()

    def move_on(self) -> None:
        """In lockstep, the world goes on to the next SYNC as soon as a cycle's inputs are out.

        Nothing that a cyclic controller sends acts before that SYNC, so this need not wait for it: a runner calls it
        while the controller computes. It always comes before the next frame is taken, so that the bytes are the same.
        """
        if self._may_move_on:
            self._may_move_on = False
            self._time.move_world(self._next_sync_ns)

    def settle(self) -> None:
        """Let the wire carry what still waits on it, at the end of a run."""
        wire, limit_ns = self.wire, self._time.time_ns + SETTLE_NS
        while wire is not None and (due_ns := wire.next_due_ns) <= limit_ns:
            self.advance(due_ns)

    def leave(self, origin: object) -> None:
        """A client has left the robot's bus; what it sent before is still carried."""
        if self.clock is Clock.SYNC and self.bus.is_attached(origin):
            self.settle()
        self.bus.leave(origin)

    def receive(self, frame: Frame, origin: object = None) -> None:
        """A frame arrives on the robot's bus at `time_ns`."""
        if self._may_move_on:
            self.move_on()
        is_lost = bool(self._off) and self.bus.is_lost(origin)
        if frame.can_id == _SYNC and is_sync(frame):
            if self.clock is Clock.SYNC or (self.wire is None and not is_lost):
                self._sync(frame, origin)
                return
        elif self.hooks.towards_cards is not None and not is_lost:
            self.hooks.towards_cards.take(self._time.time_ns, frame, origin)
            return
        self.bus.take_in(self._time.time_ns, frame, origin)

    def receive_bench(self, frame: Frame, origin: object = None) -> None:
        """A frame arrives on the bench bus. It never touches the robot's bus."""
        self.node.receive(frame, origin)

    def send_telemetry(self) -> None:
        """The bench node sends its TPDOs: for a runner that knows that somebody listens."""
        self.node.send_telemetry()

    def attach_faults(self, faults: Faults) -> None:
        """From now on `faults` are told of time as it passes."""
        self._faults = faults

    def change_truth(self, truth: Truth) -> None:
        """The true robot is another one from now on."""
        self.world.change(truth)

    def _time_and_run(self) -> tuple[int, int, bool]:
        """Virtual time, cycle, and whether a run is on: fault times count from its cycle 0."""
        return self._time.time_ns, self._time.cycle, self.is_operational and self.begin_ns is not None

    def catch_up(self) -> None:
        """The world moves on to the bench's time."""
        self._time.catch_up()

    def _set_emergency_stop(self, is_on: bool) -> None:
        """Open the supply of every amplifier, or close it again."""
        self.catch_up()
        for joint in range(len(self.cell.joints)):
            self.world.set_supply(joint, not is_on)

    def _sync(self, frame: Frame, origin: object, missed_by: Collection[object] = ()) -> None:
        lockstep, time, bus, world = self.clock is Clock.SYNC, self._time, self.bus, self.world
        if lockstep:
            self.advance(self._next_sync_ns)
        now_ns = time.time_ns
        bus.records.append(record(now_ns, frame, origin))
        if self._scan.due_ns != NEVER:
            self.overruns += 1
        time.catch_up()
        is_operational = self.nodes.is_operational
        if is_operational and time.cycle < 0:
            time.begin_ns = now_ns
        faults = self._faults
        if faults is not None:
            faults.update(now_ns, time.cycle + is_operational)
            is_operational = self.nodes.is_operational
        if lockstep:
            length = self.hooks.cycle_length
            nominal_ns = self.cell.bus.cycle_ns
            self._next_sync_ns = now_ns + (nominal_ns if length is None else max(1, length(nominal_ns, now_ns)))
        slaves = self.slaves if faults is None and not self._off else bus.hearers(origin, now_ns)
        if missed_by:
            slaves = [slave for slave in slaves if slave.bus_name not in missed_by]
        pdos = [(slave, layout) for slave in slaves for layout in slave.on_sync(frame.data, now_ns)]
        self.nodes.hurry()
        if is_operational:
            self._count_cycle(now_ns)
        if pdos and self._scan.due_ns == NEVER:
            self._scan.begin(pdos, now_ns)
        if lockstep:
            self.advance(max(world.time_ns, now_ns))
            if self.wire is not None:
                self._finish_transmissions(self.wire)
            bus.records.append(record(time.time_ns, time_frame(time.time_ns)))
            self._may_move_on = True

    def _finish_transmissions(self, wire: Wire) -> None:
        """The cycle's inputs reach the controller when the wire has carried them, or never if it is too slow.

        Nobody waits here for a node in bus-off.
        """
        while (due_ns := wire.next_due_ns) < self._next_sync_ns:
            if self._off and self.bus.is_silent:
                break
            self.advance(due_ns)

    def _count_cycle(self, now_ns: int) -> None:
        time = self._time
        time.cycle += 1
        self._last_cycle_ns = now_ns
        if time.cycle == 0:
            self.assessor.begin()
        joints = self.world.state()
        self.device.cycle, self.device.truth = time.cycle, joints
        self.assessor.truth(time.cycle, joints, self.world.supply_limited_steps)
        if self.on_cycle is not None:
            self.on_cycle(CycleTruth(time.cycle, now_ns, joints))

    def _tell_idle_truth(self) -> None:
        """The truth while no SYNC asks for it: shown always, told to `on_cycle` until the cards have acted."""
        joints, time = self.world.state(), self._time
        self.device.truth = joints
        silence_ns = time.time_ns - self._last_cycle_ns
        limit_ns = self.cell.bus.heartbeat_timeout_ms * 1_000_000 + RUN_ON_NS
        is_told = SILENT_CYCLES * self.cell.bus.cycle_ns < silence_ns <= limit_ns
        if is_told and time.cycle >= 0 and self.on_cycle is not None:
            self.on_cycle(CycleTruth(time.cycle, time.time_ns, joints))

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

    def _nmt(self, data: bytes) -> None:
        try:
            command, node_id = parse_nmt(data)
        except FrameError:
            self.bus.ignored_frames += 1
            return
        time, was_operational = self._time, self.nodes.is_operational
        time.catch_up()
        for slave in self.nodes.running:
            if node_id in (0, slave.node_id) and slave.bus_name not in self.bus.missed_by:
                slave.on_nmt(command, time.time_ns)
        self.device.truth = self.world.state()
        if command is NmtCommand.START and not was_operational:
            time.run, time.cycle, time.begin_ns = time.run + 1, -1, None
            self._next_sync_ns = max(time.time_ns, self.world.time_ns)
        self.nodes.refresh()
