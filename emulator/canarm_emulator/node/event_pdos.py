"""Event-driven TPDOs of one node (CiA 301, types 254 and 255): events, event timer and inhibit time.

The node knows the data, and when it is in OPERATIONAL.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from canarm_protocol.canopen.dictionary import SCAN_PERIOD
from canarm_protocol.canopen.pdo import COMMUNICATION, PdoLayout

from ..timing import INHIBIT_UNIT, MILLISECOND, NEVER
from .analogue_events import AnalogueEvents
from .io_device import IoDevice
from .pdo_rules import EVENT_DRIVEN_TYPES
from .store import ObjectStore

INHIBIT_TIME, EVENT_TIMER = 3, 5
"""Sub-indices of a PDO's communication parameter (CiA 301, 7.5.2.37)."""


@dataclass(slots=True)
class _EventPdo:
    """A TPDO in force. `free_ns` is the end of its inhibit time."""

    layout: PdoLayout
    inhibit_ns: int
    timer_ns: int
    timer_due_ns: int
    free_ns: int = -NEVER
    is_pending: bool = False


class EventPdos:
    """Decides when event-driven TPDOs are sent, and scans the inputs for events.

    `send(layout, now_ns)` packs and sends. `inputs` finds events of analogue inputs; None if the card has none.
    """

    def __init__(
        self,
        store: ObjectStore,
        device: IoDevice,
        inputs: AnalogueEvents | None,
        send: Callable[[PdoLayout, int], None],
    ) -> None:
        self.due_ns = NEVER
        """When `run` has something to do."""
        self._store, self._device, self._inputs, self._send_pdo = store, device, inputs, send
        self._pdos: list[_EventPdo] = []
        self._watched: list[tuple[int, int]] = []
        self._scan_due_ns = NEVER

    def activate(self, tpdos: Sequence[PdoLayout], now_ns: int) -> None:
        """Take over those of `tpdos` that are event-driven; their timers start."""
        self._pdos = []
        for layout in tpdos:
            if layout.transmission_type in EVENT_DRIVEN_TYPES:
                communication = COMMUNICATION["tpdo"] + layout.number - 1
                timer_ns = self._store.optional(communication, EVENT_TIMER) * MILLISECOND
                inhibit_ns = self._store.optional(communication, INHIBIT_TIME) * INHIBIT_UNIT
                due_ns = now_ns + timer_ns if timer_ns else NEVER
                self._pdos.append(_EventPdo(layout, inhibit_ns, timer_ns, due_ns))
        inputs = self._inputs
        mapped = [(m.index, m.subindex) for pdo in self._pdos for m in pdo.layout.objects]
        self._watched = [key for key in dict.fromkeys(mapped) if inputs is not None and inputs.covers(key[0])]
        if inputs is not None:
            inputs.reset()
            self.enable(inputs.is_enabled, now_ns)
        self._schedule()

    def restart(self, now_ns: int) -> None:
        """Go on after a standstill: event timers and scans start again, and pending PDOs are sent."""
        for pdo in self._pdos:
            pdo.free_ns = max(pdo.free_ns, now_ns) if pdo.is_pending else pdo.free_ns
            pdo.timer_due_ns = now_ns + pdo.timer_ns if pdo.timer_due_ns != NEVER else NEVER
        if self._scan_due_ns != NEVER:
            self._scan_due_ns = max(self._scan_due_ns, now_ns)
        self._schedule()

    def enable(self, is_enabled: bool, now_ns: int) -> None:
        """0x6423 is being written: inputs are scanned for events from now on, or no longer."""
        self._scan_due_ns = now_ns if is_enabled and self._watched else NEVER
        self._schedule()

    def clear(self) -> None:
        """No PDO is in force any more."""
        self._pdos, self._watched = [], []
        self._scan_due_ns = self.due_ns = NEVER

    def refresh(self, layout: PdoLayout) -> None:
        """Convert the inputs that a PDO maps, now."""
        for mapped in layout.objects:
            self._device.refresh(mapped.index, mapped.subindex)

    def run(self, now_ns: int) -> None:
        """Do what has fallen due by `now_ns`."""
        if self._scan_due_ns <= now_ns:
            at_ns = self._scan_due_ns
            self._scan_due_ns += self._store.number(SCAN_PERIOD) * MILLISECOND
            self._scan(at_ns)
        for pdo in self._pdos:
            if pdo.timer_due_ns <= now_ns:
                self.refresh(pdo.layout)
                self._request(pdo, pdo.timer_due_ns)
            if pdo.is_pending and pdo.free_ns <= now_ns:
                self._send(pdo, pdo.free_ns)
        self._schedule()

    def _scan(self, now_ns: int) -> None:
        inputs = self._inputs
        assert inputs is not None
        events = set()
        for index, subindex in self._watched:
            self._device.refresh(index, subindex)
            if inputs.happens(index, subindex, self._value(index, subindex)):
                events.add((index, subindex))
        for pdo in self._pdos if events else ():
            if any((mapped.index, mapped.subindex) in events for mapped in pdo.layout.objects):
                self._request(pdo, now_ns)

    def _request(self, pdo: _EventPdo, now_ns: int) -> None:
        if now_ns >= pdo.free_ns:
            self._send(pdo, now_ns)
        else:
            pdo.is_pending, pdo.timer_due_ns = True, NEVER

    def _send(self, pdo: _EventPdo, now_ns: int) -> None:
        pdo.is_pending = False
        pdo.free_ns = now_ns + pdo.inhibit_ns
        pdo.timer_due_ns = now_ns + pdo.timer_ns if pdo.timer_ns else NEVER
        if self._inputs is not None:
            for mapped in pdo.layout.objects:
                if self._inputs.covers(mapped.index):
                    self._inputs.told(mapped.index, mapped.subindex, self._value(mapped.index, mapped.subindex))
        self._send_pdo(pdo.layout, now_ns)

    def _value(self, index: int, subindex: int) -> int:
        getter = self._device.getter(index, subindex)
        assert getter is not None
        return int(getter())

    def _schedule(self) -> None:
        due_ns = self._scan_due_ns
        for pdo in self._pdos:
            due_ns = min(due_ns, pdo.timer_due_ns, pdo.free_ns if pdo.is_pending else NEVER)
        self.due_ns = due_ns
