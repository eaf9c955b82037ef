"""Everything that has happened on a bench, in one order, and what a detection may answer. Values only."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from canarm_protocol.faults.detection_events import DetectionEvent
from canarm_protocol.faults.fault_events import FaultEvent, StopEvent

from .faults import Faults
from .notices import Kind, Notice

Event = FaultEvent | DetectionEvent | StopEvent | Notice
MOMENT_CYCLES = 400
"""A fault that has ended may be noticed so much later: 1 s at 400 Hz."""


class Happening(NamedTuple):
    """An event of the bench. Of a detection, `answers` is what began last before it in the same run, a fault or the
    emergency stop, and acts or has just ended. `is_earlier` if it belongs to a run before the present one; `run` is
    its number then, 0 if that is not known.
    """

    event: Event
    answers: FaultEvent | StopEvent | None = None
    is_earlier: bool = False
    run: int = 0


def happenings(faults: Faults, noticed: Iterable[Notice] = ()) -> tuple[Happening, ...]:
    """Beginnings and ends of faults, emergency stops, detections, and what was noticed besides, newest first. A
    detection comes after the fault of its cycle.
    """
    found: list[Happening] = []
    causes = _Causes()
    events = [*_all_of(faults), *noticed]
    for event in sorted(events, key=lambda event: _order(event, faults.begin_ns)):
        if _is_earlier(event, faults.begin_ns):
            found.append(Happening(event, is_earlier=True))
        elif isinstance(event, Notice):
            found.append(Happening(event))
        elif isinstance(event, DetectionEvent):
            found.append(Happening(event, causes.of(event)))
        else:
            causes.take(event)
            found.append(Happening(event))
    return tuple(reversed(found))


class _Causes:
    """What may have caused a detection, as events come."""

    def __init__(self) -> None:
        self._acting: dict[tuple[str, ...], list[FaultEvent | StopEvent]] = {}
        self._over: list[tuple[FaultEvent | StopEvent, int]] = []

    def take(self, event: FaultEvent | StopEvent) -> None:
        """Something has begun or ended."""
        key: tuple[str, ...]
        if isinstance(event, StopEvent):
            key, is_begin = (), event.is_on
        else:
            key, is_begin = (event.set_name, event.tap, event.fault), event.is_begin
        acting = self._acting.setdefault(key, [])
        if is_begin:
            acting.append(event)
        elif acting:
            self._over.append((acting.pop(0), event.cycle))

    def of(self, detection: DetectionEvent) -> FaultEvent | StopEvent | None:
        """What began last before it, if that acts or has just ended."""
        recent = [begun for begun, end in self._over if detection.cycle - end <= MOMENT_CYCLES]
        known = [*(each for acting in self._acting.values() for each in acting), *recent]
        heard_ns = detection.time_ns or math.inf
        # Once nobody sends SYNC any more, cycles stand still, and only time tells what came afterwards.
        earlier = (each for each in known if 0 <= each.cycle <= detection.cycle and each.time_ns <= heard_ns)
        return max(earlier, key=lambda each: each.time_ns, default=None)


def _all_of(faults: Faults) -> Iterable[Event]:
    # The bench's order decides between events of one moment.
    yield from reversed(faults.events)
    yield from reversed(faults.stops)
    yield from reversed(faults.detections)


def _order(event: Event, begin_ns: int) -> tuple[int, int, int, int]:
    """By time; in the present run by cycle, since the bench hears of a detection later, and in that as one follows
    from the other.
    """
    if _is_earlier(event, begin_ns):
        return 0, event.time_ns, 0, 0
    if isinstance(event, Notice):
        place = 3 if event.kind is Kind.CONTROLLER else 1
    else:
        place = 2 if isinstance(event, DetectionEvent) else 0
    return 1, event.cycle, place, event.time_ns


def _is_earlier(event: Event, begin_ns: int) -> bool:
    """Whether it belongs to a run before the present one; the clock of a notice's bus may be another one."""
    return event.is_earlier if isinstance(event, Notice) else event.time_ns < begin_ns
