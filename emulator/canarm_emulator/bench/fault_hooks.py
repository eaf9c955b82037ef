"""What faults have changed about the nodes, messages and time of a bench; without faults all of it is empty.

State only: the bench reads it; `card_handle.py` and the points of `faults/` write it.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from canarm_protocol.canopen.frames import Frame

from ..node.slave import Slave
from ..timing import NEVER

SyncFilter = Callable[[int], bool]
SendFilter = Callable[[Frame], Frame | None]
CycleLength = Callable[[int, int], int]
"""Takes the nominal cycle and the time of a SYNC, and returns the time until the next one; all in ns."""


class Faults(Protocol):
    """What acts on the bench from outside as time goes on."""

    def update(self, now_ns: int, cycle: int) -> None:
        """Time has come to `now_ns`; `cycle` is the number of the cycle that begins now, -1 before the first."""
        ...


class MessageGate(Protocol):
    """Passes on frames of one direction, or holds them back for a while."""

    @property
    def due_ns(self) -> int:
        """When `release` has something to do."""
        ...

    def take(self, time_ns: int, frame: Frame, origin: object) -> None:
        """A frame comes from `origin`."""
        ...

    def release(self, until_ns: int) -> None:
        """Pass on what is due by `until_ns`."""
        ...


class SecondCard(NamedTuple):
    """Bus name of a second card with the same node-ID as another; `number` tells several apart."""

    node_id: int
    number: int


@dataclass(slots=True)
class CardTrouble:
    """What one fault has done to a card."""

    is_halted: bool = False
    is_deaf: bool = False
    sync_filter: SyncFilter | None = None
    send_filter: SendFilter | None = None
    timer_scale: float = 1.0
    refuses_sdo: bool = False

    @property
    def is_any(self) -> bool:
        """Whether it has done anything."""
        filters = (self.sync_filter, self.send_filter)
        return self.is_halted or self.is_deaf or self.refuses_sdo or self.timer_scale != 1.0 or filters != (None, None)


@dataclass(slots=True)
class FaultHooks:
    """The changes; those of cards are kept by node-ID."""

    towards_cards: MessageGate | None = None
    from_cards: MessageGate | None = None
    halted: set[int] = field(default_factory=set)
    """Cards whose timers stand still."""
    cards: dict[int, list[CardTrouble]] = field(default_factory=dict)
    """What each fault of a card has done to it, in the order in which they began."""
    doubles: dict[Hashable, Slave] = field(default_factory=dict)
    """Second cards by their names on the bus."""
    cycle_length: CycleLength | None = None

    @property
    def due_ns(self) -> int:
        """When the next frame that is held back goes on."""
        points = (self.towards_cards, self.from_cards)
        return min((point.due_ns for point in points if point is not None), default=NEVER)

    def release(self, until_ns: int) -> None:
        """Let frames go on."""
        for point in (self.towards_cards, self.from_cards):
            if point is not None:
                point.release(until_ns)

    def sees_sync(self, slave: Slave, now_ns: int) -> bool:
        """Whether the card's faults let it see a SYNC. Every fault is asked, because they count SYNCs."""
        if slave.bus_name not in self.cards:
            return True
        filters = [each.sync_filter for each in self.cards[slave.node_id]]
        answers = [passes(now_ns) for passes in filters if passes is not None]
        return all(answers)

    def sent(self, node_id: int, frame: Frame) -> Frame | None:
        """The frame that goes out when the card sends `frame`, after all faults in turn; None if it is lost."""
        passed: Frame | None = frame
        for each in self.cards.get(node_id, ()):
            if passed is not None and each.send_filter is not None:
                passed = each.send_filter(passed)
        return passed
