"""Node guarding and life guarding of one node (CiA 301, 7.2.8.3.2.1), for masters that send no heartbeat.

What follows from the loss of the master is up to the node.
"""

from canarm_protocol.canopen.dictionary import GUARD_TIME, LIFE_TIME_FACTOR, PRODUCER_HEARTBEAT
from canarm_protocol.canopen.frames import NmtState

from ..timing import MILLISECOND, NEVER
from .store import ObjectStore

_TOGGLE = 0x80


class LifeGuard:
    """Answers the master's remote frames, and notices when they stop: after 0x100C ms times 0x100D; 0 for never.

    A node that produces heartbeats does neither.
    """

    def __init__(self, store: ObjectStore) -> None:
        self.due_ns = NEVER
        """When the master is lost."""
        self.is_lost = False
        self._store = store
        self._toggle = 0

    def reset(self) -> None:
        """The node has booted: the toggle bit begins at 0, and monitoring with the first remote frame."""
        self._toggle = 0
        self.restart()

    def restart(self) -> None:
        """Monitoring begins again with the next remote frame."""
        self.is_lost, self.due_ns = False, NEVER

    def asked(self, state: NmtState, now_ns: int, scale: float = 1.0) -> bytes | None:
        """The answer to the master's remote frame; none from a node with a heartbeat. `scale` is as for heartbeats."""
        if self._store.number(PRODUCER_HEARTBEAT):
            return None
        answer = bytes((self._toggle | state,))
        self._toggle ^= _TOGGLE
        self.is_lost = False
        time_ms = self._store.optional(GUARD_TIME) * self._store.optional(LIFE_TIME_FACTOR)
        self.due_ns = now_ns + round(time_ms * MILLISECOND * scale) if time_ms else NEVER
        return answer

    def run(self, now_ns: int) -> None:
        """The master is lost if its time is over by `now_ns`; monitoring begins again with its next remote frame."""
        if self.due_ns <= now_ns:
            self.is_lost, self.due_ns = True, NEVER
