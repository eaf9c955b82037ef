"""A CANopen slave in virtual time (CiA 301): NMT states, SDO server, PDOs of every type, heartbeat both ways, EMCY.

Frames and times go in through methods; frames come out through `emit`. Nothing here waits: answers come at once. The
bench decides which frames a node gets, and when time passes.

Left out, as the standard permits: LSS, SDO towards other nodes, TIME, bit-wise and dummy mapping, 29-bit
identifiers, another COB-ID for SYNC, and changes of PDOs in OPERATIONAL.
"""

from collections.abc import Callable, Hashable

from canarm_protocol.canopen.dictionary import (
    CYCLE_PERIOD,
    EMERGENCY_COB_ID,
    ERROR_BEHAVIOUR,
    ERROR_HISTORY,
    INTERRUPT_ENABLE,
    PRODUCER_HEARTBEAT,
    SYNC_COB_ID,
    SYNC_OVERFLOW,
    SYNC_WINDOW,
    Dictionary,
)
from canarm_protocol.canopen.frames import Cob, ErrorCode, Frame, NmtCommand, NmtState, heartbeat_frame
from canarm_protocol.canopen.pdo import COMMUNICATION, PDO_COUNT, PdoLayout
from canarm_protocol.canopen.sdo import AbortCode

from ..timing import MICROSECOND, NEVER
from ..wire.confinement import ErrorState
from . import save_and_restore
from .analogue_events import AnalogueEvents
from .emergency import EmergencyProducer
from .heartbeats import HeartbeatProducer
from .io_device import IoDevice
from .life_watch import LifeWatch
from .live_objects import APPLICATION_OBJECTS, LiveObjects
from .pdo_rules import check_emergency_cob_id, check_pdo_write, check_sync_cob_id, check_sync_overflow
from .pdos import Pdos
from .rpdo_watch import RpdoWatch
from .sdo_server import SdoServers
from .store import ObjectStore, SdoRefused

Emit = Callable[[int, Frame], None]

SILENT_STATES = (NmtState.STOPPED, NmtState.BOOT_UP)
"""States without SDO and EMCY, in which SYNC has no effect."""
_OPERATIONAL = NmtState.OPERATIONAL  # looking it up is slow
_BOOT_UP = NmtState.BOOT_UP


