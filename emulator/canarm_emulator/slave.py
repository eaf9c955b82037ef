"""A CANopen slave in virtual time (CiA 301): NMT states, SDO server, synchronous PDOs, heartbeat both ways, EMCY.

Frames and times go in through methods; frames come out through `emit`. Nothing here waits, and what is answered is
answered at once. Which frames are a node's, and when time passes, is the bench's business.
"""

from collections.abc import Callable

from canarm_protocol.dictionary import (
    CLOCK_MODE,
    CONSUMER_HEARTBEAT,
    CYCLE_PERIOD,
    ERROR_BEHAVIOUR,
    ERROR_HISTORY,
    ERROR_REGISTER,
    PRODUCER_HEARTBEAT,
    SYNC_OVERFLOW,
    Dictionary,
)
from canarm_protocol.errors import DictionaryError
from canarm_protocol.frames import Emergency, ErrorCode, Frame, NmtCommand, NmtState, heartbeat_frame
from canarm_protocol.pdo import Kind, MappedObject, PdoLayout, read_layouts
from canarm_protocol.sdo import AbortCode

from .device import Getter, IoDevice, Setter
from .pdo_rules import SYNCHRONOUS_TYPES, check_pdo_write
from .sdo_server import SdoServer
from .store import ObjectStore, SdoRefused

Emit = Callable[[int, Frame], None]

NEVER = 1 << 62
MILLISECOND = 1_000_000
SDO_SERVER, SDO_SERVERS = 0x1200, 0x80
APPLICATION_OBJECTS = 0x2000
GENERIC_ERROR, COMMUNICATION_ERROR = 0x01, 0x10
"""Bits of the error register (CiA 301, 7.5.2.2)."""
HISTORY_LENGTH = 4


