"""What faults have changed about the nodes, messages and time of a bench; on a sound bench all of it is empty.

State only: the bench asks it on its way, and the points of `faults/` write it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from canarm_protocol.frames import Frame

from .slave import Slave
from .timing import NEVER

if TYPE_CHECKING:
    from .faults.messages import MessagePoint

SyncFilter = Callable[[int], bool]
SendFilter = Callable[[Frame], Frame | None]
CycleLength = Callable[[int, int], int]
"""From the nominal cycle and the time of a SYNC to the time until the next one, ns."""


@dataclass(slots=True)
class FaultHooks:
    """By node-ID where it concerns nodes."""

    towards_cards: "MessagePoint | None" = None
    from_cards: "MessagePoint | None" = None
    halted: set[int] = field(default_factory=set)
    """Nodes whose timers stand still."""
    sync_filters: dict[int, SyncFilter] = field(default_factory=dict)
    send_filters: dict[int, SendFilter] = field(default_factory=dict)
    doubles: dict[int, Slave] = field(default_factory=dict)
    cycle_length: CycleLength | None = None

    @property
    def due_ns(self) -> int:
        """When a frame that was held back is to go on."""
        points = (self.towards_cards, self.from_cards)
        return min((point.due_ns for point in points if point is not None), default=NEVER)

    def release(self, until_ns: int) -> None:
        """Let frames go on."""
        for point in (self.towards_cards, self.from_cards):
            if point is not None:
                point.release(until_ns)

    def sees_sync(self, slave: Slave, now_ns: int) -> bool:
        """Whether the card's own fault lets it see a SYNC."""
        passes = self.sync_filters.get(slave.node_id)
        return passes is None or passes(now_ns)
