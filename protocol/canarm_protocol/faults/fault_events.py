"""Beginnings and ends of faults, and emergency stops: values, and plain objects of `events.jsonl` and the bench node.

The emulator decides when a fault begins.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

FAULT_BEGINS, FAULT_ENDS, EMERGENCY_STOP = "fault-begins", "fault-ends", "emergency-stop"


class FaultEvent(NamedTuple):
    """A fault has begun or ended: virtual time, cycle since NMT start (-1 before), set, tap and fault.

    `failure` says what went wrong if it has ended because the fault itself has failed.
    """

    time_ns: int
    cycle: int
    is_begin: bool
    set_name: str
    tap: str
    fault: str
    failure: str = ""

    @property
    def time_s(self) -> float:
        """Virtual time in seconds."""
        return self.time_ns * 1e-9

    @property
    def label(self) -> str:
        """Readable name of the fault."""
        return fault_label(self.set_name, self.tap, self.fault)


class StopEvent(NamedTuple):
    """The emergency stop was pressed or released: virtual time, and the last cycle's number since NMT start."""

    time_ns: int
    cycle: int
    is_on: bool


def stop_as_plain(event: StopEvent) -> dict[str, Any]:
    """The event as plain values, with the keys of `events.jsonl`."""
    state = "on" if event.is_on else "off"
    return {"time_ns": event.time_ns, "event": EMERGENCY_STOP, "state": state, "cycle": event.cycle}


def stop_from_plain(plain: Mapping[str, Any]) -> StopEvent:
    """What `stop_as_plain` made of an event. Raises `KeyError` or `TypeError` if it did not."""
    time_ns, cycle = plain["time_ns"], plain["cycle"]
    if type(time_ns) is not int or type(cycle) is not int:
        raise TypeError("not an emergency stop")
    return StopEvent(time_ns, cycle, plain["state"] == "on")


def fault_label(set_name: str, tap: str, fault: str) -> str:
    """Readable name of a fault: tap and fault, and the set if that has a name of its own."""
    what = f"{tap} {fault}"
    return what if set_name == what else f"{what} ({set_name})"


def event_name(event: FaultEvent) -> str:
    """Its name in a run folder."""
    return FAULT_BEGINS if event.is_begin else FAULT_ENDS


def event_details(event: FaultEvent) -> dict[str, Any]:
    """Which fault, where, and in which cycle."""
    details = {"set": event.set_name, "tap": event.tap, "fault": event.fault, "cycle": event.cycle}
    return {**details, "failure": event.failure} if event.failure else details


def event_as_plain(event: FaultEvent) -> dict[str, Any]:
    """The event as plain values, with the keys of `events.jsonl`."""
    return {"time_ns": event.time_ns, "event": event_name(event), **event_details(event)}


def event_from_plain(plain: Mapping[str, Any]) -> FaultEvent:
    """What `event_as_plain` made of an event. Raises `KeyError` where a key is missing."""
    return FaultEvent(
        plain["time_ns"],
        plain["cycle"],
        plain["event"] == FAULT_BEGINS,
        plain["set"],
        plain["tap"],
        plain["fault"],
        plain.get("failure", ""),
    )
