"""The dashboard's texts about events: faults that begin and end, detections with their latency. Pure functions."""

from collections.abc import Collection, Iterable

from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent, fault_label

from .events import Happening
from .texts import Tone, Word

Line = tuple[Word, ...]
Mark = tuple[int, Word]
"""A cycle, and the sign of what happened in it."""

STOPS = "safe-stop"
"""How the reactions begin that end a run."""
NOTHING = (Word("nothing has happened yet: no fault has begun, and no controller has detected anything", Tone.DIM),)


def event_line(each: Happening, cycle_s: float) -> Line:
    """When, what, and of a detection how long after the last fault, and what the controller did."""
    event = each.event
    sign, tone = sign_of(event)
    if isinstance(event, FaultEvent):
        verb = "fault begins" if event.is_begin else "fault ends"
        failure = f", {event.failure}" if event.failure else ""
        return Word(when(event), Tone.DIM), Word(f"{sign} {verb}: {what_of(event)}{failure}", tone)
    where = "" if event.where is None else f" at {event.where}"
    found = Word(f"{sign} detected: {event.detector}{where}", tone)
    words = [Word(when(event), Tone.DIM), found, Word(event.reaction, tone)]
    if each.answers is not None:
        latency_ms = 1e3 * cycle_s * (event.cycle - each.answers.cycle)
        words.append(Word(f"{latency_ms:.1f} ms after {what_of(each.answers)}"))
    return *words, Word(event.detail, Tone.DIM)


def sign_of(event: FaultEvent | DetectionEvent) -> Word:
    """One character for the event, as in its line and above a trace."""
    if isinstance(event, DetectionEvent):
        return Word("◆", Tone.BAD if event.reaction.startswith(STOPS) else Tone.GOOD)
    if event.failure:
        return Word("○", Tone.BAD)
    return Word("▲", Tone.WARNING) if event.is_begin else Word("○")


def marks_of(happened: Iterable[Happening], joint: str, joints: Collection[str]) -> tuple[Mark, ...]:
    """The events above the trace of `joint`: those that are not about another one of `joints`."""

    def place(event: FaultEvent | DetectionEvent) -> str | None:
        return event.tap.partition(".")[0] if isinstance(event, FaultEvent) else event.where

    events = (each.event for each in happened)
    return tuple(
        (event.cycle, sign_of(event)) for event in events if place(event) == joint or place(event) not in joints
    )


def what_of(event: FaultEvent) -> str:
    """The fault's readable name."""
    return fault_label(event.set_name, event.tap, event.fault)


def when(event: FaultEvent | DetectionEvent) -> str:
    """Seconds since power-on, and the cycle since NMT start."""
    return f"{event.time_ns * 1e-9:.3f} s" + (f" (cycle {event.cycle})" if event.cycle >= 0 else "")
