"""Faults on messages: frames that are held back, changed, or come from nowhere, in one direction of the robot's bus."""

import heapq
import itertools
from typing import TYPE_CHECKING, NamedTuple

from canarm_protocol.frames import Frame

from ..timing import NEVER
from .declaration import Context, Fault, MessageFault, Tap
from .points import Point

if TYPE_CHECKING:
    from ..bench import Bench

TOWARDS_CARDS = "can0.rx"


class Intruder(NamedTuple):
    """Who sends the frames that a fault makes up."""

    number: int


class MessagePoint(Point):
    """One direction of the bus. The bench hands over every frame but SYNC and TIME; frames held back wait here."""

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._bench, self._is_towards_cards = bench, tap.name == TOWARDS_CARDS
        self._faults: list[MessageFault] = []
        self._held: list[tuple[int, int, Frame, object]] = []
        self._count = itertools.count()

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, MessageFault)
        self._faults.append(fault)
        self._bench.set_message_point(self._is_towards_cards, self)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Frames that a fault has held back still come."""
        assert isinstance(fault, MessageFault)
        for time_ns, frame in fault.rest(now_ns):
            self._hold(time_ns, frame, Intruder(len(self._faults)))
        self._faults.remove(fault)
        if not self._faults and not self._held:
            self._bench.set_message_point(self._is_towards_cards, None)

    def refresh(self, now_ns: int) -> None:
        """Frames that faults send by themselves in the coming cycle."""
        until_ns = now_ns + self._bench.cell.bus.cycle_ns
        for number, fault in enumerate(self._faults):
            for time_ns, frame in fault.due(until_ns):
                self._hold(time_ns, frame, Intruder(number))

    @property
    def due_ns(self) -> int:
        """When `release` has something to let go."""
        return self._held[0][0] if self._held else NEVER

    def take(self, time_ns: int, frame: Frame, origin: object) -> None:
        """A frame comes from `origin`: it goes on at once, later, changed, several times or never."""
        passing = [(time_ns, frame)]
        for fault in self._faults:
            passing = [gone_on for at_ns, each in passing for gone_on in fault.pass_on(each, at_ns)]
        for at_ns, each in passing:
            if at_ns <= time_ns:
                self._let_go(time_ns, each, origin)
            else:
                self._hold(at_ns, each, origin)

    def release(self, until_ns: int) -> None:
        """Let go what is due by `until_ns`."""
        while self._held and self._held[0][0] <= until_ns:
            time_ns, _, frame, origin = heapq.heappop(self._held)
            self._let_go(time_ns, frame, origin)
        if not self._faults and not self._held:
            self._bench.set_message_point(self._is_towards_cards, None)

    def _hold(self, time_ns: int, frame: Frame, origin: object) -> None:
        heapq.heappush(self._held, (time_ns, next(self._count), frame, origin))

    def _let_go(self, time_ns: int, frame: Frame, origin: object) -> None:
        if isinstance(origin, Intruder):
            self._bench.intrude(time_ns, frame, origin)
        elif self._is_towards_cards:
            self._bench.take_in(time_ns, frame, origin)
        else:
            self._bench.put_out(time_ns, frame, origin)
