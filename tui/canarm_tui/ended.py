"""How a run has ended, for a dashboard that did not start it: as the bench has been told, or that somebody is lost.

The controller's state says that it has ended; its words for it come a moment later, by SDO. Time is passed in.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

from canarm_protocol.cell.bench_objects import CONTROLLER_STATES, ENDED
from canarm_protocol.faults.detection_events import DetectionEvent

from .event_texts import STOPS, event_line
from .events import Happening
from .fault_desk import FaultDesk, Refusal
from .feed import HAVING, Feed
from .link import LinkState
from .outcome import Outcome
from .snapshot import Report
from .texts import Connection

ASK_NS = 500_000_000
MOST_LINES = 3
"""Events that stand below the verdict of a run that was lost."""
MOST_QUESTIONS = 6
"""A controller of another kind may never say it."""


class BenchOutcome:
    """Asks `desk` as soon as the controller has ended, some times until it has said how."""

    def __init__(self, desk: FaultDesk, cycle_s: float) -> None:
        self._desk, self._cycle_s = desk, cycle_s
        self._told = ""
        self._asked, self._due_ns, self._is_asking = 0, 0, False

    def of(self, feed: Feed, link: Connection, happened: Sequence[Happening], now_ns: int) -> Outcome | None:
        """The outcome of the run that has ended or was lost; None while one goes on, or nobody has said anything.

        Of what has `happened`, newest first, the last of this run is told too.
        """
        report = feed.report(now_ns)
        return self._told_by(report, happened, now_ns) or self._lost(report, _why_lost(feed, link, now_ns), happened)

    def _told_by(self, report: Report | None, happened: Sequence[Happening], now_ns: int) -> Outcome | None:
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
        reason = _last_words(happened)
        return Outcome("DONE" if is_well else "FAILED", is_well, () if is_well or not reason else (reason,))

    def _lost(self, report: Report | None, why_bench: str, happened: Iterable[Happening]) -> Outcome | None:
        """A run has lost its controller, or its bench for the reason `why_bench`, empty if it has not."""
        if report is None or CONTROLLER_STATES.get(report.state) not in HAVING:
            return None
        said = []
        if report.is_lost:
            verdict = "LOST: the controller has fallen silent; it was killed, or hangs"
            said.append(f"its last report is of cycle {report.tick}, {report.age_ns * 1e-9:.0f} s ago")
            if why_bench:
                said.append(f"then the bench was lost: {why_bench}")
        elif why_bench:
            verdict = "LOST: the bench, in the middle of a run"
            said.append(why_bench)
        else:
            return None
        recording = self._desk.recording
        if recording is not None and recording[0]:
            said.append(f"recorded in {recording[1]}")
        return Outcome(verdict, False, (*said, *islice(_lines(happened, self._cycle_s), MOST_LINES)))

    def _take(self, answer: str | Refusal) -> None:
        self._is_asking = False
        if not isinstance(answer, Refusal) and self._asked:
            self._told = answer


def _why_lost(feed: Feed, link: Connection, now_ns: int) -> str:
    if link.state is LinkState.LOST:
        return link.reason or link.where
    is_there = link.state is LinkState.CONNECTING or feed.lives(now_ns)
    return "" if is_there else f"{link.where}: nothing comes from it any more"


def _last_words(happened: Iterable[Happening]) -> str:
    """What the last detection said that ended the run."""
    for each in happened:
        event = each.event
        if isinstance(event, DetectionEvent) and not each.is_earlier and event.reaction.startswith(STOPS):
            return f"{event.detector}: {event.detail}"
    return ""


def _lines(happened: Iterable[Happening], cycle_s: float) -> Iterator[str]:
    return (" │ ".join(word.text for word in event_line(each, cycle_s)) for each in happened if not each.is_earlier)
