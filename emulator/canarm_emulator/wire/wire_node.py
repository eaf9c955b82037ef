"""The CAN controller of one node: error counters, queue of frames to send, and counts of their fate."""

from bisect import insort
from collections.abc import Hashable
from enum import Enum
from operator import attrgetter
from typing import NamedTuple

from canarm_protocol.canopen.frames import Frame

from .confinement import RECESSIVE_SEQUENCE_BITS, RECOVERY_SEQUENCES, Counters, ErrorState

LONGEST_QUEUE = 256
"""Most frames that a CAN controller and its driver queue; further ones are lost. SocketCAN's default is 10."""

_OFFERED, _KEY = attrgetter("offered_ns"), attrgetter("key")


class Queueing(Enum):
    """Which waiting frame a CAN controller sends first: the oldest, or the one with the lowest identifier."""

    FIFO = "fifo"
    PRIORITY = "priority"


class Waiting(NamedTuple):
    """A frame in a queue: when it came, its arbitration key, its length from SOF to end of frame."""

    offered_ns: int
    key: int
    frame: Frame
    bits: int


class WireNode(Counters):
    """One node's CAN controller. Only `Wire` changes it."""

    __slots__ = (
        "discarded",
        "errors",
        "is_connected",
        "lost_arbitrations",
        "name",
        "queue",
        "queueing",
        "ready_ns",
        "recessive_sequences",
        "recovering_from_ns",
        "sent",
    )

    def __init__(self, name: Hashable, queueing: Queueing) -> None:
        super().__init__()
        self.name, self.queueing = name, queueing
        self.is_connected = True
        """Whether its line to the bus is whole."""
        self.queue: list[Waiting] = []
        """Frames to send, by the time at which they came."""
        self.ready_ns = 0
        """When suspend transmission ends."""
        self.recovering_from_ns: int | None = None
        """Since when a node in bus-off has waited for recessive bits; None if it does not."""
        self.recessive_sequences = 0
        self.sent = 0
        self.errors = 0
        """Own transmissions that ended in an error."""
        self.lost_arbitrations = 0
        self.discarded = 0
        """Frames discarded in bus-off or because the queue was full."""

    @property
    def is_on_bus(self) -> bool:
        """Whether it hears and acknowledges."""
        return self.is_connected and self.state is not ErrorState.BUS_OFF

    def put(self, waiting: Waiting) -> None:
        """Queue a frame behind those that came no later."""
        queue = self.queue
        if not queue or queue[-1].offered_ns <= waiting.offered_ns:
            queue.append(waiting)
        else:
            insort(queue, waiting, key=_OFFERED)

    def put_back(self, waiting: Waiting) -> None:
        """Queue a frame that was not sent, in front of those that came with it."""
        self.queue.insert(sum(each.offered_ns < waiting.offered_ns for each in self.queue), waiting)

    def candidate(self, now_ns: int) -> Waiting | None:
        """The frame that the CAN controller would send at `now_ns`."""
        first = self.queue[0]
        if first.offered_ns > now_ns or self.ready_ns > now_ns:
            return None
        if self.queueing is Queueing.FIFO:
            return first
        return min((each for each in self.queue if each.offered_ns <= now_ns), key=_KEY)

    def recovered_ns(self, recessive_from_ns: int, bit_ns: int) -> int:
        """When a recovering node is back, if the bus stays recessive from `recessive_from_ns` on."""
        assert self.recovering_from_ns is not None
        missing = RECOVERY_SEQUENCES - self.recessive_sequences
        return max(recessive_from_ns, self.recovering_from_ns) + missing * RECESSIVE_SEQUENCE_BITS * bit_ns

    def count_sequences(self, recessive_from_ns: int, until_ns: int, bit_ns: int) -> None:
        """A run of recessive bits ends: a recovering node counts its sequences of 11."""
        assert self.recovering_from_ns is not None
        seen_ns = until_ns - max(recessive_from_ns, self.recovering_from_ns)
        self.recessive_sequences += max(0, seen_ns) // (RECESSIVE_SEQUENCE_BITS * bit_ns)
