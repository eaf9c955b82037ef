"""A CANopen slave in virtual time (CiA 301): NMT states, SDO server, synchronous PDOs, heartbeat both ways, EMCY.

Frames and times go in through methods; frames come out through `emit`. Nothing here waits, and what is answered is answered
at once. The SDO server is the `canopen` library's; the rest is ours, because the library's local node has no time.
"""

import logging
import struct
from collections.abc import Callable
from types import SimpleNamespace

from canarm_protocol.dictionary import (
    CLOCK_MODE,
    CONSUMER_HEARTBEAT,
    ERROR_BEHAVIOUR,
    ERROR_REGISTER,
    PRODUCER_HEARTBEAT,
    Dictionary,
)
from canarm_protocol.errors import DictionaryError
from canarm_protocol.frames import Cob, Emergency, ErrorCode, Frame, NmtCommand, NmtState, heartbeat_frame
from canarm_protocol.pdo import COMMUNICATION, DISABLED, MAPPING, PDO_COUNT, Kind, PdoLayout, read_layout, read_layouts
from canopen import SdoAbortedError
from canopen.sdo import SdoServer

from .device import Getter, IoDevice, Setter
from .store import ObjectStore

logging.getLogger("canopen").setLevel(logging.CRITICAL)

Emit = Callable[[int, Frame], None]

