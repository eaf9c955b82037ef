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
    """Who sends the frames that a fault makes up: the tap where it acts, and its number there."""

    tap: str
    number: int


class _Held(NamedTuple):
    """A frame that waits; `number` keeps those of one time in order."""

    time_ns: int
    number: int
    frame: Frame
    origin: object


class MessagePoint(Point):
    """One direction of the bus. The bench hands over every frame but SYNC and TIME; frames held back wait here.

    A frame passes the faults that are there when it is sent, in the order in which they began; one that is held back
    meets none that begins later.
    """

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._bench, self._tap = bench, tap.name
        self._is_towards_cards = tap.name == TOWARDS_CARDS
        self._faults: list[MessageFault] = []
        self._sources: list[tuple[MessageFault, Intruder]] = []
        """Faults that make frames up."""
        self._ask_ns = NEVER
        """When those are asked for more."""
        self._held: list[_Held] = []
        self._senders: dict[int, object] = {}
        """Whose each identifier is: a fault may let go the frame of another sender than that of the one that came."""
        self._count, self._intruders = itertools.count(), itertools.count()

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, MessageFault)
        self._faults.append(fault)
        if type(fault).due is not MessageFault.due:
            self._sources.append((fault, Intruder(self._tap, next(self._intruders))))
            self._ask_ns = context.now_ns
        self._install(self)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Frames that a fault has held back still come; those that it has made up do not."""
        assert isinstance(fault, MessageFault)
        self._faults = [each for each in self._faults if each is not fault]  # equal ones are not the same
        for time_ns, frame in fault.rest(now_ns):
            self._hold(max(time_ns, now_ns), frame, self._senders.get(frame.can_id))
        for _, intruder in [each for each in self._sources if each[0] is fault]:
            self._held = [each for each in self._held if each.origin is not intruder]
            heapq.heapify(self._held)
            self._bench.bus.expel(intruder)
        self._sources = [each for each in self._sources if each[0] is not fault]
        if not self._sources:
            self._ask_ns = NEVER
        self._leave_if_done()

    @property
    def due_ns(self) -> int:
        """When `release` has something to do."""
        return min(self._held[0].time_ns, self._ask_ns) if self._held else self._ask_ns

    def take(self, time_ns: int, frame: Frame, origin: object) -> None:
        """A frame comes from `origin`: it goes on at once, later, changed, several times or never."""
        self._senders[frame.can_id] = origin
        passing = [(time_ns, frame)]
        for fault in self._faults:
            passing = [gone_on for at_ns, each in passing for gone_on in fault.pass_on(each, at_ns)]
        for at_ns, each in passing:
            sender = self._senders.get(each.can_id, origin)
            if at_ns <= time_ns:
                self._let_go(time_ns, each, sender)
            else:
                self._hold(at_ns, each, sender)

    def release(self, until_ns: int) -> None:
        """Let go what is due by `until_ns`."""
        while self.due_ns <= until_ns:
            if self._ask_ns <= self.due_ns:
                self._ask(self._ask_ns)
            else:
                time_ns, _, frame, origin = heapq.heappop(self._held)
                self._let_go(time_ns, frame, origin)
        self._leave_if_done()

    def _ask(self, now_ns: int) -> None:
        self._ask_ns = now_ns + self._bench.cell.bus.cycle_ns
        for fault, intruder in self._sources:
            for time_ns, frame in fault.due(self._ask_ns):
                self._hold(max(time_ns, now_ns), frame, intruder)

    def _leave_if_done(self) -> None:
        if not self._faults and not self._held:
            self._senders.clear()
            self._install(None)

    def _install(self, point: "MessagePoint | None") -> None:
        if self._is_towards_cards:
            self._bench.hooks.towards_cards = point
        else:
            self._bench.hooks.from_cards = point

    def _hold(self, time_ns: int, frame: Frame, origin: object) -> None:
        heapq.heappush(self._held, _Held(time_ns, next(self._count), frame, origin))

    def _let_go(self, time_ns: int, frame: Frame, origin: object) -> None:
        if isinstance(origin, Intruder):
            self._bench.bus.intrude(time_ns, frame, origin)
        elif self._is_towards_cards:
            self._bench.bus.take_in(time_ns, frame, origin)
        else:
            self._bench.bus.put_out(time_ns, frame, origin)
