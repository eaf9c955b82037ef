"""All events of a dashboard in one order, put together anew only when there are other ones, and not too often."""

from collections.abc import Iterable

from .events import Happening, happenings
from .faults import Faults
from .notices import Notice, Noticing

GATHER_NS = 200_000_000
"""Least time between two gatherings for notices alone: a bus may have thousands a second."""


class Gathered:
    """Newest first: `all_of_them`, and those `of_bench` alone."""

    def __init__(self) -> None:
        self.all_of_them: tuple[Happening, ...] = ()
        self.of_bench: tuple[Happening, ...] = ()
        self._faults: Faults | None = None
        self._versions: tuple[int, ...] = ()
        self._at_ns = 0

    def gather(self, faults: Faults | None, noticing: Iterable[Noticing], now_ns: int) -> None:
        """Take what has been read from the bench, and what was noticed on buses, at the wall time `now_ns`."""
        noticing = tuple(noticing)
        versions = tuple(each.version for each in noticing)
        is_other = faults is not self._faults
        is_due = versions != self._versions and not 0 <= now_ns - self._at_ns < GATHER_NS
        if is_other or is_due:
            self._faults, self._versions, self._at_ns = faults, versions, now_ns
            noticed = (notice for each in noticing for notice in each.kept)
            self.all_of_them = happenings(faults or Faults(), noticed)
            self.of_bench = tuple(each for each in self.all_of_them if not isinstance(each.event, Notice))
