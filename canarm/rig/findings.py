"""Answers that read well in an assertion: true or false, with text. Runs and buses are not known here."""

import warnings
from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Literal, NamedTuple

from canarm_controller.supervision.detection import DETECTORS, Detection
from canarm_protocol.cell.cell_messages import near_and_all, nearest
from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.fault_events import FaultEvent
from canarm_protocol.shown import quoted

from ..usage import UsageError, check_number
from .arguments import RigWarning


class Finding:
    """True or false, and why, for `assert`: pytest shows the text if it is false.

    One that is discarded without having been asked warns: the `assert` was forgotten.
    """

    __slots__ = ("_holds", "_is_seen", "_text")

    def __init__(self, holds: bool, text: str) -> None:
        self._holds, self._text, self._is_seen = holds, text, False

    @property
    def holds(self) -> bool:
        """Whether it is true."""
        self._is_seen = True
        return self._holds

    @property
    def text(self) -> str:
        """What was found."""
        self._is_seen = True
        return self._text

    def __bool__(self) -> bool:
        return self.holds

    def __repr__(self) -> str:
        return f"<{self.text}>"

    def __del__(self) -> None:
        if not self._is_seen:
            verdict = "holds" if self._holds else "does not hold"
            warnings.warn(f"nobody has asked whether this {verdict} (assert?): {self._text}", RigWarning, stacklevel=2)


class Noticed(NamedTuple):
    """A detection with the virtual time of the SYNC that began its cycle."""

    time_s: float
    detection: Detection

    @property
    def text(self) -> str:
        """Detector, place and time, without the details."""
        where = f" at {self.detection.where}" if self.detection.where else ""
        return f"{self.detection.detector}{where} at {self.time_s:.4f} s"


class Begun(NamedTuple):
    """The beginning of a fault: its virtual time, tap and name."""

    time_s: float
    tap: str
    fault: str

    @property
    def text(self) -> str:
        """Tap, fault and time."""
        return f"{self.tap} {self.fault} at {self.time_s:.4f} s"


def begun_of(events: Iterable[FaultEvent]) -> list[Begun]:
    """The beginnings among `events`."""
    return [Begun(each.time_s, each.tap, each.fault) for each in events if each.is_begin]


class Start(Enum):
    """Where the clock of a detection starts if no time is given."""

    FAULT = "the beginning of the latest fault"


