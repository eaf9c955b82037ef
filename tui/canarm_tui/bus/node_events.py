"""What happens to the nodes of the robot's bus, as notices: EMCY with its meaning, NMT commands, boot-ups, states.

Listens to a watch of the bus; nothing is sent.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Frame, NmtCommand, NmtState
from canarm_protocol.decoding import Book, Meaning
from canarm_protocol.decoding.services import emergency, nmt, state_name

from ..notices import Kind, Notice, Notices
from .cycle_count import CycleCount

_NMT, _SYNC, _HEARTBEAT = int(Cob.NMT), int(Cob.SYNC), int(Cob.HEARTBEAT)
_EMERGENCY, _LAST_EMERGENCY = int(Cob.EMERGENCY), Cob.EMERGENCY + HIGHEST_NODE_ID
_START = int(NmtCommand.START)
_RESETS, _ENDS = (
    (int(NmtCommand.RESET_NODE), int(NmtCommand.RESET_COMMUNICATION)),
    (int(NmtCommand.STOP), int(NmtCommand.PRE_OPERATIONAL)),
)
"""With a reset after the end of a run the next one is brought up; in the middle of a run it is an event of that."""
_TOGGLE = 0x7F
"""Without bit 7, which toggles in an answer of node guarding."""


class NodeEvents:
    """A listener of a bus. `near` is about the present cycle as telemetry has it, None if it is not known."""

    def __init__(self, book: Book, near: Callable[[], int | None]) -> None:
        self.notices = Notices()
        self._book, self._near = book, near
        self._count = CycleCount()
        self._states: dict[int, int] = {}
        self._is_over = False

    def forget(self) -> None:
        """What comes from now on begins anew."""
        self.notices.clear()
        self._count.forget()
        self._states.clear()

    def receive(self, frames: Sequence[tuple[int, Frame]]) -> None:
        """Take frames of the bus."""
        self._count.anchor(self._near())
        for time_ns, frame in frames:
            can_id = frame[0]
            if _LAST_EMERGENCY < can_id <= _HEARTBEAT or frame[2] or frame[3]:
                continue  # PDOs and SDO, which is most
            if can_id == _SYNC:
                self._count.sync(frame[1])
            elif can_id == _NMT:
                self._command(time_ns, frame[1])
            elif _EMERGENCY < can_id <= _LAST_EMERGENCY:
                self._say(time_ns, Kind.EMERGENCY, emergency(frame[1], self._book.name(can_id - _EMERGENCY)))
            elif _HEARTBEAT < can_id <= _HEARTBEAT + HIGHEST_NODE_ID and len(frame[1]) == 1:
                self._state(time_ns, can_id - _HEARTBEAT, frame[1][0] & _TOGGLE)

    def _command(self, time_ns: int, data: bytes) -> None:
        cycle, command = self._count.cycle, data[0] if data else None
        is_begin = command == _START or (command in _RESETS and self._is_over)
        if is_begin and cycle != -1:  # each card is started by its own
            self._count.start()
            if cycle is not None:
                self.notices.begin_run()
        self._is_over = command in _ENDS or (self._is_over and not is_begin)
        self._say(time_ns, Kind.NMT, nmt(data, self._book.name))

    def _state(self, time_ns: int, node_id: int, state: int) -> None:
        before, self._states[node_id] = self._states.get(node_id), state
        name = self._book.name(node_id)
        if state == NmtState.BOOT_UP:
            is_in_a_run = self._count.cycle is not None and self._count.cycle >= 0
            self._add(time_ns, Kind.NODE, f"{name} has booted", is_in_a_run)
        elif before not in (None, state):
            known = state_name(NmtState(state)) if state in list(NmtState) else f"in the unknown state {state}"
            self._add(time_ns, Kind.NODE, f"{name} is {known}", state == NmtState.STOPPED)

    def _say(self, time_ns: int, kind: Kind, meaning: Meaning) -> None:
        self._add(time_ns, kind, f"{meaning.title}: {meaning.said}", meaning.is_wrong)

    def _add(self, time_ns: int, kind: Kind, what: str, is_wrong: bool) -> None:
        cycle = self._count.cycle
        if cycle is None:
            cycle = self._near() or -1  # telemetry has cycle 0 before it, too
        self.notices.add(Notice(time_ns, cycle, kind, what, is_wrong))
