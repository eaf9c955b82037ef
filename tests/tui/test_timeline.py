"""What keys make of the stretch that the traces show: 48 000 cycles are kept, 4 000 are looked at."""

import pytest

from canarm_tui.timeline import SHORTEST_CYCLES, Extent, Timeline

KEPT = Extent(1000, 49_000)
TIMELINE = Timeline(span=4000)


def test_it_follows_the_newest_until_one_scrolls_back_and_again_at_the_end():
    assert TIMELINE.bounds(KEPT) == (45_001, 49_000)
    back = TIMELINE.scrolled(KEPT, -1)
    assert back.bounds(KEPT) == (43_001, 47_000)
    assert back.bounds(Extent(2000, 50_000)) == (43_001, 47_000), "it stands while the run goes on"
    assert back.scrolled(KEPT, 1).end is None
    assert back.following() == TIMELINE


def test_nothing_is_looked_at_that_is_not_kept():
    assert TIMELINE.scrolled(KEPT, -100).bounds(KEPT) == (1000, 4999)
    assert TIMELINE.oldest(KEPT).bounds(KEPT) == (1000, 4999)
    short = Extent(0, 100)
    assert TIMELINE.scrolled(short, -1).end is None, "there is less than one stretch"
    assert TIMELINE.oldest(short).end is None


def test_closer_and_further_have_ends():
    near = TIMELINE
    for _ in range(20):
        near = near.zoomed(KEPT, True)
    assert near.span == SHORTEST_CYCLES
    for _ in range(20):
        near = near.zoomed(KEPT, False)
    assert near.span == 48_001


def test_the_cursor_stays_where_it_is_on_the_screen_when_one_comes_closer():
    pointed = TIMELINE.pointed(KEPT, 46_000)
    closer = pointed.zoomed(KEPT, True)
    first, last = closer.bounds(KEPT)
    assert (46_000 - first) / (last - first) == pytest.approx(999 / 3999, abs=0.01)
    assert closer.cursor == 46_000


def test_the_cursor_takes_the_stretch_along_over_its_end_and_goes_no_further_than_what_is_kept():
    at = TIMELINE.pointed(KEPT, 45_010).moved(KEPT, -1)
    assert (at.cursor, at.bounds(KEPT)) == (44_970, (44_970, 48_969))
    assert at.moved(KEPT, -10_000).cursor == 1000
    end = at.moved(KEPT, 10_000)
    assert (end.cursor, end.bounds(KEPT)[1]) == (49_000, 49_000)
    assert end.end == 49_000, "with a cursor it does not go on by itself"


def test_an_event_is_shown_in_the_middle():
    at = TIMELINE.at(KEPT, 20_000)
    assert (at.cursor, at.bounds(KEPT)) == (20_000, (18_001, 22_000))
    assert TIMELINE.at(KEPT, 0).bounds(KEPT) == (1000, 4999), "it happened before what is kept"


def test_the_cursor_comes_in_the_middle_and_goes():
    on = TIMELINE.with_cursor(KEPT)
    assert on.cursor == 47_000
    assert on.with_cursor(KEPT).cursor is None
    assert TIMELINE.moved(KEPT, 3) == TIMELINE, "there is none to move"
