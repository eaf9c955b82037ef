"""EMCY of one node (CiA 301, 7.2.7): its present errors, objects 0x1001 and 0x1003, messages sent or held back.

The node decides what an error is, and what else follows from it.
"""

from collections import deque
from collections.abc import Callable

from canarm_protocol.canopen.dictionary import EMERGENCY_COB_ID, EMERGENCY_INHIBIT_TIME, ERROR_HISTORY, ERROR_REGISTER
from canarm_protocol.canopen.frames import Cob, Emergency, ErrorCode, Frame
from canarm_protocol.canopen.pdo import COB_ID_MASK, DISABLED

from ..timing import INHIBIT_UNIT, NEVER
from ..wire.confinement import ErrorState
from .store import ObjectStore

GENERIC_ERROR, COMMUNICATION_ERROR, MANUFACTURER_ERROR = 0x01, 0x10, 0x80
"""Bits of the error register (CiA 301, 7.5.2.2)."""
DEVICE_SPECIFIC = 0xFF00
"""The first of the error codes that a device gives a meaning."""
HISTORY_LENGTH = 4
LONGEST_QUEUE = 16
"""Most messages that wait for the inhibit time to end; register and history show the others."""


class EmergencyProducer:
    """The errors of node `node_id`. `may_send` says whether its NMT state permits EMCY."""

    def __init__(
        self, store: ObjectStore, node_id: int, emit: Callable[[int, Frame], None], may_send: Callable[[], bool]
    ) -> None:
        self.present: list[ErrorCode] = []
        """Errors that have begun and not ended."""
        self.due_ns = NEVER
        """When `run` has something to send."""
        self._store, self._node_id, self._emit, self._may_send = store, node_id, emit, may_send
        self._told: list[ErrorCode] = []
        """Errors present at the last message."""
        self._waiting: deque[Emergency] = deque()
        self._free_ns = -NEVER
        self._was_bus_off = False

    def reset(self) -> None:
        """Forget everything, as a reset of the node does."""
        self.present.clear()
        self._told.clear()
        self._waiting.clear()
        self._free_ns, self.due_ns = -NEVER, NEVER
        self._was_bus_off = False

    def begin(self, code: ErrorCode, now_ns: int) -> None:
        """Report an error once, when it begins."""
        if code in self.present:
            return
        self.present.append(code)
        store = self._store
        count = min(store.number(ERROR_HISTORY) + 1, HISTORY_LENGTH)
        for position in range(count, 1, -1):
            store.put(ERROR_HISTORY, position, store.number(ERROR_HISTORY, position - 1))
        store.put(ERROR_HISTORY, 1, code)
        store.put(ERROR_HISTORY, 0, count)
        self._report(code, now_ns)

    def end(self, code: ErrorCode, now_ns: int) -> None:
        """Report that an error is over; the register still shows the others."""
        if code in self.present:
            self.present.remove(code)
            self._report(ErrorCode.NO_ERROR, now_ns)

    def on_error_state(self, state: ErrorState, now_ns: int) -> None:
        """The node's CAN controller has changed its error state.

        EMCY 0x8120 while it is error-passive; after bus-off 0x8140, followed by "no error".
        """
        if state is ErrorState.PASSIVE:
            self.begin(ErrorCode.ERROR_PASSIVE, now_ns)
        elif state is ErrorState.BUS_OFF:
            self._was_bus_off = True
        else:
            if self._was_bus_off:
                self._was_bus_off = False
                self.begin(ErrorCode.RECOVERED_FROM_BUS_OFF, now_ns)
            self.end(ErrorCode.ERROR_PASSIVE, now_ns)
            self.end(ErrorCode.RECOVERED_FROM_BUS_OFF, now_ns)

    def tell_held_back(self, now_ns: int) -> None:
        """The NMT state permits EMCY again: report the latest error that has begun meanwhile, or that one is over.

        CiA 301, 7.3.2.2.4, asks for this after STOPPED.
        """
        begun = [code for code in self.present if code not in self._told]
        if begun:
            self._report(begun[-1], now_ns)
        elif self.present != self._told:
            self._report(ErrorCode.NO_ERROR, now_ns)

    def clear_history(self) -> None:
        """0 is written to 0x1003:0."""
        for position in range(1, HISTORY_LENGTH + 1):
            self._store.put(ERROR_HISTORY, position, 0)

    def postpone(self, now_ns: int) -> None:
        """Send at `now_ns` what should have been sent before."""
        if self._waiting:
            self.due_ns = max(self.due_ns, now_ns)

    def run(self, now_ns: int) -> None:
        """Send what has waited for the inhibit time to end."""
        if self.due_ns <= now_ns:
            due_ns, self.due_ns = self.due_ns, NEVER
            self._send(self._waiting.popleft(), due_ns)
            if self._waiting:
                self.due_ns = max(self._free_ns, due_ns)

    def _report(self, code: ErrorCode, now_ns: int) -> None:
        register = GENERIC_ERROR if self.present else 0
        for each in self.present:
            register |= MANUFACTURER_ERROR if each >= DEVICE_SPECIFIC else COMMUNICATION_ERROR
        self._store.put(ERROR_REGISTER, 0, register)
        message = Emergency(code, register)
        if now_ns >= self._free_ns and not self._waiting:
            self._send(message, now_ns)
        elif len(self._waiting) < LONGEST_QUEUE:
            self._waiting.append(message)
            self.due_ns = self._free_ns

    def _send(self, message: Emergency, now_ns: int) -> None:
        if not self._may_send():
            return
        self._told = list(self.present)
        cob_id = self._store.optional(EMERGENCY_COB_ID, 0, Cob.EMERGENCY + self._node_id)
        if cob_id & DISABLED:
            return
        self._emit(now_ns, Frame(cob_id & COB_ID_MASK, message.frame(self._node_id).data))
        self._free_ns = now_ns + self._store.optional(EMERGENCY_INHIBIT_TIME) * INHIBIT_UNIT
