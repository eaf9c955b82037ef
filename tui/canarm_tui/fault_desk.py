"""The dashboard's requests to the bench node: its faults from time to time, and the user's requests.

One conversation at a time, in the background and with a time-out; `poll` delivers answers, so the screen never
waits. Time is passed in. What is drawn is not known here.
"""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import download
from canarm_protocol.cell.bench_objects import EMERGENCY_STOP, sdo_channel
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError, FaultError
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.faults.run_plan import RunPlan
from canarm_protocol.faults.wire_figures import WireFigures
from canarm_protocol.shown import named_error
from canarm_protocol.transport.port import BusPort

from .errors import NotConnectedError
from .fault_catalogue import FaultKind, Tap, catalogue_of, injection
from .faults import Faults, FaultSignal, faults_of
from .link import InBackground

LOOK_NS = 2_000_000_000
"""Telemetry has no waiting sets, so the faults are read this often while the bench sends telemetry."""
CHANGE_NS = 500_000_000
"""Least time between two reads after a change in the telemetry."""
RETRY_NS = 5_000_000_000
"""Time to the next read after one that the bench did not answer."""
LIMIT_S = 3.0
"""Time limit for one answer of the bench."""

NOT_SENT, NOT_CONFIRMED = "emergency stop NOT sent: {}", "emergency stop sent, and NOT confirmed: {}"

T = TypeVar("T")