class Slave:
    """One node. `clock_mode` is what its object 0x2000 shows: 0 wall, 1 lockstep."""

    def __init__(
        self, name: str, node_id: int, dictionary: Dictionary, device: IoDevice, emit: Emit, clock_mode: int
    ) -> None:
        self.name, self.node_id, self.device = name, node_id, device
        self.state = NmtState.BOOT_UP
        self.next_due_ns = NEVER
        """When `run_timers` has something to do."""
        self.rpdos: list[PdoLayout] = []
        self.tpdos: list[PdoLayout] = []
        self.ignored_frames = 0
        self._emit = emit
        self._clock_mode = clock_mode
        self._now_ns = 0
        self._store = ObjectStore(dictionary, self._read_object, self._write_object)
        self._sdo = {
            dictionary[index][1].default: (SdoServer(self._store), dictionary[index][2].default)
            for index in range(SDO_SERVER, SDO_SERVER + SDO_SERVERS)
            if index in dictionary
        }
        self._errors: list[ErrorCode] = []
        self._scanned: set[tuple[int, int]] = set()
        self._setters: dict[int, list[Setter]] = {}
        self._getters: dict[int, list[Getter]] = {}
        self._received: dict[int, bytes] = {}
        self._syncs_until_due: dict[int, int] = {}
        self._last_sent: dict[int, bytes] = {}
        self._heartbeat_due_ns = NEVER
        self._watch_due_ns = NEVER

    def boot(self, now_ns: int, everything: bool = True) -> None:
        """Reset: communication objects take their defaults, with `everything` the application's too; then boot-up."""
        self._store.reset(keep=lambda index: not everything and not 0x1000 <= index < 0x2000)
        for server, _ in self._sdo.values():
            server.reset()
        self._deactivate_pdos()
        self.device.take_error_values(self._store.number)
        self._heartbeat_due_ns = self._watch_due_ns = NEVER
        self._errors.clear()
        self._schedule()
        self._emit(now_ns, heartbeat_frame(self.node_id, NmtState.BOOT_UP))
        self.state = NmtState.PRE_OPERATIONAL

    def on_nmt(self, command: NmtCommand, now_ns: int) -> None:
        """Obey an NMT command addressed to this node."""
        if command is NmtCommand.START:
            if self.state is not NmtState.OPERATIONAL:
                self._activate_pdos()
            self.state = NmtState.OPERATIONAL
        elif command is NmtCommand.STOP:
            self._leave_operational(NmtState.STOPPED)
            self.device.take_error_values(self._store.number)
        elif command is NmtCommand.PRE_OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        else:
            self.boot(now_ns, everything=command is NmtCommand.RESET_NODE)

    @property
    def sdo_cob_ids(self) -> list[int]:
        """COB-IDs that the node's SDO servers listen on."""
        return list(self._sdo)

    @property
    def watch_due_ns(self) -> int:
        """When the watched node's heartbeat is lost."""
        return self._watch_due_ns

    @property
    def watched_node_id(self) -> int:
        """The node whose heartbeat is monitored (0x1016:1); none is where the node-ID is 0 or above 127."""
        return self._store.number(CONSUMER_HEARTBEAT, 1) >> 16 & 0xFF

    def on_sdo(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """Serve one SDO request that came on `cob_id`; answered at `now_ns`, not answered in STOPPED."""
        if self.state is NmtState.STOPPED or len(data) != 8:
            self.ignored_frames += 1
            return
        self._now_ns = now_ns
        server, answer_id = self._sdo[cob_id]
        answer = server.answer(data)
        if answer is not None:
            self._emit(now_ns, Frame(answer_id, answer))

    def on_rpdo(self, layout: PdoLayout, data: bytes, now_ns: int) -> None:
        """Take an RPDO; a synchronous one acts at the next SYNC, an event-driven one at once.

        Bytes beyond the mapped ones are left aside; one that is too short has no effect but EMCY 0x8210.
        """
        if len(data) < layout.size:
            self.ignored_frames += 1
            self._begin_error(ErrorCode.PDO_LENGTH, now_ns)
            return
        if self._errors:
            self._end_error(ErrorCode.PDO_LENGTH, now_ns)
        if layout.transmission_type in SYNCHRONOUS_TYPES:
            self._received[layout.number] = data
        else:
            self._apply(layout, data)

    def apply_outputs(self) -> None:
        """SYNC: what was received since the last one acts now."""
        if self._received:
            for layout in self.rpdos:
                data = self._received.pop(layout.number, None)
                if data is not None:
                    self._apply(layout, data)

    def tpdos_due(self) -> list[PdoLayout]:
        """SYNC: the TPDOs to be sent once their inputs are converted."""
        due = []
        for layout in self.tpdos:
            if layout.transmission_type <= 1:
                due.append(layout)
                continue
            left = self._syncs_until_due[layout.number] - 1
            if left == 0:
                due.append(layout)
                left = layout.transmission_type
            self._syncs_until_due[layout.number] = left
        return due

    def send_tpdo(self, layout: PdoLayout, now_ns: int) -> None:
        """Send one TPDO, if it is still in force; one of type 0 only when its data differ from what it last sent."""
        if layout not in self.tpdos:
            return
        data = layout.pack(*[getter() for getter in self._getters[layout.number]])
        if layout.transmission_type == 0:
            if self._last_sent.get(layout.number) == data:
                return
            self._last_sent[layout.number] = data
        self._emit(now_ns, Frame(layout.cob_id, data))

    def on_heartbeat(self, node_id: int, now_ns: int) -> None:
        """A heartbeat of another node: monitoring begins with the first one (CiA 301, 7.5.2.19)."""
        entry = self._store.number(CONSUMER_HEARTBEAT, 1)
        timeout_ms = entry & 0xFFFF
        if entry >> 16 & 0xFF != node_id or not timeout_ms:
            return
        self._watch_due_ns = now_ns + timeout_ms * MILLISECOND
        self._schedule()
        self._end_error(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, now_ns)

    def run_timers(self, now_ns: int) -> None:
        """Do what has fallen due by `now_ns`: produce a heartbeat, notice that one is missing."""
        if self._heartbeat_due_ns <= now_ns:
            self._emit(self._heartbeat_due_ns, heartbeat_frame(self.node_id, self.state))
            self._heartbeat_due_ns += self._store.number(PRODUCER_HEARTBEAT) * MILLISECOND
        if self._watch_due_ns <= now_ns:
            at, self._watch_due_ns = self._watch_due_ns, NEVER
            self._heartbeat_lost(at)
        self._schedule()

    def _heartbeat_lost(self, now_ns: int) -> None:
        self._begin_error(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, now_ns)
        self.device.take_error_values(self._store.number)
        behaviour = self._store.number(ERROR_BEHAVIOUR, 1)
        if behaviour == 0 and self.state is NmtState.OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._leave_operational(NmtState.STOPPED)

    def _begin_error(self, code: ErrorCode, now_ns: int) -> None:
        """Report an error once, when it begins (CiA 301, 7.2.7)."""
        if code in self._errors:
            return
        self._errors.append(code)
        count = min(self._store.number(ERROR_HISTORY) + 1, HISTORY_LENGTH)
        for position in range(count, 1, -1):
            self._store.put(ERROR_HISTORY, position, self._store.number(ERROR_HISTORY, position - 1))
        self._store.put(ERROR_HISTORY, 1, code)
        self._store.put(ERROR_HISTORY, 0, count)
        self._report(code, now_ns)

    def _end_error(self, code: ErrorCode, now_ns: int) -> None:
        """Report that an error is over; the register still shows the others."""
        if code in self._errors:
            self._errors.remove(code)
            self._report(ErrorCode.NO_ERROR, now_ns)

    def _report(self, code: ErrorCode, now_ns: int) -> None:
        register = GENERIC_ERROR | COMMUNICATION_ERROR if self._errors else 0
        self._store.put(ERROR_REGISTER, 0, register)
        self._emit(now_ns, Emergency(code, register).frame(self.node_id))

    def _apply(self, layout: PdoLayout, data: bytes) -> None:
        for setter, value in zip(self._setters[layout.number], layout.unpack(data[: layout.size]), strict=True):
            setter(value)

    def _activate_pdos(self) -> None:
        dictionary, number = self._store.dictionary, self._store.number
        self.rpdos = read_layouts(dictionary, "rpdo", number)
        self.tpdos = read_layouts(dictionary, "tpdo", number)
        self._setters = {layout.number: [self._setter(m) for m in layout.objects] for layout in self.rpdos}
        self._getters = {layout.number: [self._getter(m) for m in layout.objects] for layout in self.tpdos}
        self._scanned = {(m.index, m.subindex) for layout in self.tpdos for m in layout.objects}
        self._syncs_until_due = {layout.number: layout.transmission_type for layout in self.tpdos}

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

    def _leave_operational(self, state: NmtState) -> None:
        self.state = state
        self._deactivate_pdos()

    def _schedule(self) -> None:
        self.next_due_ns = min(self._heartbeat_due_ns, self._watch_due_ns)

    def _read_object(self, index: int, subindex: int) -> bytes | None:
        if index == CLOCK_MODE:
            return bytes((self._clock_mode,))
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
        if index < APPLICATION_OBJECTS:
            self._configure(index, subindex, int.from_bytes(data, "little"))
        return False

    def _configure(self, index: int, subindex: int, value: int) -> None:
        """A client is about to write a communication object: refuse what cannot be, act on what acts at once."""
        is_operational = self.state is NmtState.OPERATIONAL
        check_pdo_write(self._store, self._can_map, is_operational, index, subindex, value)
        if index == PRODUCER_HEARTBEAT:
            self._heartbeat_due_ns = self._now_ns + value * MILLISECOND if value else NEVER
            self._schedule()
        elif index == CONSUMER_HEARTBEAT:
            self._watch_due_ns = NEVER
            self._schedule()
        elif index == ERROR_HISTORY:
            if value:
                raise SdoRefused(AbortCode.INVALID_VALUE)
            for position in range(1, HISTORY_LENGTH + 1):
                self._store.put(ERROR_HISTORY, position, 0)
        elif index == SYNC_OVERFLOW:
            if self._store.number(CYCLE_PERIOD):
                raise SdoRefused(AbortCode.DEVICE_STATE)
            if value == 1:
                raise SdoRefused(AbortCode.INVALID_VALUE)
