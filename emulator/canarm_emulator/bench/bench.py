"""The emulated test bench, without any input or output: frames and times go in, frames come out.

Owns what a frame, a SYNC and an NMT command do, and the cycles of a run. How time passes is in `bench_time`, how frames
get on the robot's bus in `robot_bus`, the bench's own bus in `bench_node`. Sockets, wall clocks and files belong to the
runner. The same object runs in a process of its own or inside a test.
"""

from collections.abc import Collection

from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand, parse_nmt, time_frame
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FrameError

from ..bus_record import Record, new_record
from ..robot.truth import Truth
from ..timing import NEVER
from ..wire.wire import Wire
from .bench_time import BenchTime, CycleTruth
from .robot_bus import is_sync

__all__ = ["Bench", "CycleTruth", "Record"]

_SYNC = int(Cob.SYNC)
_new = tuple.__new__  # takes a third of the time of a named tuple's own
_RESETS = NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION
"""Where a new controller begins. In lockstep the arms have then come to rest, however the one before has ended."""


class Bench(BenchTime):
    """The robot's side of a cell, and the bench node.

    `on_cycle` is called with the truth at every SYNC after NMT start, and for a while after SYNCs have ended. Frames on
    the robot's bus, including those received, collect in order in `records`, those on the bench bus in `bench_records`.
    The caller empties both.

    With `with_wire`, frames arbitrate for the bus, take their time and get the time stamp of their last bit. On the
    wall clock this holds for all frames; in lockstep for those of a running cycle, except SYNC and TIME, which carry
    time itself, and NMT and SDO, whose answers nobody could wait for while time stands still. No card sees the SYNC of
    a client in bus-off, and a card in bus-off sees none.

    Faults come from outside: `attach_faults` has them told of time once a cycle, and when it passes without cycles.
    """

    def start(self) -> None:
        """Power on: every node boots; the bench node starts itself."""
        for slave in self.slaves:
            slave.boot(self._time.time_ns)
        self.node.start()
        self.nodes.refresh()

    def power_cycle(self) -> None:
        """Everything off and on again: no emergency stop, arms parked and at rest, every card boots. Time goes on.

        The figures of the run that it ends stay until the next cycle 0.
        """
        time = self._time
        self.catch_up()
        self.world.power_on()
        if self.device.is_stopped:
            self.device.is_stopped = False
            self.device.faults.note_stop(False)
        for slave in self.slaves:
            slave.boot(time.time_ns)
        time.cycle, time.begin_ns = -1, None
        self._may_move = False
        self._next_sync_ns, self._may_move_on = max(time.time_ns, self.world.time_ns), False
        self.device.truth = self.world.state()
        self.nodes.refresh()

    def move_on(self) -> None:
        """In lockstep, move the world on to the next SYNC as soon as a cycle's inputs have been sent.

        Nothing that a cyclic controller sends acts before that SYNC, so a runner calls this while the controller
        computes. It always happens before the next frame is received, so that the bytes are the same.
        """
        if self._may_move_on:
            self._may_move_on = False
            self._time.move_world(self._next_sync_ns)

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
            if self._is_lockstep or (self.wire is None and not is_lost):
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
        """The bench node sends its TPDOs; the runner calls this while somebody listens."""
        self.node.send_telemetry()

    def change_truth(self, truth: Truth) -> None:
        """Change the true robot from now on."""
        self.world.change(truth)

    def _set_emergency_stop(self, is_on: bool) -> None:
        """Open the supply of every amplifier, or close it again."""
        self.catch_up()
        for joint in range(len(self.cell.joints)):
            self.world.set_supply(joint, not is_on)

    def _sync(self, frame: Frame, origin: object, missed_by: Collection[object] = ()) -> None:
        lockstep, time, bus, world = self._is_lockstep, self._time, self.bus, self.world
        if lockstep:
            self.advance(self._next_sync_ns)
        now_ns = time.time_ns
        bus.records.append(new_record(Record, (now_ns, frame, origin)))
        if self._scan.due_ns != NEVER:
            self.overruns += 1
        if now_ns > world.time_ns:
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
            nominal_ns = self._cycle_ns
            self._next_sync_ns = now_ns + (nominal_ns if length is None else max(1, length(nominal_ns, now_ns)))
        slaves = self.slaves if faults is None and not self._off else bus.hearers(origin, now_ns)
        if missed_by:
            slaves = [slave for slave in slaves if slave.bus_name not in missed_by]
        asked = [slave.on_sync(frame.data, now_ns) for slave in slaves]
        if asked != self._asked or slaves != self._askers:
            self._asked, self._askers = asked, list(slaves)
            self._pdos = [(slave, layout) for slave, own in zip(slaves, asked, strict=True) for layout in own]
        pdos = self._pdos
        self.nodes.hurry()
        if is_operational:
            self._count_cycle(now_ns)
        if pdos and self._scan.due_ns == NEVER:
            self._scan.begin(pdos, now_ns)
        if lockstep:
            self.advance(max(world.time_ns, now_ns))
            if self.wire is not None:
                self._finish_transmissions(self.wire)
            bus.records.append(new_record(Record, (time.time_ns, time_frame(time.time_ns), None)))
            self._may_move_on = True

    def _finish_transmissions(self, wire: Wire) -> None:
        """Let the wire carry the cycle's inputs to the controller, as far as it can before the next SYNC.

        Does not wait for a node in bus-off.
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
        world = self.world
        joints = world.state()
        self.device.cycle, self.device.truth = time.cycle, joints
        self.assessor.truth(time.cycle, joints, world.supply_limited_steps)
        if self.on_cycle is not None:
            self.on_cycle(_new(CycleTruth, (time.cycle, now_ns, joints, world.object if self._has_object else None)))

    def _nmt(self, data: bytes) -> None:
        try:
            command, node_id = parse_nmt(data)
        except FrameError:
            self.bus.ignored_frames += 1
            return
        time, was_operational = self._time, self.nodes.is_operational
        if command in _RESETS:
            self.come_to_rest()
        time.catch_up()
        for slave in self.nodes.running:
            if node_id in (0, slave.node_id) and slave.bus_name not in self.bus.missed_by:
                slave.on_nmt(command, time.time_ns)
        self.device.truth = self.world.state()
        if command is NmtCommand.START and not was_operational:
            time.run, time.cycle, time.begin_ns = time.run + 1, -1, None
            self._may_move = True
            self._next_sync_ns = max(time.time_ns, self.world.time_ns)
        self.nodes.refresh()
