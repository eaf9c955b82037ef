"""A rig's memory of the frames on the robot's bus.

What the frames say is not known here.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

from canarm_emulator.bus_record import Record
from canarm_protocol.canopen.frames import Frame

FIELDS = 1 + len(Frame._fields)


class StampedFrame(NamedTuple):
    """A frame of the robot's bus with its virtual time."""

    time_ns: int
    frame: Frame


class KeptFrames:
    """The last `size` frames; all with None.

    Field by field, one after the other: tuples that are kept would all be visited again and again by the collector of
    cyclic garbage, which took a tenth of the cycles of a short run.
    """

    def __init__(self, size: int | None) -> None:
        self._fields: deque[Any] = deque(maxlen=None if size is None else FIELDS * size)

    def take(self, records: Sequence[Record]) -> None:
        """Keep the frames of `records`."""
        append, extend = self._fields.append, self._fields.extend
        for time_ns, frame, _ in records:
            append(time_ns)
            extend(frame)

    def stamped(self) -> list[StampedFrame]:
        """What is kept, oldest first."""
        fields = iter(self._fields)
        rows = zip(*[fields] * FIELDS, strict=True)
        return [StampedFrame(time_ns, Frame(*frame)) for time_ns, *frame in rows]
