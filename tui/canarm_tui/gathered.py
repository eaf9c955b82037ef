"""All events of a dashboard in one order, put together anew only when there are other ones, and not too often.

Those of runs that are over are kept, also when the bench that remembered them is gone.
"""

from collections.abc import Iterable

from .events import Happening, happenings
from .faults import Faults
from .notices import Notice, Notices, Noticing

GATHER_NS = 200_000_000
"""Least time between two gatherings for notices alone: a bus may have thousands a second."""
MOST_PAST = 2000
"""Events of runs that are over."""


class Gathered:
    """Newest first: `all_of_them`, one run after the other, and those `of_bench` of the present run alone."""

    def __init__(self) -> None:
        self.all_of_them: tuple[Happening, ...] = ()
        self.of_bench: tuple[Happening, ...] = ()
        self._past: tuple[Happening, ...] = ()
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
            present = happenings(faults or Faults(), noticed)
            self.all_of_them = present + self._past
            self.of_bench = tuple(each for each in present if not isinstance(each.event, Notice))

    def end_run(self, number: int, faults: Faults | None, noticing: Iterable[Noticing]) -> None:
        """The run of this number is over, and its bench gone: what has happened is kept, and notices begin anew."""
        noticing = tuple(noticing)
        present = happenings(faults or Faults(), (notice for each in noticing for notice in each.kept))
        ended = (each if each.is_earlier else each._replace(is_earlier=True, run=number) for each in present)
        self._past = (*ended, *self._past)[:MOST_PAST]
        self.all_of_them, self.of_bench, self._faults, self._versions = self._past, (), None, ()
        for each in noticing:
            if isinstance(each, Notices):
                each.clear()
