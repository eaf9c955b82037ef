"""How busy a bus is: bits and frames a second over the last seconds, on the bus's own clock where that runs."""

from collections import deque
from typing import NamedTuple

WINDOW_NS = 2_000_000_000
_LEAST_NS = 200_000_000
"""Over less, a figure would say more of the drains than of the bus."""


class _Mark(NamedTuple):
    bus_ns: int
    wall_ns: int
    bits: int
    frames: int


class Load(NamedTuple):
    """Frames a second, and the share of the bit rate that is used (0 to 1; None where that is not known)."""

    frames_per_s: float | None = None
    share: float | None = None


class LoadMeter:
    """Marks of the last `WINDOW_NS` of wall time."""

    def __init__(self, bitrate: int | None) -> None:
        self._bitrate = bitrate
        self.follows_record = False
        """Whether only the bus's own clock counts, as of a record, which may stand still or play slowly."""
        self._marks: deque[_Mark] = deque(maxlen=256)
        self._has_heard = False

    def note(self, bus_ns: int, wall_ns: int, bits: int, frames: int) -> None:
        """So many bits and frames have come in all."""
        if self._marks and bus_ns < self._marks[-1].bus_ns:  # the bus's clock was set back
            self._marks.clear()
        self._has_heard = True
        self._marks.append(_Mark(bus_ns, wall_ns, bits, frames))

    def forget(self) -> None:
        """Begin anew."""
        self._marks.clear()
        self._has_heard = False

    def load(self, wall_ns: int) -> Load:
        """How busy it is at the wall time `wall_ns`; nothing has come for long: not at all."""
        if self.follows_record:
            while self._marks and self._marks[0].bus_ns < self._marks[-1].bus_ns - WINDOW_NS:
                self._marks.popleft()
        while not self.follows_record and self._marks and self._marks[0].wall_ns < wall_ns - WINDOW_NS:
            self._marks.popleft()
        if not self._marks and self._has_heard:
            return Load(0.0, None if self._bitrate is None else 0.0)
        if len(self._marks) < 2:
            return Load()
        first, last = self._marks[0], self._marks[-1]
        lasted_ns = last.bus_ns - first.bus_ns
        if lasted_ns < _LEAST_NS and not self.follows_record:
            lasted_ns = wall_ns - first.wall_ns
        if lasted_ns < _LEAST_NS:
            return Load()
        per_s = 1e9 / lasted_ns
        share = None if self._bitrate is None else (last.bits - first.bits) * per_s / self._bitrate
        return Load((last.frames - first.frames) * per_s, share)
