"""Everything that has happened on a bench, in one order, and which fault a detection may answer. Values only."""

from collections.abc import Iterable
from typing import NamedTuple

from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent

from .faults import Faults


class Happening(NamedTuple):
    """An event of the bench. Of a detection, `answers` is the fault that began last before it, if one has."""

    event: FaultEvent | DetectionEvent
    answers: FaultEvent | None = None


def happenings(faults: Faults) -> tuple[Happening, ...]:
    """Beginnings and ends of faults, and detections, newest first. A detection comes after the fault of its cycle."""
    found: list[Happening] = []
    last: FaultEvent | None = None
    for event in _in_order(reversed(faults.events), reversed(faults.detections)):
        if isinstance(event, FaultEvent):
            last = event if event.is_begin else last
            found.append(Happening(event))
        else:
            found.append(Happening(event, last if last is not None and last.cycle <= event.cycle else None))
    return tuple(reversed(found))


def _in_order(events: Iterable[FaultEvent], detections: Iterable[DetectionEvent]) -> list[FaultEvent | DetectionEvent]:
    both: list[FaultEvent | DetectionEvent] = [*events, *detections]
    return sorted(both, key=lambda event: event.time_ns)
