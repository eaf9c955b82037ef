"""What the dashboard asks of the bench node: its faults now and then, and what the user wants done.

One conversation at a time, in the background and with a time limit; answers come out of `poll`, so the screen never
waits. Time is handed in. What is drawn is not known here.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError, FaultError
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.shown import named_error

from .fault_catalogue import FaultKind, Tap, catalogue_of, injection
from .faults import Faults, FaultSignal, faults_of
from .link import InBackground, Link

LOOK_NS = 2_000_000_000
"""Sets that wait are in no telemetry, so faults are asked for this often, as long as the bench sends telemetry."""
CHANGE_NS = 500_000_000
"""After a change in the telemetry: so much later than the last time, at the earliest."""
RETRY_NS = 5_000_000_000
"""After a question that the bench did not answer."""
LIMIT_S = 3.0
"""For one answer of the bench."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Refusal:
    """What was asked was not done: the reason, as the bench or the bus gave it."""

    reason: str


class FaultDesk:
    """Conversations with the bench node of `cell` over `link`. Callbacks are called by `poll`, with the answer."""

    def __init__(self, cell: Cell, link: Link, in_background: InBackground) -> None:
        self.faults: Faults | None = None
        """None as long as nothing is known."""
        self.refusal: Refusal | None = None
        """Why the faults could not be asked for the last time."""
        self._cell, self._link, self._in_background = cell, link, in_background
        self._catalogue: tuple[Tap, ...] | None = None
        self._waiting: deque[tuple[Callable[[], None], Callable[[], None]]] = deque()
        self._then: Callable[[], None] | None = None
        self._is_done = False
        self._is_looking = False
        self._seen: FaultSignal | None = None
        self._events_of: FaultSignal | None = None
        self._due_ns = self._soonest_ns = 0

    def poll(self, signal: FaultSignal | None, now_ns: int) -> None:
        """Hand out an answer if there is one, and ask what is due. `signal` is the telemetry, None while there is
        none.
        """
        if self._then is not None and self._is_done:
            then, self._then = self._then, None
            then()
        if signal is not None and not self._is_looking:
            has_changed = signal != self._seen and now_ns >= self._soonest_ns
            if has_changed or now_ns >= self._due_ns:
                self._look(signal, now_ns)
        if self._then is None and self._waiting:
            job, self._then = self._waiting.popleft()
            self._is_done = False
            self._in_background(job)

    def reconnected(self) -> None:
        """It may be another bench."""
        self._catalogue = self._seen = self._events_of = self.faults = None
        self._due_ns = self._soonest_ns = 0

    def load_catalogue(self, then: Callable[[tuple[Tap, ...] | Refusal], None]) -> None:
        """What can be injected; asked for once in a connection."""

        def keep(answer: tuple[Tap, ...] | Refusal) -> None:
            if not isinstance(answer, Refusal):
                self._catalogue = answer
            then(answer)

        if self._catalogue is not None:
            then(self._catalogue)
        else:
            self._ask(lambda client: catalogue_of(client.catalogue()), keep)

    def inject(
        self, tap: str, fault: FaultKind, typed: dict[str, str], duration: str, then: Callable[[str | Refusal], None]
    ) -> None:
        """Inject one fault with what was typed for its parameters and the duration."""

        def job(client: BenchClient) -> str:
            names = {each["set"] for each in client.status()["sets"]}
            return client.inject(injection(tap, fault, typed, duration, names))

        self._do(job, then)

    def clear(self, name: str | None, then: Callable[[str | Refusal], None]) -> None:
        """End and forget the sets of that name, or all."""
        self._do(lambda client: client.clear(name), then)

    def stop(self, is_on: bool, then: Callable[[str | Refusal], None]) -> None:
        """Emergency stop: open the supply of all amplifiers, or close it again."""

        def job(client: BenchClient) -> str:
            client.emergency_stop(is_on)
            return "emergency stop: the supply of all amplifiers is " + ("open" if is_on else "closed again")

        self._do(job, then)

    def _look(self, signal: FaultSignal, now_ns: int) -> None:
        # Events are many; without a change in the telemetry there are no new ones.
        known = self.faults if signal == self._events_of else None
        self._seen, self._is_looking = signal, True
        self._due_ns, self._soonest_ns = now_ns + LOOK_NS, now_ns + CHANGE_NS

        def job(client: BenchClient) -> Faults:
            found = client.status()
            if known is not None and len(known.acting) == len(found["active"]):
                return replace(faults_of(found, ()), acting=known.acting, events=known.events)
            return faults_of(found, client.events() if found["begun"] else ())

        def take(answer: Faults | Refusal) -> None:
            self._is_looking = False
            if isinstance(answer, Refusal):
                self.refusal, self._due_ns, self._soonest_ns = answer, now_ns + RETRY_NS, now_ns + RETRY_NS
            else:
                self.refusal, self.faults, self._events_of = None, answer, signal

        self._ask(job, take)

    def _do(self, job: Callable[[BenchClient], str], then: Callable[[str | Refusal], None]) -> None:
        def and_look(answer: str | Refusal) -> None:
            self._due_ns = 0
            then(answer)

        self._ask(job, and_look, is_urgent=True)

    def _ask(
        self, job: Callable[[BenchClient], T], then: Callable[[T | Refusal], None], is_urgent: bool = False
    ) -> None:
        answer: list[T | Refusal] = []

        def run() -> None:
            try:
                with self._link.lend() as port, BenchClient(port, self._cell, LIMIT_S) as client:
                    answer.append(job(client))
            except (BusError, FaultError) as error:
                answer.append(Refusal(str(error)))
            # In a thread of its own an unforeseen error would vanish, and the question stay open for ever.
            except Exception as error:
                answer.append(Refusal(f"{self._link.where}: {named_error(error)}"))
            self._is_done = True

        question = run, lambda: then(answer[0])
        if is_urgent:
            self._waiting.appendleft(question)
        else:
            self._waiting.append(question)
