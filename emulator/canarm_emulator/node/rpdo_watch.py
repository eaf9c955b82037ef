"""What can be wrong with the RPDOs of one node: too short, later than their event timer allows, or refused.

From its first frame on, an RPDO with an event timer is due in time (CiA 301, 7.5.2.35, sub-index 05h).
"""

from collections.abc import Collection, Sequence

from canarm_protocol.canopen.frames import ErrorCode
from canarm_protocol.canopen.pdo import COMMUNICATION, DISABLED, PdoLayout

from ..timing import MILLISECOND, NEVER
from .emergency import EmergencyProducer
from .event_pdos import EVENT_TIMER
from .store import ObjectStore


class RpdoWatch:
    """The RPDOs of one node, by their numbers; what is wrong with them is reported by EMCY."""

    def __init__(self, store: ObjectStore, emergency: EmergencyProducer) -> None:
        self.due_ns = NEVER
        """When the next deadline is missed."""
        self.is_timed = False
        """Whether any RPDO is due in time."""
        self._store, self._emergency = store, emergency
        self._timers_ns: dict[int, int] = {}
        self._due_ns: dict[int, int] = {}
        self._missed: set[int] = set()
        """RPDOs that missed their deadline and have not come since."""
        self._too_short: set[int] = set()

    def activate(self, rpdos: Sequence[PdoLayout]) -> None:
        """Monitor those of `rpdos` whose event timer is not 0; each waits for its first frame."""
        timers_ms = {p.number: self._store.optional(COMMUNICATION["rpdo"] + p.number - 1, EVENT_TIMER) for p in rpdos}
        self._timers_ns = {number: time_ms * MILLISECOND for number, time_ms in timers_ms.items() if time_ms}
        self.is_timed = bool(self._timers_ns)
        self.restart()

    def reset(self) -> None:
        """Nothing is monitored, and nothing is wrong."""
        self.activate(())
        self._missed.clear()
        self._too_short.clear()

    def restart(self) -> None:
        """Each RPDO waits for its first frame again."""
        self._due_ns, self.due_ns = {}, NEVER

    def too_short(self, number: int, now_ns: int) -> None:
        """An RPDO came with fewer bytes than it maps: EMCY 0x8210."""
        self._too_short.add(number)
        self._emergency.begin(ErrorCode.PDO_LENGTH, now_ns)

    def refused(self, numbers: Collection[int], now_ns: int) -> None:
        """The outputs have been told what to do; these RPDOs ask for what they never do: EMCY 0xFF00."""
        if numbers:
            self._emergency.begin(ErrorCode.OUTPUT_REFUSED, now_ns)
        else:
            self._emergency.end(ErrorCode.OUTPUT_REFUSED, now_ns)

    def received(self, number: int, now_ns: int) -> bool:
        """A valid RPDO came; returns whether any due time may have changed."""
        timer_ns = self._timers_ns.get(number)
        if timer_ns is not None:
            self._missed.discard(number)
            self._due_ns[number] = now_ns + timer_ns
            self.due_ns = min(self._due_ns.values())
        if not self._emergency.present:
            return timer_ns is not None
        self._too_short.discard(number)
        self._end_errors(now_ns)
        return True

    def rewrite(self, number: int, subindex: int, value: int, now_ns: int) -> None:
        """A communication parameter is about to be written: an RPDO that is disabled or untimed has no errors."""
        is_disabled = subindex == 1 and value & DISABLED
        if is_disabled:
            self._too_short.discard(number)
        if is_disabled or (subindex == EVENT_TIMER and not value):
            self._missed.discard(number)
        self._end_errors(now_ns)

    def run(self, now_ns: int) -> None:
        """Deadlines up to `now_ns` are missed (EMCY 0x8250): their RPDOs wait for a first frame again."""
        if self.due_ns > now_ns:
            return
        self._emergency.begin(ErrorCode.RPDO_TIMEOUT, self.due_ns)
        self._missed |= {number for number, due_ns in self._due_ns.items() if due_ns <= now_ns}
        self._due_ns = {number: due_ns for number, due_ns in self._due_ns.items() if due_ns > now_ns}
        self.due_ns = min(self._due_ns.values(), default=NEVER)

    def _end_errors(self, now_ns: int) -> None:
        if not self._missed:
            self._emergency.end(ErrorCode.RPDO_TIMEOUT, now_ns)
        if not self._too_short:
            self._emergency.end(ErrorCode.PDO_LENGTH, now_ns)
