"""The bench node's fault objects: a text is carried out as soon as it is written, and its result is read back.

Texts in, texts out. The engine knows what a text means and when faults act; `sdo_channels` knows who writes.
"""

import json
import logging
import zlib
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from canarm_protocol.canopen.sdo import AbortCode
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_events import FaultEvent, StopEvent, event_as_plain, stop_as_plain
from canarm_protocol.faults.script import FaultScript, parse_faults

from ..node.store import SdoRefused

NOTHING_YET = "nothing was written on this channel yet"
NO_FAULTS = "no faults can be injected on this bench"
NO_LINES = "\n"
"""Stands for no lines: an empty object cannot be read by SDO."""
LONGEST_RESULT = 4000
MOST_STOPS = 10
U8 = 0xFF
_log = logging.getLogger(__name__)
SOURCE = "fault set"


class FaultDesk(Protocol):
    """Carries out what the texts ask for."""

    def inject(self, script: FaultScript) -> str:
        """Carry out a script; returns what was done. Raises `FaultError` with the reason of a refusal."""
        ...

    def plain_sets(self) -> list[dict[str, Any]]:
        """Every set that was accepted and not cleared: `set`, `state`, `activations`, and when it acts."""
        ...

    def plain_catalogue(self) -> list[dict[str, Any]]:
        """What can be injected where: one object per tap."""
        ...

    def load(self) -> None:
        """Load now what the first fault would need."""
        ...


class FaultObjects:
    """Faults of one bench as its node shows them.

    `time` gives virtual time, cycle, whether a run is on, and the time of its cycle 0, None before. `on_event` is
    called with events.
    """

    def __init__(self, time: Callable[[], tuple[int, int, bool, int | None]]) -> None:
        self.on_event: Callable[[FaultEvent], None] | None = None
        self.begun = 0
        """How many faults have begun so far."""
        self._time = time
        self._desk: FaultDesk | None = None
        self._results: dict[int, str] = {}
        self._events: deque[FaultEvent] = deque(maxlen=objects.MOST_EVENTS)
        self._stops: deque[StopEvent] = deque(maxlen=MOST_STOPS)
        self._acting: list[tuple[str, str, str]] = []
        self._catalogue = ""
        self._packed = b""

    def prepare(self) -> None:
        """Load and build now what would take several cycles of the wall clock later."""
        if self._desk is not None:
            self._desk.load()
        self.packed_catalogue()

    def attach(self, desk: FaultDesk) -> None:
        """Let `desk` carry out the texts from now on."""
        self._desk = desk

    def note(self, event: FaultEvent) -> None:
        """A fault has begun or ended."""
        self._events.append(event)
        where = event.set_name, event.tap, event.fault
        if event.is_begin:
            self.begun += 1
            self._acting.append(where)
        elif where in self._acting:
            self._acting.remove(where)
        if self.on_event is not None:
            self.on_event(event)

    def note_stop(self, is_on: bool) -> None:
        """The emergency stop was pressed or released."""
        time_ns, cycle, _, _ = self._time()
        self._stops.append(StopEvent(time_ns, cycle, is_on))

    @property
    def active(self) -> int:
        """How many faults act now, 255 for more."""
        return min(len(self._acting), U8)

    def write(self, data: bytes, channel: int) -> None:
        """Carry out the text `data`. Raises `SdoRefused`; the reason is in `result`."""
        try:
            script = parse_faults(data.decode("utf-8-sig"), SOURCE)
            if self._desk is None:
                raise FaultError(NO_FAULTS)
            done = self._desk.inject(script)
        # Whatever goes wrong ends this text, never the bench.
        except Exception as error:
            if isinstance(error, FaultError):
                reason = str(error)
            elif isinstance(error, UnicodeDecodeError):
                reason = f"{SOURCE}: is not UTF-8: {error}"
            else:
                _log.debug("a fault set that cannot be done: %r", data[:LONGEST_RESULT], exc_info=True)
                reason = f"{SOURCE}: cannot be done ({type(error).__name__}); please report this"
            self._results[channel] = f"refused: {reason}"[:LONGEST_RESULT]
            raise SdoRefused(AbortCode.INVALID_VALUE) from None
        self._results[channel] = done[:LONGEST_RESULT]

    def forget(self, channel: int) -> None:
        """The channel has a new client: drop the last result."""
        self._results.pop(channel, None)

    def result(self, channel: int) -> str:
        """The result of the last text on `channel`."""
        return _ascii(self._results.get(channel, NOTHING_YET))

    def status(self) -> str:
        """Sets with state and activations, active faults, how many have begun; time, cycle, whether a run is on, when
        its cycle 0 was; the last emergency stops.
        """
        time_ns, cycle, is_running, begin_ns = self._time()
        return _json(
            {
                "time_ns": time_ns,
                "cycle": cycle,
                "running": is_running,
                "begin_ns": begin_ns,
                "begun": self.begun,
                "sets": [] if self._desk is None else self._desk.plain_sets(),
                "active": [{"set": name, "tap": tap, "fault": fault} for name, tap, fault in self._acting],
                "stops": [stop_as_plain(each) for each in self._stops],
            }
        )

    def events(self) -> str:
        """The last beginnings and ends of faults, oldest first, one per line."""
        return "".join(_json(event_as_plain(event)) + "\n" for event in self._events) or NO_LINES

    def packed_events(self) -> bytes:
        """The events packed with zlib."""
        return zlib.compress(self.events().encode(), 1)

    def catalogue(self) -> str:
        """What can be injected where. Made at the first call."""
        if not self._catalogue:
            self._catalogue = _json([] if self._desk is None else self._desk.plain_catalogue())
        return self._catalogue

    def packed_catalogue(self) -> bytes:
        """The catalogue packed with zlib: 8 kB instead of 110 kB."""
        if not self._packed:
            self._packed = zlib.compress(self.catalogue().encode(), 9)
        return self._packed


def event_text(event: FaultEvent) -> str:
    """The event as a readable line."""
    verb = "begins" if event.is_begin else "ends"
    when = f"cycle {event.cycle}" if event.cycle >= 0 else "before the first cycle"
    failure = f", {event.failure}" if event.failure else ""
    return f"fault {verb}: {event.label}, {when}, {event.time_s:.4f} s{failure}"


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def _ascii(text: str) -> str:
    return text.encode("ascii", "backslashreplace").decode("ascii")
