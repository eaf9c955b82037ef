"""Which stretch of a run the traces show, and where the cursor stands: a frozen value and what keys make of it.

Counted in cycles. Nothing is drawn here.
"""

from dataclasses import dataclass, replace
from typing import Self

SHORTEST_CYCLES = 40
"""A tenth of a second at 400 Hz."""
ZOOM = 2
PAGE = 0.5
"""Share of the stretch by which an arrow scrolls."""
CURSOR_STEPS = 100
"""Steps of the cursor from one end of the stretch to the other."""


@dataclass(frozen=True, slots=True)
class Extent:
    """First and last cycle that are kept."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Timeline:
    """`span` cycles up to the cycle `end`; None follows the newest. `cursor` is a cycle, None without one."""

    span: int
    end: int | None = None
    cursor: int | None = None

    def bounds(self, extent: Extent) -> tuple[int, int]:
        """First and last cycle of the stretch."""
        last = extent.last if self.end is None else self.end
        return last - self.span + 1, last

    def zoomed(self, extent: Extent, is_in: bool) -> Self:
        """Half or twice as much, about the cursor if there is one, up to what is kept."""
        longest = max(SHORTEST_CYCLES, extent.last - extent.first + 1, self.span if is_in else 0)
        span = max(SHORTEST_CYCLES, self.span // ZOOM) if is_in else min(max(longest, self.span), self.span * ZOOM)
        if self.cursor is None:
            return replace(self, span=span)
        first, _ = self.bounds(extent)
        share = (self.cursor - first) / self.span
        return self._ending(self.cursor + round((1.0 - share) * span), extent, span)

    def scrolled(self, extent: Extent, pages: float) -> Self:
        """So many pages later, or earlier if negative."""
        _, last = self.bounds(extent)
        return self._ending(last + round(pages * PAGE * self.span), extent, self.span)

    def at(self, extent: Extent, cycle: int) -> Self:
        """The cursor on `cycle`, which is in the middle unless an end of what is kept is near."""
        cycle = min(max(cycle, extent.first), extent.last)
        return replace(self._ending(cycle + self.span // 2, extent, self.span), cursor=cycle)

    def pointed(self, extent: Extent, cycle: int) -> Self:
        """The cursor on `cycle`, and the stretch as it stands."""
        _, last = self.bounds(extent)
        return replace(self, end=last, cursor=min(max(cycle, extent.first), extent.last))

    def moved(self, extent: Extent, steps: int) -> Self:
        """The cursor some steps later or earlier; the stretch follows it over its ends."""
        if self.cursor is None:
            return self
        cursor = self.cursor + steps * max(1, self.span // CURSOR_STEPS)
        cursor = min(max(cursor, extent.first), extent.last)
        first, last = self.bounds(extent)
        shifted = min(cursor - first, 0) + max(cursor - last, 0)
        return replace(self._ending(last + shifted, extent, self.span, may_follow=False), cursor=cursor)

    def with_cursor(self, extent: Extent) -> Self:
        """A cursor in the middle, and the stretch stands; or none, if there was one."""
        if self.cursor is not None:
            return replace(self, cursor=None)
        first, last = self.bounds(extent)
        return self.pointed(extent, (first + last) // 2)

    def oldest(self, extent: Extent) -> Self:
        """The beginning of what is kept."""
        return self._ending(extent.first + self.span - 1, extent, self.span)

    def following(self) -> Self:
        """The newest, and whatever comes."""
        return replace(self, end=None, cursor=None)

    def _ending(self, end: int, extent: Extent, span: int, may_follow: bool = True) -> Self:
        end = max(end, min(extent.first + span - 1, extent.last))
        if end >= extent.last:
            is_following = may_follow and self.cursor is None
            return replace(self, span=span, end=None if is_following else extent.last)
        return replace(self, span=span, end=end)
