"""The bench's faults and the controllers' detections as values: acting faults, waiting sets, the last events.

Plain values of the bench's JSON in, frozen values out. No bus, no clock, no texts.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from canarm_protocol.faults.detection_events import DetectionEvent, detection_from_plain
from canarm_protocol.faults.fault_events import FaultEvent, StopEvent, event_from_plain, stop_from_plain


@dataclass(frozen=True, slots=True)
class FaultSignal:
    """Objects of faults and detections in the bench's telemetry: 0x2405, 0x2410, 0x2406, 0x2141."""

    active: int
    """255 for more."""
    is_stopped: bool
    begun: int
    detections: int = 0


@dataclass(frozen=True, slots=True)
class ActingFault:
    """An acting fault. `began` is None if the bench no longer knows."""

    set_name: str
    tap: str
    fault: str
    began: FaultEvent | None = None


@dataclass(frozen=True, slots=True)
class SetPlan:
    """When a set acts: for how long (None: until it is cleared), how often in all and so far, and what it waits for."""

    duration_s: float | None = None
    repeat: int = 1
    activations: int = 0
    trigger: str = ""


@dataclass(frozen=True, slots=True)
class Faults:
    """All faults at one time. `waiting` and `set_names` are names of sets; `events`, `detections` and emergency `stops`
    are newest first, as many as the bench keeps. `begin_ns` is the virtual time of cycle 0 of the present run: what was
    before belongs to another one.
    """

    acting: tuple[ActingFault, ...] = ()
    waiting: tuple[str, ...] = ()
    set_names: tuple[str, ...] = ()
    """Sets that can be cleared: acting or waiting."""
    events: tuple[FaultEvent, ...] = ()
    detections: tuple[DetectionEvent, ...] = ()
    stops: tuple[StopEvent, ...] = ()
    begin_ns: int = 0
    plans: Mapping[str, SetPlan] = field(default_factory=dict)
    """By the set's name, as far as they are known."""


def faults_of(
    status: Mapping[str, Any], events: Iterable[Mapping[str, Any]], detections: Iterable[Mapping[str, Any]] = ()
) -> Faults:
    """The bench's FAULT_STATUS, FAULT_EVENTS and DETECTION_EVENTS as values. Raises `KeyError` or `TypeError` if
    malformed.
    """
    happened = [event_from_plain(each) for each in events]
    begun: dict[tuple[str, str, str], list[FaultEvent]] = {}
    for event in happened:
        where = event.set_name, event.tap, event.fault
        if event.is_begin:
            begun.setdefault(where, []).append(event)
        elif begun.get(where):
            begun[where].pop(0)
    acting = []
    for each in status["active"]:
        set_name, tap, fault = each["set"], each["tap"], each["fault"]
        beginnings = begun.get((set_name, tap, fault))
        acting.append(ActingFault(set_name, tap, fault, beginnings.pop(0) if beginnings else None))
    states = [(each["set"], each["state"]) for each in status["sets"]]
    return Faults(
        tuple(acting),
        tuple(name for name, state in states if state == "waiting"),
        tuple(dict.fromkeys(name for name, state in states if state != "ended")),
        tuple(reversed(happened)),
        tuple(detection_from_plain(each) for each in detections)[::-1],
        tuple(stop_from_plain(each) for each in status.get("stops", ()))[::-1],
        _begin_of(status),
        {each["set"]: _plan(each) for each in status["sets"]},
    )


def _plan(plain: Mapping[str, Any]) -> SetPlan:
    duration_s = plain.get("duration_s")
    return SetPlan(
        None if duration_s is None else float(duration_s),
        int(plain.get("repeat", 1)),
        int(plain["activations"]),
        str(plain.get("trigger", "")),
    )


def _begin_of(status: Mapping[str, Any]) -> int:
    begin_ns = status.get("begin_ns", 0)
    # Without a cycle 0 so far, all that has happened was before this run.
    return int(status["time_ns"] + 1 if begin_ns is None else begin_ns)
