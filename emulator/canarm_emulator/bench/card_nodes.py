"""The cards as nodes of the robot's bus: which of them run, which COB-IDs they take, and when they have work to do.

How frames get on the bus never enters.
"""

from collections.abc import Callable, Container, Hashable, Mapping
from typing import NamedTuple

from canarm_protocol.canopen.frames import Cob, NmtState
from canarm_protocol.canopen.pdo import PdoLayout

from ..node.pdo_rules import SYNCHRONOUS_TYPES
from ..node.slave import Slave
from ..robot.timeline import Timeline
from ..timing import NEVER
from ..wire.confinement import ErrorState
from .fault_hooks import FaultHooks

Take = Callable[[bytes], None]

_OPERATIONAL = NmtState.OPERATIONAL


class Taker(NamedTuple):
    """A node, by its name on the bus, and what it does with the data of frames of one COB-ID."""

    name: Hashable
    take: Take


class CardNodes:
    """The cards of a cell (`slaves`) and second ones with their node-IDs. `on_nmt` takes NMT commands for all."""

    def __init__(self, timeline: Timeline, hooks: FaultHooks, on_nmt: Take) -> None:
        self.slaves: list[Slave] = []
        self.running = self.slaves
        """The cards, and second ones with the same node-ID, whose processors run."""
        self.takers: Mapping[int, list[Taker]] = {}
        """Takers by COB-ID."""
        self.next_due_ns = NEVER
        """When `run_timers` has something to do."""
        self._timeline, self._hooks, self._on_nmt = timeline, hooks, on_nmt

    @property
    def is_operational(self) -> bool:
        """Whether a card is in OPERATIONAL."""
        for slave in self.slaves:  # noqa: SIM110  a generator takes five times as long, several times a cycle
            if slave.state is _OPERATIONAL:
                return True
        return False

    def refresh(self) -> None:
        """Find out which cards run and what they take, after one has booted, stopped or changed."""
        hooks = self._hooks
        cards = (*self.slaves, *hooks.doubles.values())
        self.running = [slave for slave in cards if slave.bus_name not in hooks.halted]
        takers: dict[int, list[Taker]] = {Cob.NMT: [Taker(0, self._on_nmt)]}
        for slave in self.running:
            name = slave.bus_name
            for cob_id in slave.sdo_cob_ids:
                takers.setdefault(cob_id, []).append(Taker(name, self._sdo(slave, cob_id)))
            for layout in slave.pdos.rpdos:
                takers.setdefault(layout.cob_id, []).append(Taker(name, self._rpdo(slave, layout)))
            for watched in slave.watched_node_ids:
                takers.setdefault(Cob.HEARTBEAT + watched, []).append(Taker(name, self._heartbeat(slave, watched)))
        self.takers = takers
        self.schedule()

    def schedule(self) -> None:
        """Find out again when a card has something to do."""
        self.next_due_ns = min([slave.next_due_ns for slave in self.running], default=NEVER)

    def hurry(self) -> None:
        """A card may have something to do earlier than was known."""
        for slave in self.running:
            if slave.next_due_ns < self.next_due_ns:
                self.next_due_ns = slave.next_due_ns

    def run_timers(self, now_ns: int) -> None:
        """Every card does what has fallen due by `now_ns`."""
        for slave in self.running:
            if slave.next_due_ns <= now_ns:
                state = slave.state
                if slave.world_due_ns <= now_ns:
                    self._timeline.move_world(now_ns)
                slave.run_timers(now_ns)
                if slave.state is not state:
                    self.refresh()
        self.schedule()

    def answer_remote(self, can_id: int, off: Container[Hashable]) -> bool:
        """Whether a card answers a remote frame by a TPDO. Cards that are `off` do not hear it."""
        self._timeline.catch_up()
        hearing = [slave for slave in self.running if slave.bus_name not in off]
        answers = [slave.on_remote(can_id, self._timeline.time_ns) for slave in hearing]
        return any(answers)

    def on_error_state(self, name: Hashable, state: ErrorState) -> None:
        """The CAN controller of the node with this name, perhaps a card, has changed its error state."""
        for slave in self.running:
            if slave.bus_name == name:
                self._timeline.catch_up()
                slave.on_error_state(state, self._timeline.time_ns)
        self.refresh()

    def _sdo(self, slave: Slave, cob_id: int) -> Take:
        timeline = self._timeline

        def take(data: bytes) -> None:
            timeline.catch_up()
            slave.on_sdo(cob_id, data, timeline.time_ns)
            self.refresh()

        return take

    def _rpdo(self, slave: Slave, layout: PdoLayout) -> Take:
        timeline, acts_at_once = self._timeline, layout.transmission_type not in SYNCHRONOUS_TYPES

        def take(data: bytes) -> None:
            if acts_at_once:
                timeline.catch_up()
            slave.on_rpdo(layout, data, timeline.time_ns)
            if slave.next_due_ns < self.next_due_ns:
                self.next_due_ns = slave.next_due_ns

        return take

    def _heartbeat(self, slave: Slave, watched: int) -> Take:
        timeline = self._timeline

        def take(data: bytes) -> None:
            if len(data) != 1:
                return
            before_ns = slave.next_due_ns
            slave.on_heartbeat(watched, timeline.time_ns)
            if before_ns == self.next_due_ns:
                self.schedule()
            elif slave.next_due_ns < self.next_due_ns:
                self.next_due_ns = slave.next_due_ns

        return take
