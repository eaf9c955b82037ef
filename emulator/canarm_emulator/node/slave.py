"""A CANopen slave in virtual time (CiA 301): NMT states, SDO server, PDOs of every type, heartbeat both ways, EMCY.

Frames and times go in through methods; frames come out through `emit`. Nothing here waits, and what is answered is
answered at once. Which frames are a node's, and when time passes, is the bench's business.

Left out, as the standard permits: node guarding, SDO block transfer, TIME, bit-wise and dummy mapping, 29-bit
identifiers, another COB-ID for SYNC, and changes of PDOs in OPERATIONAL.
"""

from collections.abc import Callable, Hashable

from canarm_protocol.canopen.dictionary import (
    CLOCK_MODE,
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    EMERGENCY_COB_ID,
    ERROR_BEHAVIOUR,
    ERROR_HISTORY,
    ERROR_REGISTER,
    INTERRUPT_ENABLE,
    INTERRUPT_SOURCE,
    PRODUCER_HEARTBEAT,
    SYNC_COB_ID,
    SYNC_OVERFLOW,
    SYNC_WINDOW,
    Dictionary,
)
from canarm_protocol.canopen.frames import ErrorCode, Frame, NmtCommand, NmtState, heartbeat_frame
from canarm_protocol.canopen.pdo import COMMUNICATION, DISABLED, PDO_COUNT, Kind, MappedObject, PdoLayout, read_layouts
from canarm_protocol.canopen.sdo import AbortCode
from canarm_protocol.errors import DictionaryError

from ..timing import MICROSECOND, MILLISECOND
from ..timing import NEVER as NEVER
from ..wire.confinement import ErrorState
from . import parameters
from .analogue_events import AnalogueEvents
from .emergency import EmergencyProducer
from .event_pdos import EVENT_TIMER, EventPdos
from .heartbeats import HeartbeatConsumer
from .io_device import Getter, IoDevice, Setter
from .pdo_rules import (
    EVENT_DRIVEN_TYPES,
    NO_REMOTE,
    ON_REQUEST,
    SYNCHRONOUS_ON_REQUEST,
    SYNCHRONOUS_TYPES,
    check_emergency_cob_id,
    check_pdo_write,
    check_sync_cob_id,
)
from .rpdo_deadlines import RpdoDeadlines
from .sdo_server import SdoServer
from .store import ObjectStore, SdoRefused

Emit = Callable[[int, Frame], None]

SDO_SERVER, SDO_SERVERS = 0x1200, 0x80
APPLICATION_OBJECTS = 0x2000
SYNC_START_VALUE = 6
"""Sub-index of a TPDO's communication parameter."""