NEVER = 1 << 62
MILLISECOND = 1_000_000
SDO_SERVER, SDO_SERVERS = 0x1200, 0x80
APPLICATION_OBJECTS = 0x2000
ERROR_HISTORY = 0x1003
GENERIC_ERROR, COMMUNICATION_ERROR = 0x01, 0x10
WRONG_STATE, WRONG_VALUE, NOT_MAPPABLE = 0x0800_0022, 0x0609_0030, 0x0604_0041
SYNCHRONOUS_TYPES = range(241)
EVENT_DRIVEN_TYPES = (254, 255)


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
            dictionary[index][1].default: SdoServer(dictionary[index][1].default, dictionary[index][2].default, self._store)
            for index in range(SDO_SERVER, SDO_SERVER + SDO_SERVERS)
            if index in dictionary
        }
        for server in self._sdo.values():
            server.network = SimpleNamespace(send_message=self._send_sdo)
        self._reset_sdo()
        self._setters: dict[int, list[Setter]] = {}
        self._getters: dict[int, list[Getter]] = {}
        self._received: dict[int, bytes] = {}
        self._syncs_until_due: dict[int, int] = {}
        self._last_sent: dict[int, bytes] = {}
        self._heartbeat_due_ns = NEVER
        self._watch_due_ns = NEVER
        self._watch_lost = False

    def boot(self, now_ns: int, everything: bool = True) -> None:
        """Reset: communication objects, and with `everything` the application's too, take their defaults; then boot-up."""
        self._store.reset(keep=lambda index: not everything and not 0x1000 <= index < 0x2000)
        self._reset_sdo()
        self._deactivate_pdos()
        self.device.take_error_values(self._store.number)
        self._heartbeat_due_ns = self._watch_due_ns = NEVER
        self._watch_lost = False
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
        """The node whose heartbeat is monitored (0x1016:1); 0 for none."""
        return self._store.number(CONSUMER_HEARTBEAT, 1) >> 16 & 0x7F

    def on_sdo(self, cob_id: int, data: bytes, now_ns: int) -> None:
        """Serve one SDO request that came on `cob_id`; answered at `now_ns`, not answered in STOPPED."""
        if self.state is NmtState.STOPPED or len(data) != 8:
            self.ignored_frames += 1
            return
        self._now_ns = now_ns
        self._sdo[cob_id].on_request(cob_id, bytearray(data), now_ns)

    def on_rpdo(self, layout: PdoLayout, data: bytes) -> None:
        """Take an RPDO; a synchronous one acts at the next SYNC, an event-driven one at once."""
        if self.state is not NmtState.OPERATIONAL or len(data) < layout.size:
            self.ignored_frames += 1
        elif layout.transmission_type in SYNCHRONOUS_TYPES:
            self._received[layout.cob_id] = data
        else:
            self._apply(layout, data)

    def apply_outputs(self) -> None:
        """SYNC: what was received since the last one acts now."""
        if self._received:
            for layout in self.rpdos:
                data = self._received.pop(layout.cob_id, None)
                if data is not None:
                    self._apply(layout, data)

    def tpdos_due(self) -> list[PdoLayout]:
        """SYNC: the TPDOs to be sent once their inputs are converted."""
        if self.state is not NmtState.OPERATIONAL:
            return []
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
        """Send one TPDO; one of type 0 only when its data differ from what it last sent."""
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
        if entry >> 16 & 0x7F != node_id or not timeout_ms:
            return
        self._watch_due_ns = now_ns + timeout_ms * MILLISECOND
        self._schedule()
        if self._watch_lost:
            self._watch_lost = False
            self._report(Emergency(ErrorCode.NO_ERROR, 0), now_ns)

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
        self._watch_lost = True
        self._report(Emergency(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, GENERIC_ERROR | COMMUNICATION_ERROR), now_ns)
        self.device.take_error_values(self._store.number)
        behaviour = self._store.number(ERROR_BEHAVIOUR, 1)
        if behaviour == 0 and self.state is NmtState.OPERATIONAL:
            self._leave_operational(NmtState.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._leave_operational(NmtState.STOPPED)

    def _report(self, emergency: Emergency, now_ns: int) -> None:
        self._store.put(ERROR_REGISTER, 0, emergency.register)
        if emergency.code:
            count = min(self._store.number(ERROR_HISTORY, 0) + 1, 4)
            for position in range(count, 1, -1):
                self._store.put(ERROR_HISTORY, position, self._store.number(ERROR_HISTORY, position - 1))
            self._store.put(ERROR_HISTORY, 1, emergency.code)
            self._store.put(ERROR_HISTORY, 0, count)
        self._emit(now_ns, emergency.frame(self.node_id))

    def _apply(self, layout: PdoLayout, data: bytes) -> None:
        for setter, value in zip(self._setters[layout.number], layout.unpack(data[: layout.size]), strict=True):
            setter(value)

    def _activate_pdos(self) -> None:
        dictionary, number = self._store.object_dictionary, self._store.number
        self.rpdos = read_layouts(dictionary, "rpdo", number)
        self.tpdos = read_layouts(dictionary, "tpdo", number)
        self._setters = {
            layout.number: [_present(self.device.setter(m.index, m.subindex)) for m in layout.objects]
            for layout in self.rpdos
        }
        self._getters = {
            layout.number: [_present(self.device.getter(m.index, m.subindex)) for m in layout.objects]
            for layout in self.tpdos
        }
        self._syncs_until_due = {layout.number: layout.transmission_type for layout in self.tpdos}

    def _deactivate_pdos(self) -> None:
        self.rpdos, self.tpdos = [], []
        self._received.clear()
        self._last_sent.clear()

    def _leave_operational(self, state: NmtState) -> None:
        self.state = state
        self._deactivate_pdos()

    def _schedule(self) -> None:
        self.next_due_ns = min(self._heartbeat_due_ns, self._watch_due_ns)

    def _reset_sdo(self) -> None:
        for server in self._sdo.values():
            server._index = server._subindex = 0
            server._buffer = bytearray()

    def _send_sdo(self, cob_id: int, data: bytes) -> None:
        self._emit(self._now_ns, Frame(cob_id, bytes(data)))

    def _read_object(self, index: int, subindex: int) -> bytes | None:
        if index == CLOCK_MODE:
            return bytes((self._clock_mode,))
        if index >= APPLICATION_OBJECTS:
            if self.state is not NmtState.OPERATIONAL:
                self.device.refresh(index, subindex)
            getter = self.device.getter(index, subindex)
            if getter is not None:
                variable = self._store.object_dictionary.get_variable(index, subindex)
                return bytes(variable.encode_raw(getter()))
        return None

    def _write_object(self, index: int, subindex: int, data: bytes) -> bool:
        setter = self.device.setter(index, subindex) if index >= APPLICATION_OBJECTS else None
        if setter is not None:
            variable = self._store.object_dictionary.get_variable(index, subindex)
            setter(variable.decode_raw(data))
            return True
        for kind in ("rpdo", "tpdo"):
            self._check_pdo_write(kind, index, subindex, data)
        if index == PRODUCER_HEARTBEAT:
            (period_ms,) = struct.unpack("<H", data)
            self._heartbeat_due_ns = self._now_ns + period_ms * MILLISECOND if period_ms else NEVER
            self._schedule()
        elif index == CONSUMER_HEARTBEAT:
            self._watch_due_ns = NEVER
            self._schedule()
        elif index == ERROR_BEHAVIOUR and data[0] > 2:
            raise SdoAbortedError(WRONG_VALUE)
        return False

    def _check_pdo_write(self, kind: Kind, index: int, subindex: int, data: bytes) -> None:
        """PDOs are changed in PRE-OPERATIONAL only, and their mapping only while they are disabled (CiA 301, 7.5.2.36)."""
        communication, mapping = index - COMMUNICATION[kind], index - MAPPING[kind]
        if not (0 <= communication < PDO_COUNT or 0 <= mapping < PDO_COUNT):
            return
        if self.state is NmtState.OPERATIONAL:
            raise SdoAbortedError(WRONG_STATE)
        value = int.from_bytes(data, "little")
        if 0 <= communication < PDO_COUNT:
            if subindex == 2 and not (value in SYNCHRONOUS_TYPES or kind == "rpdo" and value in EVENT_DRIVEN_TYPES):
                raise SdoAbortedError(WRONG_VALUE)
            return
        cob_id_index = COMMUNICATION[kind] + mapping
        if not self._store.number(cob_id_index, 1) & DISABLED:
            raise SdoAbortedError(WRONG_STATE)
        if subindex == 0 and value:
            self._check_mapping(kind, mapping, value)

    def _check_mapping(self, kind: Kind, offset: int, count: int) -> None:
        def read(index: int, subindex: int) -> int:
            return count if (index, subindex) == (MAPPING[kind] + offset, 0) else self._store.number(index, subindex)

        try:
            read_layout(self._store.object_dictionary, kind, offset + 1, read)
        except DictionaryError:
            raise SdoAbortedError(NOT_MAPPABLE) from None


def _present(accessor: Callable[..., object] | None) -> Callable[..., object]:
    if accessor is None:
        raise DictionaryError("a PDO maps an object that the card does not have")
    return accessor
