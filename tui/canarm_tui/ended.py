"""How a run has ended as the bench has been told, for a dashboard that did not start it.

The controller's state says that it has ended; its words for it come a moment later, by SDO. Time is passed in.
"""

from collections.abc import Callable, Iterable

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES, ENDED
from canarm_protocol.faults.detection_events import DetectionEvent

from .event_texts import STOPS
from .events import Happening
from .fault_desk import FaultDesk, Refusal
from .outcome import Outcome
from .snapshot import Report

ASK_NS = 500_000_000
MOST_QUESTIONS = 6
"""A controller of another kind may never say it."""


class BenchOutcome:
    """Asks `desk` as soon as the controller has ended, some times until it has said how."""

    def __init__(self, desk: FaultDesk) -> None:
        self._desk = desk
        self._told = ""
        self._asked, self._due_ns, self._is_asking = 0, 0, False

    def poll(self, report: Report | None, happened: Callable[[], Iterable[Happening]], now_ns: int) -> Outcome | None:
        """The outcome of the run that has ended; None while one goes on, or nobody has said anything."""
        state = None if report is None else CONTROLLER_STATES.get(report.state)
        if state not in ENDED:
            self._told, self._asked, self._due_ns = "", 0, 0
            return None
        if not self._told and self._asked < MOST_QUESTIONS and not self._is_asking and now_ns >= self._due_ns:
            self._asked, self._due_ns, self._is_asking = self._asked + 1, now_ns + ASK_NS, True
            self._desk.load_outcome(self._take)
        is_well = state == "done"
        if self._told:
            verdict, *details = self._told.splitlines()
            return Outcome(verdict, is_well, details)
        reason = _last_words(happened())
        return Outcome("DONE" if is_well else "FAILED", is_well, () if is_well or not reason else (reason,))

    def _take(self, answer: str | Refusal) -> None:
        self._is_asking = False
        if not isinstance(answer, Refusal) and self._asked:
            self._told = answer


def _last_words(happened: Iterable[Happening]) -> str:
    """What the last detection said that ended the run."""
    for each in happened:
        event = each.event
        if isinstance(event, DetectionEvent) and not each.is_earlier and event.reaction.startswith(STOPS):
            return f"{event.detector}: {event.detail}"
    return ""
