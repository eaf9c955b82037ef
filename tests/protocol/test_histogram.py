"""Durations in bins, against numpy on the durations themselves."""

import numpy as np
import pytest

from canarm_protocol.runs.histogram import Histogram


def filled(durations_ns: list[int]) -> Histogram:
    histogram = Histogram()
    for duration_ns in durations_ns:
        histogram.add(duration_ns)
    return histogram


@pytest.mark.parametrize("scale_ns", [20_000, 300_000, 40_000_000])
def test_percentiles_agree_with_numpy_to_a_bin(scale_ns: int) -> None:
    """A bin is 1 µs wide, or 1/32 of its value."""
    durations_ns = np.random.default_rng(0).exponential(scale_ns, 4999).astype(int)
    histogram = filled(durations_ns.tolist())
    for percent in (1.0, 50.0, 99.0, 99.9, 100.0):
        expected_us = np.percentile(durations_ns, percent, method="inverted_cdf") / 1000
        assert expected_us <= histogram.percentile_us(percent) <= max(expected_us + 1, expected_us * (1 + 1 / 32))
    assert histogram.summary()["max_us"] == durations_ns.max() / 1000


def test_the_bins_that_are_not_empty_come_as_columns_and_lose_nothing() -> None:
    durations_us = [0, 0, 63, 64, 65, 66, 1000, 180_000_000]
    table = filled([1000 * duration for duration in durations_us]).summary()["histogram"]
    assert table == {"from_us": [0, 63, 64, 66, 992, 176_160_768], "count": [2, 1, 2, 1, 1, 1]}
    # 1000 lies in [992, 1008), and three minutes in [42 · 2^22, 43 · 2^22).
    assert 176_160_768 == 42 << 22


def test_edges_of_bins_belong_to_the_bin_above() -> None:
    for power in range(6, 36):
        table = filled([1000 * 2**power - 1, 1000 * 2**power]).summary()["histogram"]
        assert table["count"] == [1, 1]
        assert table["from_us"][1] == 2**power


def test_what_is_longer_than_the_last_bin_still_counts() -> None:
    day_ns = 86_400_000_000_000
    summary = filled([5_000, day_ns]).summary()
    assert (summary["count"], summary["max_us"], summary["p99_us"]) == (2, day_ns / 1000, day_ns / 1000)
    assert summary["histogram"]["count"] == [1, 1]


def test_negative_durations_count_as_none() -> None:
    assert filled([-5_000, -1]).summary()["histogram"] == {"from_us": [0], "count": [2]}


def test_without_durations_every_figure_is_zero() -> None:
    summary = Histogram().summary()
    assert summary["histogram"] == {"from_us": [], "count": []}
    assert [summary[name] for name in ("count", "median_us", "p99_us", "p99_9_us", "max_us")] == [0, 0, 0, 0, 0]
