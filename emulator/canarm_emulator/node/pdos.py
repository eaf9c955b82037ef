"""The process data of one node (CiA 301, 7.5.2.35 to 7.5.2.38): active PDOs, what they carry, and when.

Owns what a SYNC, a remote frame and a received PDO do to the card's inputs and outputs. `pdo_rules` checks writes to
their parameters; NMT states, EMCY and time-outs belong to the node.
"""

from collections.abc import Callable, Sequence
from typing import Any

from canarm_protocol.canopen.dictionary import ERROR_REGISTER, SYNC_OVERFLOW, SYNC_WINDOW
from canarm_protocol.canopen.frames import Frame, data_frame
from canarm_protocol.canopen.pdo import COMMUNICATION, Kind, MappedObject, PdoLayout, read_layouts
from canarm_protocol.errors import DictionaryError

from ..timing import MICROSECOND, NEVER
from .analogue_events import AnalogueEvents
from .event_pdos import EventPdos
from .io_device import Getter, IoDevice, Refusal, Setter
from .pdo_rules import (
    EVENT_DRIVEN_TYPES,
    NO_REMOTE,
    ON_REQUEST,
    SYNCHRONOUS_ON_REQUEST,
    SYNCHRONOUS_TYPES,
)
from .store import ObjectStore

_UP_TO_DATE_TYPES = (ON_REQUEST, *EVENT_DRIVEN_TYPES)
"""What they carry on a remote frame is what is there now."""
SYNC_START_VALUE = 6
"""Sub-index of a TPDO's communication parameter."""