class Slave:
    """One node. `clock_mode` is what its object 0x2000 shows: 0 wall, 1 lockstep."""

    def __init__(
        self, name: str, node_id: int, dictionary: Dictionary, device: IoDevice, emit: Emit, clock_mode: int
    ) -> None:
        self.name, self.node_id, self.device = name, node_id, device
        self.bus_name: Hashable = node_id
        """Its name on the bus, apart from all others even where two nodes share a node-ID."""
        self.state = NmtState.BOOT_UP
        self.next_due_ns = NEVER
        """When `run_timers` has something to do."""
        self.rpdos: list[PdoLayout] = []
        self.tpdos: list[PdoLayout] = []
        self.ignored_frames = 0
        self.timer_scale = 1.0
        """How long the periods of its heartbeat and of those that it waits for last, of what they should."""
        self.refuses_sdo = False
        """Whether every SDO request is answered by an abort."""
        self._emit = emit
        self._clock_mode = clock_mode
        self._now_ns = 0
        self._store = ObjectStore(dictionary, self._read_object, self._write_object)
        self._sdo = {
            dictionary[index][1].default: (SdoServer(self._store), dictionary[index][2].default)
            for index in range(SDO_SERVER, SDO_SERVER + SDO_SERVERS)
            if index in dictionary
        }
        self._emergency = EmergencyProducer(self._store, node_id, emit, lambda: self.state is not NmtState.STOPPED)
        self._inputs = AnalogueEvents(self._store) if INTERRUPT_ENABLE in dictionary else None
        self._events = EventPdos(self._store, device, self._inputs, self.send_tpdo)
        self._is_configured = False
        self._scanned: set[tuple[int, int]] = set()
        self._setters: dict[int, list[Setter]] = {}
        self._getters: dict[int, list[Getter]] = {}
        self._received: dict[int, bytes] = {}
        self._syncs_until_due: dict[int, int] = {}
        self._first_syncs: dict[int, int] = {}
        self._last_sync_ns = NEVER
        self._sync_length = self._sync_overflow = 0
        self._window_ns = 0
        self._deadlines = RpdoDeadlines()
        self._too_short: set[int] = set()
        self._last_sent: dict[int, bytes] = {}
        self._heartbeat_due_ns = NEVER
        self._watch = HeartbeatConsumer(self._store)
        self._is_bus_off = False

    def boot(self, now_ns: int, everything: bool = True) -> None:
        """Reset: communication objects take their defaults, with `everything` the application's too; then boot-up."""
        self._store.reset(keep=lambda index: not everything and not 0x1000 <= index < 0x2000)
        for server, _ in self._sdo.values():
            server.reset()
        self._deactivate_pdos()
        self._deadlines.reset()
        self._too_short.clear()
        self.device.configure(self._store.number)
        self.device.take_error_values(self._store.number)
        self._emergency.reset()
        self._take_sync_overflow(self._store.optional(SYNC_OVERFLOW))
        self._window_ns = self._store.optional(SYNC_WINDOW) * MICROSECOND
        heartbeat_ns = self._store.number(PRODUCER_HEARTBEAT) * MILLISECOND
        self._heartbeat_due_ns = now_ns + self._scaled(heartbeat_ns) if heartbeat_ns else NEVER
        self._watch.reset()
        self._is_bus_off = False
        self._schedule()
        self._emit(now_ns, heartbeat_frame(self.node_id, NmtState.BOOT_UP))
        self.state = NmtState.PRE_OPERATIONAL

    def resume(self, now_ns: int) -> None:
        """Go on after a standstill of the node: heartbeat, time-outs and the timers of PDOs start anew."""
        if self._heartbeat_due_ns != NEVER:
            self._heartbeat_due_ns = now_ns
        self._watch.reset()
        self._deadlines.restart()
        self._emergency.postpone(now_ns)
        self._events.restart(now_ns)
        self._schedule()

    def on_nmt(self, command: NmtCommand, now_ns: int) -> None:
        """Obey an NMT command addressed to this node. EMCY that STOPPED has held back is sent when it ends."""
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
            self.boot(now_ns, everything=command is NmtCommand.RESET_NODE)
        if was_stopped and self.state is not NmtState.STOPPED:
            self._emergency.tell_held_back(now_ns)
            self._schedule()

    @property
    def sdo_cob_ids(self) -> list[int]:
        """COB-IDs that the node's SDO servers listen on."""
        return list(self._sdo)

    @property
    def watch_due_ns(self) -> int:
        """When the next heartbeat of a watched node is lost."""
        return self._watch.due_ns

    @property
    def world_due_ns(self) -> int:
        """When `run_timers` has something to do that reads the card's inputs or sets its outputs."""
        return min(self._watch.due_ns, self._events.due_ns)

    @property
    def watched_node_ids(self) -> list[int]:
        """The nodes whose heartbeats are monitored (0x1016)."""
        return self._watch.node_ids

    def on_sdo(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """Serve one SDO request that came on `cob_id`; answered at `now_ns`, not answered in STOPPED."""
        if self.state is NmtState.STOPPED or len(data) != 8:
            self.ignored_frames += 1
            return
        self._now_ns = now_ns
        server, answer_id = self._sdo[cob_id]
        answer = server.answer(data) if not self.refuses_sdo else server.refuse(data, AbortCode.GENERAL)
        if self._is_configured:
            self._is_configured = False
            self.device.configure(self._store.number)
        if answer is not None:
            self._emit(now_ns, Frame(answer_id, answer))

    def on_rpdo(self, layout: PdoLayout, data: bytes, now_ns: int) -> None:
        """Take an RPDO; a synchronous one acts at the next SYNC, an event-driven one at once.

        Bytes beyond the mapped ones are left aside; one that is too short has no effect but EMCY 0x8210. A synchronous
        one that comes after the synchronous window (0x1007) has none at all.
        """
        if len(data) < layout.size:
            self.ignored_frames += 1
            self._too_short.add(layout.number)
            self._emergency.begin(ErrorCode.PDO_LENGTH, now_ns)
            self._schedule()
            return
        is_monitored = self._deadlines.is_used and self._deadlines.received(layout.number, now_ns)
        if self._emergency.present:
            self._too_short.discard(layout.number)
            self._end_rpdo_errors(now_ns)
        if is_monitored or self._emergency.present:
            self._schedule()
        if layout.transmission_type in SYNCHRONOUS_TYPES:
            if self._window_ns and now_ns - self._last_sync_ns > self._window_ns:
                self.ignored_frames += 1
            else:
                self._received[layout.number] = data
        else:
            self._apply(layout, data)

    def apply_outputs(self) -> None:
        """SYNC: what was received since the last one acts now."""
        for layout in self.rpdos:
            data = self._received.pop(layout.number, None)
            if data is not None:
                self._apply(layout, data)

    def on_sync(self, data: bytes, now_ns: int) -> list[PdoLayout]:
        """SYNC: outputs act; returns the TPDOs to be sent once their inputs are converted.

        One whose length is not what 0x1019 says is reported by EMCY 0x8240 and acts nevertheless; one whose counter is
        not within 1 and 0x1019 acts as one without.
        """
        if self.state is NmtState.STOPPED:
            return []
        if len(data) != self._sync_length:
            self._emergency.begin(ErrorCode.SYNC_LENGTH, now_ns)
            self._schedule()
        elif self._emergency.present:
            self._emergency.end(ErrorCode.SYNC_LENGTH, now_ns)
            self._schedule()
        self._last_sync_ns = now_ns
        if self._received:
            self.apply_outputs()
        if not self.tpdos:
            return []
        return self.tpdos_due(data[0] if data and data[0] <= self._sync_overflow else 0)

    def tpdos_due(self, counter: int = 0) -> list[PdoLayout]:
        """The TPDOs that the SYNC with this counter asks for; 0 is one without."""
        due = []
        for layout in self.tpdos:
            transmission_type = layout.transmission_type
            if self._first_syncs and layout.number in self._first_syncs:
                if self._first_syncs[layout.number] != counter:
                    continue
                del self._first_syncs[layout.number]
            if transmission_type <= 1 or transmission_type == SYNCHRONOUS_ON_REQUEST:
                due.append(layout)
            elif transmission_type in SYNCHRONOUS_TYPES:
                left = self._syncs_until_due[layout.number] - 1
                if left == 0:
                    due.append(layout)
                    left = transmission_type
                self._syncs_until_due[layout.number] = left
        return due

    def send_tpdo(self, layout: PdoLayout, now_ns: int) -> None:
        """Send one TPDO, if it is still in force.

        One of type 0 is sent only when its data differ from what it last sent; one of type 252 waits for a remote
        frame. A synchronous one whose time has come after the synchronous window (0x1007) is left out.
        """
        if layout not in self.tpdos:
            return
        transmission_type = layout.transmission_type
        if self._window_ns and now_ns - self._last_sync_ns > self._window_ns and transmission_type < ON_REQUEST:
            return
        data = self._pack(layout)
        if transmission_type == 0:
            if self._last_sent.get(layout.number) == data:
                return
            self._last_sent[layout.number] = data
        elif transmission_type == SYNCHRONOUS_ON_REQUEST:
            self._last_sent[layout.number] = data
            return
        self._emit(now_ns, Frame(layout.cob_id, data))

    def on_remote(self, cob_id: int, now_ns: int) -> bool:
        """A remote frame: a TPDO of that COB-ID is sent, unless bit 30 forbids it. Returns whether there is one.

        Synchronous ones carry what was sampled at the last SYNC, the others what is there now.
        """
        for layout in self.tpdos:
            if layout.cob_id == cob_id:
                if self._store.number(COMMUNICATION["tpdo"] + layout.number - 1, 1) & NO_REMOTE:
                    return False
                if layout.transmission_type in (ON_REQUEST, *EVENT_DRIVEN_TYPES):
                    self._events.refresh(layout)
                data = self._pack(layout)
                if layout.transmission_type == SYNCHRONOUS_ON_REQUEST:
                    data = self._last_sent.get(layout.number, data)
                self._emit(now_ns, Frame(cob_id, data))
                return True
        return False

    def _pack(self, layout: PdoLayout) -> bytes:
        return layout.pack(*[getter() for getter in self._getters[layout.number]])

    def on_heartbeat(self, node_id: int, now_ns: int) -> None:
        """A heartbeat of another node: monitoring begins with the first one (CiA 301, 7.5.2.19)."""
        if not self._watch.heard(node_id, now_ns, self.timer_scale):
            return
        if not self._watch.is_any_lost:
            self._emergency.end(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, now_ns)
        self._schedule()

    def on_error_state(self, state: ErrorState, now_ns: int) -> None:
        """The node's CAN controller has changed its error state.

        EMCY 0x8120 for as long as it is error-passive. Bus-off acts as a lost heartbeat does (CiA 301, 0x1029:1); back
        from there the node sends EMCY 0x8140, and that all is well.
        """
        if state is ErrorState.PASSIVE:
            self._emergency.begin(ErrorCode.ERROR_PASSIVE, now_ns)
        elif state is ErrorState.BUS_OFF:
            self._is_bus_off = True
            self._communication_lost()
        else:
            if self._is_bus_off:
                self._is_bus_off = False
                self._emergency.begin(ErrorCode.RECOVERED_FROM_BUS_OFF, now_ns)
            self._emergency.end(ErrorCode.ERROR_PASSIVE, now_ns)
            self._emergency.end(ErrorCode.RECOVERED_FROM_BUS_OFF, now_ns)
        self._schedule()

    def run_timers(self, now_ns: int) -> None:
        """Do what has fallen due by `now_ns`: produce a heartbeat, notice that one is missing, send what was due."""
        if self._heartbeat_due_ns <= now_ns:
            self._emit(self._heartbeat_due_ns, heartbeat_frame(self.node_id, self.state))
            self._heartbeat_due_ns += self._scaled(self._store.number(PRODUCER_HEARTBEAT) * MILLISECOND)
        if self._watch.due_ns <= now_ns:
            self._emergency.begin(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, self._watch.due_ns)
            self._watch.run(now_ns)
            self._communication_lost()
        if self._deadlines.due_ns <= now_ns:
            self._emergency.begin(ErrorCode.RPDO_TIMEOUT, self._deadlines.due_ns)
            self._deadlines.run(now_ns)
        if self._emergency.due_ns <= now_ns:
            self._emergency.run(now_ns)
        if self._events.due_ns <= now_ns:
            self._events.run(now_ns)
        self._schedule()

    def _communication_lost(self) -> None:
        self.device.take_error_values(self._store.number)
        behaviour = self._store.number(ERROR_BEHAVIOUR, 1)
        if behaviour == 0 and self.state is NmtState.OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._leave_operational(NmtState.STOPPED)

    def _end_rpdo_errors(self, now_ns: int) -> None:
        """Report the end of what no RPDO suffers from any more."""
        if not self._deadlines.missed:
            self._emergency.end(ErrorCode.RPDO_TIMEOUT, now_ns)
        if not self._too_short:
            self._emergency.end(ErrorCode.PDO_LENGTH, now_ns)

    def _apply(self, layout: PdoLayout, data: bytes) -> None:
        for setter, value in zip(self._setters[layout.number], layout.unpack(data[: layout.size]), strict=True):
            setter(value)

    def _activate_pdos(self, now_ns: int) -> None:
        """PDOs that map nothing are none."""
        dictionary, number, optional = self._store.dictionary, self._store.number, self._store.optional
        self.rpdos = [layout for layout in read_layouts(dictionary, "rpdo", number) if layout.objects]
        self.tpdos = [layout for layout in read_layouts(dictionary, "tpdo", number) if layout.objects]
        self._setters = {layout.number: [self._setter(m) for m in layout.objects] for layout in self.rpdos}
        self._getters = {layout.number: [self._getter(m) for m in layout.objects] for layout in self.tpdos}
        self._scanned = {(m.index, m.subindex) for layout in self.tpdos for m in layout.objects}
        self._syncs_until_due = {layout.number: layout.transmission_type for layout in self.tpdos}
        starts = {p.number: optional(COMMUNICATION["tpdo"] + p.number - 1, SYNC_START_VALUE) for p in self.tpdos}
        self._first_syncs = {n: start for n, start in starts.items() if start and self._sync_length}
        timers_ms = {p.number: optional(COMMUNICATION["rpdo"] + p.number - 1, EVENT_TIMER) for p in self.rpdos}
        self._deadlines.activate({number: time_ms * MILLISECOND for number, time_ms in timers_ms.items()})
        self._events.activate(self.tpdos, now_ns)
        self._schedule()

    def _setter(self, mapped: MappedObject) -> Setter:
        setter = self.device.setter(mapped.index, mapped.subindex)
        if setter is None:
            raise DictionaryError(
                f"{self.name}: an RPDO maps 0x{mapped.index:04X}:{mapped.subindex:02X}, no output of the card"
            )
        return setter

    def _getter(self, mapped: MappedObject) -> Getter:
        index, subindex = mapped.index, mapped.subindex
        return self.device.getter(index, subindex) or (lambda: self._store.number(index, subindex))

    def _can_map(self, kind: Kind, index: int, subindex: int) -> bool:
        if kind == "rpdo":
            return self.device.setter(index, subindex) is not None
        return index == ERROR_REGISTER or self.device.getter(index, subindex) is not None

    def _deactivate_pdos(self) -> None:
        self.rpdos, self.tpdos = [], []
        self._scanned.clear()
        self._received.clear()
        self._last_sent.clear()
        self._events.clear()
        self._deadlines.activate({})
        self._last_sync_ns = NEVER

    def _leave_operational(self, state: NmtState) -> None:
        self.state = state
        self._deactivate_pdos()
        self._schedule()

    def _scaled(self, period_ns: int) -> int:
        return period_ns if self.timer_scale == 1.0 else round(period_ns * self.timer_scale)

    def _schedule(self) -> None:
        self.next_due_ns = min(
            self._heartbeat_due_ns,
            self._watch.due_ns,
            self._deadlines.due_ns,
            self._emergency.due_ns,
            self._events.due_ns,
        )

    def _read_object(self, index: int, subindex: int) -> bytes | None:
        if index == CLOCK_MODE:
            return bytes((self._clock_mode,))
        if index == ERROR_HISTORY and subindex and subindex > self._store.number(ERROR_HISTORY):
            raise SdoRefused(AbortCode.NO_DATA)
        if index == INTERRUPT_SOURCE and subindex and self._inputs is not None:
            return self._inputs.take_sources().to_bytes(4, "little")
        if index >= APPLICATION_OBJECTS:
            if (index, subindex) not in self._scanned:
                self.device.refresh(index, subindex)
            getter = self.device.getter(index, subindex)
            if getter is not None:
                return bytes(self._store.variable(index, subindex).encode_raw(getter()))
        return None

    def _write_object(self, index: int, subindex: int, data: bytes) -> bool:
        setter = self.device.setter(index, subindex) if index >= APPLICATION_OBJECTS else None
        if setter is not None:
            setter(self._store.variable(index, subindex).decode_raw(data))
            return True
        value = int.from_bytes(data, "little")
        if index in parameters.SIGNATURES:
            parameters.obey(self._store, index, subindex, value)
            return True
        if index < APPLICATION_OBJECTS:
            self._configure(index, subindex, value)
        elif index == INTERRUPT_ENABLE:
            self._events.enable(bool(value), self._now_ns)
            self._schedule()
        self._is_configured = index >= APPLICATION_OBJECTS
        return False

    def _take_sync_overflow(self, value: int) -> None:
        self._sync_overflow, self._sync_length = value, 1 if value else 0

    def _configure(self, index: int, subindex: int, value: int) -> None:
        """A client is about to write a communication object: refuse what cannot be, act on what acts at once."""
        is_operational = self.state is NmtState.OPERATIONAL
        check_pdo_write(self._store, self._can_map, is_operational, index, subindex, value)
        if index == PRODUCER_HEARTBEAT:
            self._heartbeat_due_ns = self._now_ns + self._scaled(value * MILLISECOND) if value else NEVER
            self._schedule()
        elif index == CONSUMER_HEARTBEAT:
            self._watch.rewrite(subindex, value)
            if not self._watch.is_any_lost:
                self._emergency.end(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, self._now_ns)
            self._schedule()
        elif 0 <= index - COMMUNICATION["rpdo"] < PDO_COUNT:
            number, is_disabled = index - COMMUNICATION["rpdo"] + 1, subindex == 1 and value & DISABLED
            if is_disabled:
                self._too_short.discard(number)
            if is_disabled or (subindex == EVENT_TIMER and not value):
                self._deadlines.missed.discard(number)
            self._end_rpdo_errors(self._now_ns)
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
            self._window_ns = value * MICROSECOND
        elif index == SYNC_OVERFLOW:
            if self._store.number(CYCLE_PERIOD):
                raise SdoRefused(AbortCode.DEVICE_STATE)
            if value == 1:
                raise SdoRefused(AbortCode.INVALID_VALUE)
            self._take_sync_overflow(value)