class Slave:
    """One node. Its object 0x2000 shows `clock_mode` (0 wall, 1 lockstep), 0x1021 holds `eds`."""

    def __init__(
        self,
        name: str,
        node_id: int,
        dictionary: Dictionary,
        device: IoDevice,
        emit: Emit,
        clock_mode: int,
        eds: bytes = b"",
    ) -> None:
        self.name, self.node_id, self.device = name, node_id, device
        self.bus_name: Hashable = node_id
        """Its name on the bus, unique even if two nodes share a node-ID."""
        self.state = NmtState.BOOT_UP
        self.next_due_ns = NEVER
        """When `run_timers` has something to do."""
        self.ignored_frames = 0
        self.boot_ns = 0
        """Time from an NMT reset to the boot-up message."""
        self._boot_due_ns, self._boots_everything = NEVER, True
        self.timer_scale = 1.0
        """Factor on the period of its heartbeat and on its time-outs for others'."""
        self.refuses_sdo = False
        """Whether every SDO request is answered by an abort."""
        self._emit = emit
        self._now_ns = 0
        self._store = ObjectStore(dictionary, self._read_object, self._write_object)
        self._sdo = SdoServers(self._store)
        self._emergency = EmergencyProducer(self._store, node_id, emit, lambda: self.state not in SILENT_STATES)
        self._inputs = AnalogueEvents(self._store) if INTERRUPT_ENABLE in dictionary else None
        self.pdos = Pdos(name, self._store, device, self._inputs, emit)
        """Its process data."""
        self._live = LiveObjects(device, self.pdos, self._inputs, clock_mode, eds)
        self._is_configured = False
        self._rpdo_watch = RpdoWatch(self._store, self._emergency)
        self._heartbeat = HeartbeatProducer(node_id, emit)
        self._life = LifeWatch(self._store, self._emergency)

    def boot(self, now_ns: int, everything: bool = True) -> None:
        """Reset the communication objects, with `everything` all objects, and send the boot-up message."""
        self._boot_due_ns = NEVER
        self._store.reset(keep=lambda index: not everything and not 0x1000 <= index < 0x2000)
        self._sdo.reset()
        self._deactivate_pdos()
        self._rpdo_watch.reset()
        self.device.configure(self._store.number)
        self.device.take_error_values(self._store.number)
        self._emergency.reset()
        self.pdos.reset()
        self._heartbeat.begin(self._store.number(PRODUCER_HEARTBEAT), now_ns, self.timer_scale)
        self._life.reset()
        self._schedule()
        self._emit(now_ns, heartbeat_frame(self.node_id, NmtState.BOOT_UP))
        self.state = NmtState.PRE_OPERATIONAL

    def _restart(self, now_ns: int, everything: bool) -> None:
        """Reset: boot after `boot_ns`. Until then the node hears nothing, and its outputs have their error values."""
        if not self.boot_ns:
            self.boot(now_ns, everything)
            return
        self._boot_due_ns, self._boots_everything = now_ns + self.boot_ns, everything
        self._heartbeat.stop()
        self._life.reset()
        self._emergency.reset()
        self.device.take_error_values(self._store.number)
        self._leave_operational(NmtState.BOOT_UP)

    def resume(self, now_ns: int) -> None:
        """Go on after a standstill of the node: heartbeat, time-outs and the timers of PDOs start again."""
        self._heartbeat.restart(now_ns)
        self._life.restart()
        self._rpdo_watch.restart()
        self._emergency.postpone(now_ns)
        self.pdos.events.restart(now_ns)
        self._schedule()

    def on_nmt(self, command: NmtCommand, now_ns: int) -> None:
        """Obey an NMT command to this node, unless it is booting. EMCY held back by STOPPED is sent at its end."""
        if self._boot_due_ns != NEVER:
            return
        was_stopped = self.state is NmtState.STOPPED
        if command is NmtCommand.START:
            if self.state is not NmtState.OPERATIONAL:
                self._activate_pdos(now_ns)
            self.state = NmtState.OPERATIONAL
        elif command is NmtCommand.STOP:
            self._leave_operational(NmtState.STOPPED)
            self.device.take_error_values(self._store.number)
        elif command is NmtCommand.PRE_OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        else:
            self._restart(now_ns, everything=command is NmtCommand.RESET_NODE)
        if was_stopped and self.state not in SILENT_STATES:
            self._emergency.tell_held_back(now_ns)
            self._schedule()

    @property
    def sdo_cob_ids(self) -> list[int]:
        """COB-IDs that the node's SDO servers listen on."""
        return self._sdo.cob_ids

    @property
    def watch_due_ns(self) -> int:
        """When the next heartbeat of a watched node, or the master that guards this one, is lost."""
        return self._life.due_ns

    @property
    def world_due_ns(self) -> int:
        """When `run_timers` has something to do that reads the card's inputs or sets its outputs."""
        return min(self._boot_due_ns, self._life.due_ns, self.pdos.events.due_ns)

    @property
    def watched_node_ids(self) -> list[int]:
        """The nodes whose heartbeats are monitored (0x1016)."""
        return self._life.node_ids

    def on_sdo(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """Serve one SDO request that came on `cob_id`; answered at `now_ns`, but not in STOPPED nor before boot-up."""
        if self.state in SILENT_STATES or len(data) != 8:
            self.ignored_frames += 1
            return
        self._now_ns = now_ns
        answers = self._sdo.refuse(cob_id, data) if self.refuses_sdo else self._sdo.answer(cob_id, data, now_ns)
        if self._is_configured:
            self._is_configured = False
            self.device.configure(self._store.number)
        for answer in answers:
            self._emit(now_ns, answer)

    def on_rpdo(self, layout: PdoLayout, data: bytes, now_ns: int) -> None:
        """Take an RPDO; a synchronous one acts at the next SYNC, an event-driven one at once.

        Extra bytes are ignored; an RPDO that is too short only causes EMCY 0x8210. A synchronous one after the
        synchronous window (0x1007) has no effect.
        """
        if len(data) < layout.size:
            self.ignored_frames += 1
            self._rpdo_watch.too_short(layout.number, now_ns)
            self._schedule()
            return
        pdos, present = self.pdos, self._emergency.present
        if (self._rpdo_watch.is_timed or present) and self._rpdo_watch.received(layout.number, now_ns):
            self._schedule()
        if not pdos.take(layout, data, now_ns):
            self.ignored_frames += 1
        if pdos.refused or present:
            self._tell_refused(now_ns)

    def on_sync(self, data: bytes, now_ns: int) -> list[PdoLayout]:
        """SYNC: outputs act; returns the TPDOs to be sent once their inputs are converted.

        A SYNC whose length does not fit 0x1019 is reported by EMCY 0x8240 and acts all the same; one whose counter is
        not from 1 to 0x1019 acts like one without.
        """
        if self.state is not _OPERATIONAL and self.state in SILENT_STATES:
            return []
        pdos = self.pdos
        if len(data) != pdos.sync_length:
            self._emergency.begin(ErrorCode.SYNC_LENGTH, now_ns)
            self._schedule()
        elif self._emergency.present:
            self._emergency.end(ErrorCode.SYNC_LENGTH, now_ns)
            self._schedule()
        due = pdos.on_sync(data, now_ns)
        if pdos.refused or self._emergency.present:
            self._tell_refused(now_ns)
        return due

    def on_remote(self, cob_id: int, now_ns: int) -> bool:
        """Answer a remote frame: for a TPDO or, with the COB-ID of the heartbeat, node guarding. Whether it does."""
        if cob_id != Cob.HEARTBEAT + self.node_id:
            return self.pdos.on_remote(cob_id, now_ns)
        answer = None if self.state is NmtState.BOOT_UP else self._life.asked(self.state, now_ns, self.timer_scale)
        if answer is None:
            return False
        self._emit(now_ns, Frame(cob_id, answer))
        self._life.end_error(now_ns)
        self._schedule()
        return True

    def on_heartbeat(self, node_id: int, now_ns: int) -> None:
        """A heartbeat of another node: monitoring begins with the first one (CiA 301, 7.5.2.19)."""
        life, is_in_error = self._life, bool(self._emergency.present)
        before_ns = life.due_ns
        if self.state is not _BOOT_UP and life.heard(node_id, now_ns, self.timer_scale):
            if self.next_due_ns == before_ns or is_in_error:
                self._schedule()
            elif life.due_ns < self.next_due_ns:
                self.next_due_ns = life.due_ns

    def on_error_state(self, state: ErrorState, now_ns: int) -> None:
        """The node's CAN controller has changed its error state; bus-off acts as a lost heartbeat does (0x1029:1)."""
        self._emergency.on_error_state(state, now_ns)
        if state is ErrorState.BUS_OFF:
            self._communication_lost()
        self._schedule()

    def run_timers(self, now_ns: int) -> None:
        """Do what has fallen due by `now_ns`: boot, send a heartbeat, miss one of others, send what has waited."""
        if self._boot_due_ns <= now_ns:
            self.boot(self._boot_due_ns, self._boots_everything)
            return
        self._heartbeat.run(now_ns, self.state, self.timer_scale)
        if self._life.run(now_ns):
            self._communication_lost()
        self._rpdo_watch.run(now_ns)
        if self._emergency.due_ns <= now_ns:
            self._emergency.run(now_ns)
        if self.pdos.events.due_ns <= now_ns:
            self.pdos.events.run(now_ns)
        self._schedule()

    def _tell_refused(self, now_ns: int) -> None:
        self._rpdo_watch.refused(self.pdos.refused, now_ns)
        self._schedule()

    def _communication_lost(self) -> None:
        self.device.take_error_values(self._store.number)
        behaviour = self._store.number(ERROR_BEHAVIOUR, 1)
        if behaviour == 0 and self.state is NmtState.OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._leave_operational(NmtState.STOPPED)

    def _activate_pdos(self, now_ns: int) -> None:
        self.pdos.activate(now_ns)
        self._rpdo_watch.activate(self.pdos.rpdos)
        self._schedule()

    def _deactivate_pdos(self) -> None:
        self.pdos.clear()
        self._rpdo_watch.activate(())

    def _leave_operational(self, state: NmtState) -> None:
        self.state = state
        self._deactivate_pdos()
        self._schedule()

    def _schedule(self) -> None:
        self.next_due_ns = min(
            self._boot_due_ns,
            self._heartbeat.due_ns,
            self._life.due_ns,
            self._rpdo_watch.due_ns,
            self._emergency.due_ns,
            self.pdos.events.due_ns,
        )

    def _read_object(self, index: int, subindex: int) -> bytes | None:
        return self._live.read(self._store, index, subindex)

    def _write_object(self, index: int, subindex: int, data: bytes) -> bool:
        if index >= APPLICATION_OBJECTS:
            setter, is_refused = self.device.setter(index, subindex), self.device.refusal(index, subindex)
            if is_refused is not None and is_refused(self._store.variable(index, subindex).decode_raw(data)):
                raise SdoRefused(AbortCode.INVALID_VALUE)
            if setter is not None:
                setter(self._store.variable(index, subindex).decode_raw(data))
                return True
        value = int.from_bytes(data, "little")
        if index in save_and_restore.SIGNATURES:
            save_and_restore.obey(self._store, index, subindex, value)
            return True
        if index < APPLICATION_OBJECTS:
            self._configure(index, subindex, value)
        elif index == INTERRUPT_ENABLE:
            self.pdos.events.enable(bool(value), self._now_ns)
            self._schedule()
        self._is_configured = index >= APPLICATION_OBJECTS
        return False

    def _configure(self, index: int, subindex: int, value: int) -> None:
        """A client is about to write a communication object: refuse wrong values, and do what takes effect at once."""
        is_operational = self.state is NmtState.OPERATIONAL
        check_pdo_write(self._store, self.pdos.can_map, is_operational, index, subindex, value)
        if index == PRODUCER_HEARTBEAT:
            self._heartbeat.begin(value, self._now_ns, self.timer_scale)
            self._schedule()
        elif self._life.rewrite(index, subindex, value, self._now_ns):
            self._schedule()
        elif 0 <= index - COMMUNICATION["rpdo"] < PDO_COUNT:
            self._rpdo_watch.rewrite(index - COMMUNICATION["rpdo"] + 1, subindex, value, self._now_ns)
            self._schedule()
        elif index == SYNC_COB_ID:
            check_sync_cob_id(value)
        elif index == ERROR_HISTORY:
            if value:
                raise SdoRefused(AbortCode.INVALID_VALUE)
            self._emergency.clear_history()
        elif index == EMERGENCY_COB_ID:
            check_emergency_cob_id(value, self._store.number(EMERGENCY_COB_ID))
        elif index == SYNC_WINDOW:
            self.pdos.window_ns = value * MICROSECOND
        elif index == SYNC_OVERFLOW:
            check_sync_overflow(value, self._store.number(CYCLE_PERIOD))
            self.pdos.take_sync_overflow(value)
