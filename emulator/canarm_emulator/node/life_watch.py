"""Whose silence a node notices: nodes that send heartbeats, and a master that guards it by remote frames.

What the node does about it is its own business.
"""

from canarm_protocol.canopen.dictionary import CONSUMER_HEARTBEAT, GUARD_TIME, LIFE_TIME_FACTOR
from canarm_protocol.canopen.frames import ErrorCode, NmtState

from .emergency import EmergencyProducer
from .guarding import LifeGuard
from .heartbeats import HeartbeatConsumer
from .store import ObjectStore


class LifeWatch:
    """Heartbeat consumer and life guard of one node; EMCY 0x8130 for as long as anybody is lost."""

    def __init__(self, store: ObjectStore, emergency: EmergencyProducer) -> None:
        self._emergency = emergency
        self._consumer, self._guard = HeartbeatConsumer(store), LifeGuard(store)

    @property
    def due_ns(self) -> int:
        """When the next one is lost."""
        heartbeat_ns, guard_ns = self._consumer.due_ns, self._guard.due_ns
        return heartbeat_ns if heartbeat_ns < guard_ns else guard_ns

    @property
    def node_ids(self) -> list[int]:
        """The nodes whose heartbeats are monitored (0x1016)."""
        return self._consumer.node_ids

    def reset(self) -> None:
        """The node boots: nobody is waited for."""
        self._consumer.reset()
        self._guard.reset()

    def restart(self) -> None:
        """Go on after a standstill: monitoring begins again with the next heartbeat or question."""
        self._consumer.reset()
        self._guard.restart()

    def heard(self, node_id: int, now_ns: int, scale: float) -> bool:
        """A heartbeat came; returns whether its node is monitored. `scale` multiplies the time until the next."""
        if not self._consumer.heard(node_id, now_ns, scale):
            return False
        if self._emergency.present:
            self.end_error(now_ns)
        return True

    def asked(self, state: NmtState, now_ns: int, scale: float) -> bytes | None:
        """The answer to a master's remote frame; None from a node that produces heartbeats. Then call `end_error`."""
        return self._guard.asked(state, now_ns, scale)

    def rewrite(self, index: int, subindex: int, value: int, now_ns: int) -> bool:
        """An object is about to be written; whether it is one of those here. Raises `SdoRefused`."""
        if index == CONSUMER_HEARTBEAT:
            self._consumer.rewrite(subindex, value)
        elif index in (GUARD_TIME, LIFE_TIME_FACTOR):
            self._guard.restart()
        else:
            return False
        self.end_error(now_ns)
        return True

    def run(self, now_ns: int) -> bool:
        """Whether anybody is lost by `now_ns`."""
        if self.due_ns > now_ns:
            return False
        self._emergency.begin(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, self.due_ns)
        self._consumer.run(now_ns)
        self._guard.run(now_ns)
        return True

    def end_error(self, now_ns: int) -> None:
        """Report, where nobody is lost any more, that the error is over."""
        if not self._consumer.is_any_lost and not self._guard.is_lost:
            self._emergency.end(ErrorCode.LIFE_GUARD_OR_HEARTBEAT, now_ns)
