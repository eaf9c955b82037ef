"""Faults on messages: frames that are held back, changed or forged, in one direction of the robot's bus."""

import heapq
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand, parse_nmt
from canarm_protocol.errors import FrameError

from ..timing import NEVER
from .declaration import Context, Fault, MessageFault, Tap
from .points import Point

if TYPE_CHECKING:
    from ..bench.bench import Bench

TOWARDS_CARDS = "can0.rx"


class Intruder(NamedTuple):
    """Sender of the frames that a fault forges: the tap where it acts, and its number there."""

    tap: str
    number: int


class _Passing(NamedTuple):
    """A frame on its way, and the sets whose faults have held it back."""

    time_ns: int
    frame: Frame
    holders: frozenset[str] = frozenset()


class _Held(NamedTuple):
    """A frame that waits; `number` keeps frames of the same time in order."""

    time_ns: int
    number: int
    frame: Frame
    origin: object
    holders: frozenset[str]
    run: int
    """The run in which it waits, or that it waits for; as the bench counts them."""
    is_of_run: bool
    """Whether that run was on."""


class MessagePoint(Point):
    """One direction of the bus. The bench hands over every frame but SYNC and TIME; frames held back wait here.

    A frame passes the faults that act when it is sent, in the order in which they began; a frame that is held back
    does not meet later ones. It still arrives if its fault ends by itself, but not if the fault is cleared, or its run
    is over or followed by another. In lockstep no frame is held back while no SYNC drives a run: time stands still, and
    it would never arrive.
    """

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._bench, self._tap = bench, tap.name
        self._is_towards_cards = tap.name == TOWARDS_CARDS
        self._faults: list[tuple[MessageFault, str]] = []
        """Faults, each with the name of its set."""
        self._sources: list[tuple[MessageFault, Intruder]] = []
        """Faults that forge frames."""
        self._ask_ns = NEVER
        """When those are asked for more frames."""
        self._held: list[_Held] = []
        self._run_on: int | None = None
        """The run that was on when a frame last came here."""
        self._announced = 0
        """The run that an NMT start, perhaps held back itself, will begin: frames sent after it belong to that run."""
        self._senders: dict[int, object] = {}
        """Sender of each identifier: a fault may release the frame of another sender than that of the present one."""
        self._count, self._intruders = itertools.count(), itertools.count()

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, MessageFault)
        self._faults.append((fault, context.set_name))
        if type(fault).due is not MessageFault.due:
            self._sources.append((fault, Intruder(self._tap, next(self._intruders))))
            self._ask_ns = context.now_ns
        self._install(self)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Frames that a fault has held back still arrive; those that it has forged do not."""
        assert isinstance(fault, MessageFault)
        self._look_for_end_of_run(now_ns)
        holders = frozenset(name for each, name in self._faults if each is fault)
        self._faults = [each for each in self._faults if each[0] is not fault]  # equal ones are not the same
        for time_ns, frame in fault.rest(now_ns):
            self._hold(_Passing(max(time_ns, now_ns), frame, holders), self._senders.get(frame.can_id))
        for _, intruder in [each for each in self._sources if each[0] is fault]:
            self._held = [each for each in self._held if each.origin is not intruder]
            heapq.heapify(self._held)
            self._bench.bus.expel(intruder)
        self._sources = [each for each in self._sources if each[0] is not fault]
        if not self._sources:
            self._ask_ns = NEVER
        self._leave_if_done()

    def drop(self, set_name: str | None = None) -> None:
        """Drop the frames that faults of this set have held back, or all."""
        self._held = [each for each in self._held if set_name is not None and set_name not in each.holders]
        heapq.heapify(self._held)
        self._leave_if_done()

    @property
    def due_ns(self) -> int:
        """When `release` has something to do."""
        return min(self._held[0].time_ns, self._ask_ns) if self._held else self._ask_ns

    def take(self, time_ns: int, frame: Frame, origin: object) -> None:
        """Take a frame from `origin`: it goes on at once, later, changed, several times or never."""
        self._look_for_end_of_run(time_ns)
        time_passes = self._bench.bus.time_passes
        self._senders[frame.can_id] = origin
        passing = [_Passing(time_ns, frame)]
        for fault, set_name in self._faults:
            passing = [gone_on for each in passing for gone_on in _passed(each, fault, set_name)]
        for each in passing:
            sender = self._senders.get(each.frame.can_id, origin)
            if each.time_ns <= time_ns or not time_passes:
                self._let_go(time_ns, each.frame, sender)
            else:
                self._hold(each, sender)
        if _is_start(frame) and not self._bench.is_operational:
            self._announced = self._bench.run + 1

    def release(self, until_ns: int) -> None:
        """Pass on what is due by `until_ns`."""
        while self.due_ns <= until_ns:
            if self._ask_ns <= self.due_ns:
                self._ask(self._ask_ns)
            else:
                held = heapq.heappop(self._held)
                if self._may_come(held):
                    self._let_go(held.time_ns, held.frame, held.origin)
        self._leave_if_done()

    def _ask(self, now_ns: int) -> None:
        self._ask_ns = now_ns + self._bench.cell.bus.cycle_ns
        for fault, intruder in self._sources:
            for time_ns, frame in fault.due(self._ask_ns):
                self._hold(_Passing(max(time_ns, now_ns), frame), intruder)

    def _leave_if_done(self) -> None:
        if not self._faults and not self._held:
            self._senders.clear()
            self._install(None)

    def _install(self, point: "MessagePoint | None") -> None:
        if self._is_towards_cards:
            self._bench.hooks.towards_cards = point
        else:
            self._bench.hooks.from_cards = point

    def _hold(self, passing: _Passing, origin: object) -> None:
        run, is_of_run = max(self._bench.run, self._announced), self._bench.is_operational
        time_ns, frame, holders = passing
        heapq.heappush(self._held, _Held(time_ns, next(self._count), frame, origin, holders, run, is_of_run))

    def _look_for_end_of_run(self, now_ns: int) -> None:
        """Discard what faults themselves hold from a run that is over."""
        run_on = self._bench.run if self._bench.is_operational else None
        if self._run_on not in (None, run_on):
            for fault, _ in self._faults:
                fault.rest(now_ns)
        self._run_on = run_on

    def _may_come(self, held: _Held) -> bool:
        """Whether its run is not over."""
        if isinstance(held.origin, Intruder):
            return True
        return held.run >= self._bench.run and (self._bench.is_operational or not held.is_of_run)

    def _let_go(self, time_ns: int, frame: Frame, origin: object) -> None:
        if isinstance(origin, Intruder):
            self._bench.bus.intrude(time_ns, frame, origin)
        elif self._is_towards_cards:
            self._bench.bus.take_in(time_ns, frame, origin)
        else:
            self._bench.bus.put_out(time_ns, frame, origin)


def _passed(passing: _Passing, fault: MessageFault, set_name: str) -> Iterator[_Passing]:
    """The frames that result when a frame passes the fault."""
    for time_ns, frame in fault.pass_on(passing.frame, passing.time_ns):
        is_held = time_ns > passing.time_ns
        yield _Passing(time_ns, frame, passing.holders | {set_name} if is_held else passing.holders)


def _is_start(frame: Frame) -> bool:
    """Whether it is an NMT command to start, to any node."""
    if frame.can_id != Cob.NMT or frame.is_extended or frame.is_remote:
        return False
    try:
        return parse_nmt(frame.data)[0] is NmtCommand.START
    except FrameError:
        return False
