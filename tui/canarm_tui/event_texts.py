"""The dashboard's texts about events: faults that begin and end, detections with their latency. Pure functions."""

from collections.abc import Iterable

from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent, fault_label

from .events import Happening
from .texts import Tone, Word

Line = tuple[Word, ...]

STOPS = "safe-stop"
"""How the reactions begin that end a run."""
NOTHING = (Word("nothing has happened yet: no fault has begun, and no controller has detected anything", Tone.DIM),)


def event_lines(happened: Iterable[Happening], cycle_s: float) -> tuple[Line, ...]:
    """A line per event, or one that says that there is none."""
    return tuple(event_line(each, cycle_s) for each in happened) or (NOTHING,)


def event_line(each: Happening, cycle_s: float) -> Line:
    """When, what, and of a detection how long after the last fault, and what the controller did."""
    event = each.event
    if isinstance(event, FaultEvent):
        sign, tone = ("▲", Tone.WARNING) if event.is_begin else ("○", Tone.PLAIN)
        verb = "fault begins" if event.is_begin else "fault ends"
        failure = f", {event.failure}" if event.failure else ""
        what = Word(f"{sign} {verb}: {what_of(event)}{failure}", Tone.BAD if event.failure else tone)
        return Word(when(event), Tone.DIM), what
    tone = Tone.BAD if event.reaction.startswith(STOPS) else Tone.GOOD
    where = "" if event.where is None else f" at {event.where}"
    words = [
        Word(when(event), Tone.DIM),
        Word(f"◆ detected: {event.detector}{where}", tone),
        Word(event.reaction, tone),
    ]
    if each.answers is not None:
        latency_ms = 1e3 * cycle_s * (event.cycle - each.answers.cycle)
        words.append(Word(f"{latency_ms:.1f} ms after {what_of(each.answers)}"))
    return *words, Word(event.detail, Tone.DIM)


def what_of(event: FaultEvent) -> str:
    """The fault's readable name."""
    return fault_label(event.set_name, event.tap, event.fault)


def when(event: FaultEvent | DetectionEvent) -> str:
    """Seconds since power-on, and the cycle since NMT start."""
    return f"{event.time_ns * 1e-9:.3f} s" + (f" (cycle {event.cycle})" if event.cycle >= 0 else "")
