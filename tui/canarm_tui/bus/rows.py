"""What is remembered of one kind of frame: its identifier, how many, how often, the newest data and what changed.

Plain values in a mutable row, for the store alone; what is drawn is the frozen `RowNow`.
"""

from typing import NamedTuple

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.decoding.decoder import NOTHING
from canarm_protocol.decoding.sdo_texts import About

RATE_NS = 1_000_000_000
"""Rates are those of the last full interval of this length, of the bus's time."""
Key = tuple[int, bool, bool]
"""Identifier, whether it has 29 bits, whether it is of a remote frame."""


class RowNow(NamedTuple):
    """A row as it was when the picture was taken. Times are in ns; `wall_ns` is when it was last heard.

    `changed` has a bit for each bit of the data that differs from those of the frame before.
    """

    key: Key
    frame: Frame
    about: About
    times: int
    rate_hz: float
    period_ns: int | None
    changed: int
    changed_wall_ns: int
    wall_ns: int


class Row:
    """One kind of frame."""

    __slots__ = (
        "about", "before_ns", "bits", "changed", "changed_wall_ns", "count", "frame", "is_followed", "is_steady", "key",
        "last_ns", "mark_count", "mark_ns", "period_ns", "rate_hz", "time_ns", "wall_ns",
    )  # fmt: skip

    def __init__(self, key: Key, frame: Frame, time_ns: int) -> None:
        self.key, self.frame, self.about = key, frame, NOTHING
        self.count = 0
        self.is_followed = False
        """Whether the store looks at every frame of this row: heartbeats, EMCY, SDO."""
        self.bits = 0
        """Length on the wire of one of the last frames."""
        self.changed = self.changed_wall_ns = 0
        self.time_ns = self.before_ns = self.mark_ns = self.last_ns = time_ns
        self.mark_count = 1
        self.is_steady = True
        """Whether frames came in the interval before the present one: the last of them was at `last_ns`."""
        self.wall_ns = 0
        self.rate_hz = 0.0
        self.period_ns: int | None = None

    def differs(self, data: bytes, wall_ns: int) -> None:
        """Note which bits `data` changes."""
        before = self.frame.data
        changed = int.from_bytes(before, "little") ^ int.from_bytes(data, "little")
        shorter, longer = sorted((len(before), len(data)))
        self.changed = changed | ((1 << 8 * longer) - (1 << 8 * shorter))
        self.changed_wall_ns = wall_ns

    def close_interval(self, bus_ns: int) -> None:
        """Work out rate and period if an interval is over at the bus's time `bus_ns`."""
        lasted_ns = bus_ns - self.mark_ns
        if lasted_ns < 0:  # the bus's clock was set back
            self.mark_ns, self.mark_count, self.is_steady = bus_ns, self.count, False
        elif lasted_ns >= RATE_NS:
            count = self.count - self.mark_count
            if count == 1 and self.time_ns > self.before_ns:
                self.period_ns = self.time_ns - self.before_ns
            elif count > 1 and self.is_steady:
                self.period_ns = (self.time_ns - self.last_ns) // count
            self.rate_hz, self.is_steady = count * 1e9 / lasted_ns, count > 0
            self.mark_ns, self.mark_count, self.last_ns = bus_ns, self.count, self.time_ns

    def now(self) -> RowNow:
        """The row as it is."""
        return RowNow(
            *(self.key, self.frame, self.about, self.count, self.rate_hz, self.period_ns),
            *(self.changed, self.changed_wall_ns, self.wall_ns),
        )