class Lender(Protocol):
    """Who has a bus for conversations."""

    where: str

    def lend(self) -> AbstractContextManager[BusPort]:
        """The bus. Raises `BusError` without one."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send at once, whatever conversation goes on. Raises `BusError`."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """A refused request: the reason, as the bench or the bus gave it."""

    reason: str


class FaultDesk:
    """Conversations with the bench node of `cell` over `link`. `poll` calls the callbacks with the answers."""

    def __init__(self, cell: Cell, link: Lender, in_background: InBackground) -> None:
        self.faults: Faults | None = None
        """None until they have been read."""
        self.recording: tuple[bool, str] | None = None
        """Whether the bench records, and where, or why not; None until it has been read."""
        self.refusal: Refusal | None = None
        """Why the last read of the faults failed."""
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
        """Deliver an answer if there is one, and ask what is due. `signal` is the telemetry, None while there is
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
        """The bus was opened again: it may be another bench."""
        self._catalogue = self._seen = self._events_of = self.faults = self.recording = None
        self._due_ns = self._soonest_ns = 0

    def load_catalogue(self, then: Callable[[tuple[Tap, ...] | Refusal], None]) -> None:
        """Read what can be injected, once per connection."""

        def keep(answer: tuple[Tap, ...] | Refusal) -> None:
            if not isinstance(answer, Refusal):
                self._catalogue = answer
            then(answer)

        if self._catalogue is not None:
            then(self._catalogue)
        else:
            self._ask(lambda client: catalogue_of(client.catalogue()), keep)

    def load_wire(self, then: Callable[[WireFigures | Refusal], None]) -> None:
        """Read load, errors and clients of the buses."""
        self._ask(lambda client: client.wire_figures(self._cell), then)

    def inject(
        self,
        tap: str,
        fault: FaultKind,
        typed: dict[str, str],
        schedule: dict[str, str],
        then: Callable[[str | Refusal], None],
    ) -> None:
        """Inject one fault with the typed parameters, when the schedule says."""

        def job(client: BenchClient) -> str:
            found = client.status()
            names = {each["set"] for each in found["sets"]}
            now_s = (found["time_ns"] - found["begin_ns"]) * 1e-9 if found["running"] else None
            return client.inject(injection(tap, fault, typed, schedule, names, now_s))

        self._do(job, then)

    def trigger(self, name: str, then: Callable[[str | Refusal], None]) -> None:
        """Begin a set that waits."""
        self._do(lambda client: client.trigger(name), then)

    def clear(self, name: str | None, then: Callable[[str | Refusal], None]) -> None:
        """End and forget the sets of that name, or all."""
        self._do(lambda client: client.clear(name), then)

    def load_law(self, then: Callable[[tuple[str, tuple[str, ...]] | Refusal], None]) -> None:
        """Read what the controller's law and its own values are called."""
        self._ask(lambda client: client.law(), then)

    def load_plan(self, then: Callable[[RunPlan | Refusal], None]) -> None:
        """Read whose clock the run has, how long it is to last, and its pace."""
        self._ask(lambda client: client.plan(), then)

    def load_outcome(self, then: Callable[[str | Refusal], None]) -> None:
        """Read how the controller says its run has ended; empty before."""
        self._ask(lambda client: client.outcome(), then)

    def record(self, is_on: bool, then: Callable[[str | Refusal], None]) -> None:
        """Record frames and signals from now on, or no longer."""

        def job(client: BenchClient) -> str:
            place = client.record(is_on)
            return f"recording again in {place}" if is_on else f"recording is off; what has come is in {place}"

        self._do(job, then)

    def stop(self, is_on: bool, then: Callable[[str | Refusal], None]) -> None:
        """Emergency stop: open the supplies of all amplifiers, or close them again.

        To open them, one frame goes out at once, on the channel that needs no claim: a conversation that is on may take
        seconds. The conversation that follows says whether it has been heard. That it cannot go out is said at once.
        """
        if is_on:
            request = next(download(EMERGENCY_STOP, 0, b"\1"))
            try:
                self._link.send([Frame(sdo_channel(self._cell.bus.bench_node_id, 0)[0], request)])
            except NotConnectedError:
                then(Refusal(NOT_SENT.format("no bench is connected")))
                return
            except BusError as error:
                then(Refusal(NOT_SENT.format(error)))
                return

        def job(client: BenchClient) -> str:
            client.emergency_stop(is_on)
            return "emergency stop: the supply of all amplifiers is " + ("open" if is_on else "closed again")

        def confirmed(answer: str | Refusal) -> None:
            if is_on and isinstance(answer, Refusal):
                answer = Refusal(NOT_CONFIRMED.format(answer.reason))
            then(answer)

        self._do(job, confirmed)

    def reset(self, then: Callable[[str | Refusal], None]) -> None:
        """Power-on reset of the robot: faults and emergency stop gone, arms parked, every card boots."""

        def job(client: BenchClient) -> str:
            client.power_cycle()
            return "the robot was switched off and on again"

        self._do(job, then)

    def _look(self, signal: FaultSignal, now_ns: int) -> None:
        # Events are many; without a change in the telemetry there are no new ones.
        known = self.faults if signal == self._events_of else None
        self._seen, self._is_looking = signal, True
        self._due_ns, self._soonest_ns = now_ns + LOOK_NS, now_ns + CHANGE_NS

        def job(client: BenchClient) -> tuple[Faults, tuple[bool, str]]:
            return _read(client, signal, known), client.recording()

        def take(answer: tuple[Faults, tuple[bool, str]] | Refusal) -> None:
            self._is_looking = False
            if isinstance(answer, Refusal):
                self.refusal, self._due_ns, self._soonest_ns = answer, now_ns + RETRY_NS, now_ns + RETRY_NS
            else:
                self.refusal, (self.faults, self.recording), self._events_of = None, answer, signal

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
            # In its own thread an unforeseen error would vanish, and the request would stay open for ever.
            except Exception as error:
                answer.append(Refusal(f"{self._link.where}: {named_error(error)}"))
            self._is_done = True

        question = run, lambda: then(answer[0])
        if is_urgent:
            self._waiting.appendleft(question)
        else:
            self._waiting.append(question)


def _read(client: BenchClient, signal: FaultSignal, known: Faults | None) -> Faults:
    """The faults; what is `known`, and has not changed, is not read again."""
    found = client.status()
    if known is not None and len(known.acting) == len(found["active"]):
        now = faults_of(found, ())
        return replace(now, acting=known.acting, events=known.events, detections=known.detections)
    events = client.events() if found["begun"] else ()
    return faults_of(found, events, client.detections() if signal.detections else ())
