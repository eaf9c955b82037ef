"""The dashboard's texts about events: faults that begin and end, emergency stops, detections with latency, notices.

Pure functions. Times count from cycle 0, as those of traces do.
"""

from collections.abc import Collection, Iterable

from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent, StopEvent, fault_label

from .events import Event, Happening
from .notices import Kind, Notice
from .texts import Tone, Word

Line = tuple[Word, ...]
Mark = tuple[int, Word]
"""A cycle, and the sign of what happened in it."""

STOPS = "safe-stop"
"""How the reactions begin that end a run."""
NOTHING = (Word("nothing has happened yet: no fault has begun, and no controller has detected anything", Tone.DIM),)
_SIGNS = {Kind.EMERGENCY: "!", Kind.NMT: "»", Kind.NODE: "•", Kind.CONTROLLER: "▸", Kind.LATE: "×"}


def event_line(each: Happening, cycle_s: float) -> Line:
    """When, what, and of a detection how long after the last fault, and what the controller did."""
    event = each.event
    sign, tone = sign_of(event)
    at = Word(when(event, cycle_s, each.is_earlier, each.run), Tone.DIM)
    if isinstance(event, Notice):
        times = f"  {event.times} times" if event.times > 1 and event.kind is not Kind.LATE else ""
        number = f"{event.times} " if event.kind is Kind.LATE else ""
        return at, Word(f"{sign} {number}{event.what}{times}", tone)
    if isinstance(event, StopEvent):
        return at, Word(f"{sign} emergency stop {'on' if event.is_on else 'off'}", tone)
    if isinstance(event, FaultEvent):
        verb = "fault begins" if event.is_begin else "fault ends"
        failure = f", {event.failure}" if event.failure else ""
        return at, Word(f"{sign} {verb}: {what_of(event)}{failure}", tone)
    where = "" if event.where is None else f" at {event.where}"
    found = Word(f"{sign} detected: {event.detector}{where}", tone)
    words = [at, found, Word(event.reaction, tone)]
    if each.answers is not None:
        latency_ms = 1e3 * cycle_s * (event.cycle - each.answers.cycle)
        words.append(Word(f"{latency_ms:.1f} ms after {what_of(each.answers)}"))
    return *words, Word(event.detail, Tone.DIM)


def sign_of(event: Event) -> Word:
    """One character for the event, as in its line and above a trace."""
    if isinstance(event, DetectionEvent):
        return Word("◆", Tone.BAD if event.reaction.startswith(STOPS) else Tone.GOOD)
    if isinstance(event, Notice):
        return Word(_SIGNS[event.kind], Tone.WARNING if event.is_wrong else Tone.PLAIN)
    if isinstance(event, StopEvent):
        return Word("■", Tone.BAD) if event.is_on else Word("□")
    if event.failure:
        return Word("○", Tone.BAD)
    return Word("▲", Tone.WARNING) if event.is_begin else Word("○")


def marks_of(happened: Iterable[Happening], joint: str, joints: Collection[str]) -> tuple[Mark, ...]:
    """The faults, stops and detections above the trace of `joint`: those that are not about another one of `joints`."""

    def place(event: FaultEvent | DetectionEvent | StopEvent) -> str | None:
        if isinstance(event, StopEvent):
            return None
        return event.tap.partition(".")[0] if isinstance(event, FaultEvent) else event.where

    events = (each.event for each in happened if not each.is_earlier)
    return tuple(
        (event.cycle, sign_of(event))
        for event in events
        if not isinstance(event, Notice) and (place(event) == joint or place(event) not in joints)
    )


def what_of(event: FaultEvent | StopEvent) -> str:
    """The fault's readable name, or that of the stop."""
    if isinstance(event, StopEvent):
        return "the emergency stop"
    return fault_label(event.set_name, event.tap, event.fault)


def stopped_by(happened: Iterable[Happening], cycle_s: float) -> str:
    """That the emergency stop has ended the run, and when; empty if it has not. `happened` is newest first."""
    for each in happened:
        is_end = isinstance(each.event, DetectionEvent) and each.event.reaction.startswith(STOPS)
        if is_end and isinstance(each.answers, StopEvent):
            return f"stopped by the emergency stop at {each.answers.cycle * cycle_s:.3f} s"
    return ""


def when(event: Event, cycle_s: float, is_earlier: bool = False, run: int = 0) -> str:
    """Seconds from cycle 0 of its run, and the cycle; of what was before the present run, in which `run` it was."""
    which = f"run-{run}: " if run else ""
    if event.cycle < 0:
        return f"{which}before cycle 0"
    if is_earlier and not run:
        return f"earlier run (cycle {event.cycle})"
    return f"{which}{event.cycle * cycle_s:.3f} s (cycle {event.cycle})"
