"""Arrival of SYNC as the emulator counts it, at times that the test chooses."""

import pytest

from canarm_emulator.serving.sync_intervals import SyncIntervals

PERIOD_NS = 2_500_000


def after(*intervals_ns: int) -> SyncIntervals:
    intervals, now_ns = SyncIntervals(PERIOD_NS), 7_000_000
    intervals.note(now_ns)
    for interval_ns in intervals_ns:
        now_ns += interval_ns
        intervals.note(now_ns)
    return intervals


def test_the_first_sync_has_no_interval() -> None:
    assert (after().count, after().jitter.count) == (1, 0)


def test_jitter_is_the_distance_from_the_period_to_either_side() -> None:
    intervals = after(PERIOD_NS, PERIOD_NS + 400_000, PERIOD_NS - 400_000)
    assert intervals.summary()["jitter"]["histogram"] == {"from_us": [0, 400], "count": [1, 2]}
    assert (intervals.count, intervals.gaps, intervals.pauses) == (4, 0, 0)


@pytest.mark.parametrize(
    ("interval_ns", "gaps"), [(1, 0), (3_749_999, 0), (3_750_000, 1), (5_000_000, 1), (27_500_000, 10)]
)
def test_gaps_are_the_syncs_that_would_have_fitted(interval_ns: int, gaps: int) -> None:
    intervals = after(interval_ns)
    assert (intervals.gaps, intervals.jitter.count) == (gaps, 1)


@pytest.mark.parametrize(("silence_ns", "pauses"), [(1_000_000_000, 0), (1_000_000_001, 1), (180_000_000_000, 1)])
def test_a_long_silence_is_a_pause_and_neither_jitter_nor_gaps(silence_ns: int, pauses: int) -> None:
    intervals = after(PERIOD_NS, silence_ns, PERIOD_NS)
    assert (intervals.pauses, intervals.jitter.count) == (pauses, 3 - pauses)
    assert (intervals.gaps == 0) is bool(pauses)


def test_another_sender_begins_anew() -> None:
    intervals = after(PERIOD_NS)
    intervals.begin()
    intervals.note(50_000_000)
    intervals.note(50_000_000 + PERIOD_NS)
    summary = intervals.summary()
    assert (summary["syncs"], summary["gaps"], summary["jitter"]["count"]) == (4, 0, 2)
    assert summary["jitter"]["max_us"] == 0.0
