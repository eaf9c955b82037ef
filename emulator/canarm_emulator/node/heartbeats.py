"""Heartbeats of one node: those that it produces (0x1017), and those that it monitors (0x1016, CiA 301, 7.5.2.19).

What follows from a lost heartbeat is up to the node.
"""

from collections.abc import Callable

from canarm_protocol.canopen.dictionary import CONSUMER_HEARTBEAT
from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Frame, NmtState, heartbeat_frame
from canarm_protocol.canopen.sdo import AbortCode

from ..timing import MILLISECOND, NEVER
from .store import ObjectStore, SdoRefused

NODE_IDS = range(1, HIGHEST_NODE_ID + 1)


class HeartbeatProducer:
    """Sends the heartbeats of node `node_id`. `scale` multiplies the producer time wherever it is given."""

    def __init__(self, node_id: int, emit: Callable[[int, Frame], None]) -> None:
        self.due_ns = NEVER
        """When the next one is sent."""
        self._node_id, self._emit = node_id, emit
        self._state = NmtState.BOOT_UP
        self._frame = heartbeat_frame(node_id, self._state)
        self._period_ns = 0

    def begin(self, time_ms: int, now_ns: int, scale: float) -> None:
        """The producer time is `time_ms` from now on; 0 for no heartbeats."""
        self._period_ns = time_ms * MILLISECOND
        self.due_ns = now_ns + _scaled(self._period_ns, scale) if time_ms else NEVER

    def stop(self) -> None:
        """Send none until `begin`."""
        self.due_ns = NEVER

    def restart(self, now_ns: int) -> None:
        """Go on after a standstill, with one at once."""
        if self.due_ns != NEVER:
            self.due_ns = now_ns

    def run(self, now_ns: int, state: NmtState, scale: float) -> None:
        """Send the one that has fallen due by `now_ns`."""
        due_ns = self.due_ns
        if due_ns <= now_ns:
            if state is not self._state:
                self._state, self._frame = state, heartbeat_frame(self._node_id, state)
            self._emit(due_ns, self._frame)
            self.due_ns += _scaled(self._period_ns, scale)


class HeartbeatConsumer:
    """The entries of 0x1016, one per node. An entry without a time or a valid node-ID is not used."""

    def __init__(self, store: ObjectStore) -> None:
        self.due_ns = NEVER
        """When the next heartbeat is lost."""
        self._store = store
        self._times_ns: dict[int, int] | None = None
        """Consumer times by node-ID; None when they have to be read again."""
        self._due_ns: dict[int, int] = {}
        self._lost: set[int] = set()

    def reset(self) -> None:
        """The objects have their defaults: nobody is monitored yet, and nobody is lost."""
        self._times_ns = None
        self._due_ns.clear()
        self._lost.clear()
        self.due_ns = NEVER

    @property
    def node_ids(self) -> list[int]:
        """The nodes that are monitored."""
        return list(self._times())

    @property
    def is_any_lost(self) -> bool:
        """Whether a monitored node was lost and has not come back."""
        return bool(self._lost)

    def rewrite(self, subindex: int, value: int) -> None:
        """An entry is about to be written: its monitoring begins again. Raises `SdoRefused` for a duplicate node."""
        node_id, time_ns = _entry(value)
        others = [entry for entry in self._subindices() if entry != subindex]
        if time_ns and node_id in NODE_IDS and any(self._read(entry) == node_id for entry in others):
            raise SdoRefused(AbortCode.INCOMPATIBLE_PARAMETER)
        before = self._read(subindex)
        self._due_ns.pop(before, None)
        self._lost.discard(before)
        self.due_ns = min(self._due_ns.values(), default=NEVER)
        self._times_ns = None

    def heard(self, node_id: int, now_ns: int, scale: float = 1.0) -> bool:
        """A heartbeat came; returns whether its node is monitored. Monitoring begins with the first one.

        `scale` multiplies the time until the next one is due.
        """
        time_ns = self._times().get(node_id)
        if time_ns is None:
            return False
        self._lost.discard(node_id)
        times = self._due_ns
        times[node_id] = due_ns = now_ns + _scaled(time_ns, scale)
        self.due_ns = due_ns if len(times) == 1 else min(times.values())
        return True

    def run(self, now_ns: int) -> None:
        """Nodes whose time was over by `now_ns` are lost; each waits for a first heartbeat again."""
        self._lost |= {node_id for node_id, due_ns in self._due_ns.items() if due_ns <= now_ns}
        self._due_ns = {node_id: due_ns for node_id, due_ns in self._due_ns.items() if due_ns > now_ns}
        self.due_ns = min(self._due_ns.values(), default=NEVER)

    def _times(self) -> dict[int, int]:
        if self._times_ns is None:
            entries = [_entry(self._store.number(CONSUMER_HEARTBEAT, subindex)) for subindex in self._subindices()]
            self._times_ns = {node_id: time_ns for node_id, time_ns in entries if time_ns and node_id in NODE_IDS}
        return self._times_ns

    def _subindices(self) -> range:
        return range(1, self._store.number(CONSUMER_HEARTBEAT) + 1)

    def _read(self, subindex: int) -> int:
        """The node of an entry that is used, else 0."""
        node_id, time_ns = _entry(self._store.number(CONSUMER_HEARTBEAT, subindex))
        return node_id if time_ns else 0


def _entry(value: int) -> tuple[int, int]:
    """Node-ID and time in ns of an entry."""
    return value >> 16 & 0xFF, (value & 0xFFFF) * MILLISECOND


def _scaled(period_ns: int, scale: float) -> int:
    return period_ns if scale == 1.0 else round(period_ns * scale)
