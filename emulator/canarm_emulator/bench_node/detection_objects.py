"""The bench node's detection objects: what controllers have detected, for every client of the bench.

A controller sends each detection in pieces; what it means is not known here.
"""

import json
import zlib
from collections import deque
from collections.abc import Callable

from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.faults.detection_events import DetectionEvent, Pieces, detection_as_plain

from .fault_objects import NO_LINES

U16 = 0xFFFF


class DetectionObjects:
    """The last detections, oldest first, across controllers. `now_ns` gives virtual time."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._pieces = Pieces()
        self._events: deque[DetectionEvent] = deque(maxlen=objects.MOST_EVENTS)
        self._count = 0

    def take(self, piece: int) -> None:
        """The next eight bytes of a detection have come."""
        event = self._pieces.take(int(piece))
        if event is not None:
            self._events.append(event._replace(time_ns=self._now_ns()))
            self._count += 1

    @property
    def count(self) -> int:
        """How many have come so far, 65535 for more."""
        return min(self._count, U16)

    @property
    def broken(self) -> int:
        """How many could not be put together, 65535 for more."""
        return min(self._pieces.broken, U16)

    def events(self) -> str:
        """The last detections, one per line."""
        lines = (json.dumps(detection_as_plain(event), separators=(",", ":")) for event in self._events)
        return "".join(f"{line}\n" for line in lines) or NO_LINES

    def packed_events(self) -> bytes:
        """The detections packed with zlib."""
        return zlib.compress(self.events().encode(), 1)