class Pdos:
    """PDOs of the node `name`, active between `activate` and `clear`, and sent by `emit`."""

    def __init__(
        self,
        name: str,
        store: ObjectStore,
        device: IoDevice,
        inputs: AnalogueEvents | None,
        emit: Callable[[int, Frame], None],
    ) -> None:
        self.rpdos: list[PdoLayout] = []
        self.tpdos: list[PdoLayout] = []
        self.events = EventPdos(store, device, inputs, self.send)
        """When those of types 254 and 255 are sent."""
        self.sync_length = 0
        """Bytes in a SYNC: 1 with a counter (0x1019)."""
        self.window_ns = 0
        """The synchronous window (0x1007); 0 is none."""
        self._name, self._store, self._device, self._emit = name, store, device, emit
        self.refused: set[int] = set()
        """The RPDOs whose last values ask for what the device never does."""
        self._scanned: set[tuple[int, int]] = set()
        self._setters: dict[int, list[Setter]] = {}
        self._refusals: dict[int, list[tuple[int, Refusal]]] = {}
        """Indices of an RPDO's values that can be refused."""
        self._getters: dict[int, list[Getter]] = {}
        self._received: dict[int, bytes] = {}
        self._last_sent: dict[int, bytes] = {}
        self._syncs_until_due: dict[int, int] = {}
        self._first_syncs: dict[int, int] = {}
        self._is_every_sync = False
        """Whether every SYNC asks for all TPDOs."""
        self._last_sync_ns = NEVER
        self._sync_overflow = 0

    def reset(self) -> None:
        """Take what concerns SYNC from the objects."""
        self.take_sync_overflow(self._store.optional(SYNC_OVERFLOW))
        self.window_ns = self._store.optional(SYNC_WINDOW) * MICROSECOND

    def take_sync_overflow(self, value: int) -> None:
        """0x1019 is `value` from now on."""
        self._sync_overflow, self.sync_length = value, 1 if value else 0

    def activate(self, now_ns: int) -> None:
        """Activate the configured PDOs, except those that map nothing."""
        dictionary, number, optional = self._store.dictionary, self._store.number, self._store.optional
        self.rpdos = [layout for layout in read_layouts(dictionary, "rpdo", number) if layout.objects]
        self.tpdos = [layout for layout in read_layouts(dictionary, "tpdo", number) if layout.objects]
        self._setters = {layout.number: [self._setter(m) for m in layout.objects] for layout in self.rpdos}
        self._getters = {layout.number: [self._getter(m) for m in layout.objects] for layout in self.tpdos}
        self._refusals = {layout.number: found for layout in self.rpdos if (found := self._refusals_of(layout))}
        self._scanned = {(m.index, m.subindex) for layout in self.tpdos for m in layout.objects}
        self._syncs_until_due = {layout.number: layout.transmission_type for layout in self.tpdos}
        starts = {p.number: optional(COMMUNICATION["tpdo"] + p.number - 1, SYNC_START_VALUE) for p in self.tpdos}
        self._first_syncs = {n: start for n, start in starts.items() if start and self.sync_length}
        always = (0, 1, SYNCHRONOUS_ON_REQUEST)
        self._is_every_sync = not self._first_syncs and all(each.transmission_type in always for each in self.tpdos)
        self.events.activate(self.tpdos, now_ns)

    def clear(self) -> None:
        """No PDO is in force any more."""
        self.rpdos, self.tpdos = [], []
        self._scanned.clear()
        self._received.clear()
        self._last_sent.clear()
        self.refused.clear()
        self.events.clear()
        self._last_sync_ns = NEVER

    def is_scanned(self, index: int, subindex: int) -> bool:
        """Whether an active TPDO carries the object, so that its value is from the last scan."""
        return (index, subindex) in self._scanned

    def can_map(self, kind: Kind, index: int, subindex: int) -> bool:
        """Whether the device can serve the object in a PDO of that kind."""
        if kind == "rpdo":
            return self._device.setter(index, subindex) is not None
        return index == ERROR_REGISTER or self._device.getter(index, subindex) is not None

    def take(self, layout: PdoLayout, data: bytes, now_ns: int) -> bool:
        """Take an RPDO; a synchronous one acts at the next SYNC, an event-driven one at once.

        False for a synchronous one after the synchronous window, which has no effect.
        """
        if layout.transmission_type in SYNCHRONOUS_TYPES:
            if self.window_ns and now_ns - self._last_sync_ns > self.window_ns:
                return False
            self._received[layout.number] = data
        else:
            self._apply(layout, data)
        return True

    def on_sync(self, data: bytes, now_ns: int) -> list[PdoLayout]:
        """SYNC: outputs act; returns the TPDOs to be sent once their inputs are converted.

        A counter that is not within 1 and 0x1019 acts as none.
        """
        self._last_sync_ns = now_ns
        if self._received:
            self.apply_outputs()
        if self._is_every_sync:
            return self.tpdos
        return self.due(data[0] if data and data[0] <= self._sync_overflow else 0)

    def apply_outputs(self) -> None:
        """What was received since the last SYNC acts now."""
        for layout in self.rpdos:
            data = self._received.pop(layout.number, None)
            if data is not None:
                self._apply(layout, data)

    def due(self, counter: int = 0) -> list[PdoLayout]:
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

    def send(self, layout: PdoLayout, now_ns: int) -> None:
        """Send one TPDO, if it is still active.

        One of type 0 is sent only if its data differ from the last ones; one of type 252 waits for a remote frame. A
        synchronous one that is late for the synchronous window is left out.
        """
        if layout not in self.tpdos:
            return
        transmission_type = layout.transmission_type
        if self.window_ns and now_ns - self._last_sync_ns > self.window_ns and transmission_type < ON_REQUEST:
            return
        data = self._pack(layout)
        if transmission_type == 0:
            if self._last_sent.get(layout.number) == data:
                return
            self._last_sent[layout.number] = data
        elif transmission_type == SYNCHRONOUS_ON_REQUEST:
            self._last_sent[layout.number] = data
            return
        self._emit(now_ns, data_frame(layout.cob_id, data))

    def on_remote(self, cob_id: int, now_ns: int) -> bool:
        """A remote frame: a TPDO of that COB-ID is sent, unless bit 30 forbids it. Returns whether there is one.

        Synchronous ones carry what was sampled at the last SYNC, the others what is there now.
        """
        for layout in self.tpdos:
            if layout.cob_id == cob_id:
                if self._store.number(COMMUNICATION["tpdo"] + layout.number - 1, 1) & NO_REMOTE:
                    return False
                if layout.transmission_type in _UP_TO_DATE_TYPES:
                    self.events.refresh(layout)
                data = self._pack(layout)
                if layout.transmission_type == SYNCHRONOUS_ON_REQUEST:
                    data = self._last_sent.get(layout.number, data)
                self._emit(now_ns, Frame(cob_id, data))
                return True
        return False

    def _pack(self, layout: PdoLayout) -> bytes:
        return layout.pack(*[getter() for getter in self._getters[layout.number]])

    def _apply(self, layout: PdoLayout, data: bytes) -> None:
        if len(data) != layout.size:
            data = data[: layout.size]
        values = layout.unpack(data)
        if layout.number in self._refusals:
            self._look_for_refused(layout.number, values)
        for setter, value in zip(self._setters[layout.number], values, strict=True):
            setter(value)

    def _look_for_refused(self, number: int, values: Sequence[Any]) -> None:
        for place, is_refused in self._refusals[number]:
            if is_refused(values[place]):
                self.refused.add(number)
                return
        self.refused.discard(number)

    def _refusals_of(self, layout: PdoLayout) -> list[tuple[int, Refusal]]:
        found = ((place, self._device.refusal(m.index, m.subindex)) for place, m in enumerate(layout.objects))
        return [(place, refusal) for place, refusal in found if refusal is not None]

    def _setter(self, mapped: MappedObject) -> Setter:
        setter = self._device.setter(mapped.index, mapped.subindex)
        if setter is None:
            raise DictionaryError(
                f"{self._name}: an RPDO maps 0x{mapped.index:04X}:{mapped.subindex:02X}, no output of the card"
            )
        return setter

    def _getter(self, mapped: MappedObject) -> Getter:
        index, subindex = mapped.index, mapped.subindex
        return self._device.getter(index, subindex) or (lambda: self._store.number(index, subindex))