class Detected:
    """The detections that answer a question. True if there are any.

    `sought` is what was asked for, `begun` the latest fault; `since_s` is where `within` counts from: the beginning of
    `begun` unless given. One that is discarded without having been asked warns: the `assert` was forgotten.
    """

    def __init__(
        self,
        sought: str,
        found: Sequence[Noticed],
        others: Sequence[Noticed],
        begun: Begun | None,
        since_s: float | None,
    ) -> None:
        self.sought, self.begun, self.since_s = sought, begun, since_s
        self._found, self._others = found, others
        self._is_seen = False

    @property
    def found(self) -> Sequence[Noticed]:
        """The detections that match."""
        self._is_seen = True
        return self._found

    @property
    def others(self) -> Sequence[Noticed]:
        """The rest."""
        self._is_seen = True
        return self._others

    def __bool__(self) -> bool:
        return bool(self.found)

    def __del__(self) -> None:
        if not self._is_seen:
            verdict = "was detected" if self._found else "was not detected"
            warnings.warn(f"nobody has asked whether {self.sought} {verdict} (assert?)", RigWarning, stacklevel=2)

    def within(self, limit_s: float, of: float | Literal[Start.FAULT] | None = Start.FAULT) -> Finding:
        """Whether the first one came no later than `limit_s` after that time, or after the time `of` (s).

        Detections before the fault do not count. `of` is for clocks that start later, when the fault begins to
        show; a detection before it is early enough. Raises `UsageError` for an `of` of None, which `departure` returns
        where the truth has never moved on: there is nothing to count from.
        """
        __tracebackhide__ = True
        first, since_s = self._first, self.since_s
        check_number("within", limit_s, 0.0)
        if not isinstance(of, Start | None):
            check_number("within: of", of)
        if since_s is None:
            return Finding(False, f"no fault has begun that a detection could come after; {self.text}")
        if of is None:
            raise UsageError(
                f"within: of is None: the truth has not moved on since {self._start}, so there is nothing to count "
                f"from; to count from the beginning of the fault, leave of= out. {self.text}"
            )
        if first is None:
            return Finding(False, f"{self.sought} not detected after {self._start}; {self.text}")
        start_s, start = (since_s, self._start) if of is Start.FAULT else (of, f"{of:.4f} s")
        latency_s = first.time_s - start_s
        text = f"{first.text}, {_ms(latency_s)} after {start}"
        if latency_s <= limit_s + HALF_NS:
            return Finding(True, text)
        return Finding(False, f"{text}; must be within {_ms(limit_s)}")

    @property
    def latency_s(self) -> float | None:
        """From `since_s` to the first one after it; None if there is none."""
        first = self._first
        return None if first is None or self.since_s is None else first.time_s - self.since_s

    @property
    def text(self) -> str:
        """What was detected and when, or what was detected instead."""
        if self.found:
            after = "" if self.latency_s is None else f", {_ms(self.latency_s)} after {self._start}"
            more = f", and {len(self.found) - 1} more" if len(self.found) > 1 else ""
            return f"{(self._first or self.found[0]).text}{after}{more}"
        others = ", ".join(each.text for each in self.others)
        return f"{self.sought} not detected; detected: {others or 'nothing'}"

    @property
    def _first(self) -> Noticed | None:
        self._is_seen = True
        if self.since_s is None:
            return None
        return next((each for each in self.found if each.time_s >= self.since_s - HALF_NS), None)

    @property
    def _start(self) -> str:
        if self.begun is not None and self.begun.time_s == self.since_s:
            return f"{self.begun.tap} {self.begun.fault}"
        return f"{self.since_s:.4f} s"

    def __repr__(self) -> str:
        return f"<{self.text}>"


HALF_NS = 0.5e-9
"""Times are whole nanoseconds; as float seconds they are off by a rounding error."""


def ask_detected(
    noticed: Sequence[Noticed], begun: Sequence[Begun], name: str | None, joint: str | None, since_s: float | None
) -> Detected:
    """Those of `noticed` by detector `name` at `joint` (None: any), after `since_s` if given."""
    found: list[Noticed] = []
    others: list[Noticed] = []
    for each in noticed:
        fits = name in (None, each.detection.detector) and joint in (None, each.detection.where)
        is_late_enough = since_s is None or each.time_s >= since_s - HALF_NS
        (found if fits and is_late_enough else others).append(each)
    last = begun[-1] if begun else None
    start_s = since_s if since_s is not None else None if last is None else last.time_s
    sought = (name or "anything") + (f" at {joint}" if joint else "")
    return Detected(sought, found, others, last, start_s)


def check_question(cell: Cell, name: object, where: object, since_s: object) -> None:
    """Raises `UsageError` if nothing can ever match: `assert not` would always pass."""
    __tracebackhide__ = True
    if since_s is not None:
        check_number("detected: since", since_s)
    if name is not None and (not isinstance(name, str) or name not in DETECTORS):
        raise UsageError(f"detected: no detector {quoted(name)}{nearest(name, DETECTORS)}")
    nodes = [cell.bus.controller_node_id, *(card.node_id for card in cell.card)]
    places = [*cell.joint_names, *(card.name for card in cell.card), *(f"0x{node_id:02X}" for node_id in nodes)]
    if where is not None and (not isinstance(where, str) or where not in places):
        raise UsageError(f"detected: no joint, card or node {quoted(where)}{near_and_all(where, places)}")


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.4g} ms"
