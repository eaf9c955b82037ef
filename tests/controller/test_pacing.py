"""Deadlines and how they are kept, on a clock that the test moves."""

import numpy as np
import pytest

from canarm_controller.pacing import Lateness, Pacer

PERIOD_NS = 2_500_000


class FakeClock:
    """Nanoseconds that pass when the test says so."""

    def __init__(self) -> None:
        self.now_ns = 1_000

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


def test_deadlines_are_one_period_apart_however_late_each_is_kept(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    first_ns = pacer.next_ns
    for delay_ns in (0, 400_000, 2_000_000, 0, 2_400_000):
        clock.now_ns = pacer.next_ns + delay_ns
        pacer.begin()
    assert pacer.next_ns == first_ns + 5 * PERIOD_NS
    assert pacer.missed == 0


def test_left_counts_down_to_the_deadline_and_beyond(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    pacer.begin()
    assert pacer.left_s() == pytest.approx(0.0025)
    clock.now_ns += 3_500_000
    assert pacer.left_s() == pytest.approx(-0.001)


@pytest.mark.parametrize(("delay_ns", "late"), [(0, 0), (250_000, 0), (250_001, 1), (2_499_999, 1)])
def test_late_is_what_leaves_more_than_a_tenth_of_the_period_after_its_time(
    clock: FakeClock, delay_ns: int, late: int
) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    clock.now_ns += delay_ns
    pacer.begin()
    assert (pacer.late, pacer.missed) == (late, 0)


@pytest.mark.parametrize(("delay_ns", "missed"), [(2_499_999, 0), (2_500_000, 1), (26_000_000, 10)])
def test_a_stall_leaves_out_whole_periods_and_keeps_the_grid(clock: FakeClock, delay_ns: int, missed: int) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    start_ns = pacer.next_ns
    clock.now_ns += delay_ns
    pacer.begin()
    assert pacer.missed == missed
    assert (pacer.next_ns - start_ns) % PERIOD_NS == 0
    assert 0.0 < pacer.left_s() <= PERIOD_NS * 1e-9


def test_an_early_start_is_not_late(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    pacer.begin()
    pacer.begin()
    assert (pacer.late, pacer.missed, pacer.lateness.max_ns) == (0, 0, 0)


def test_percentiles_agree_with_numpy_to_a_bin() -> None:
    delays_ns = np.random.default_rng(0).exponential(300_000, 5000).astype(int)
    lateness = Lateness()
    for delay_ns in delays_ns.tolist():
        lateness.add(delay_ns)
    for percent in (1.0, 50.0, 99.0, 100.0):
        expected_us = np.percentile(delays_ns, percent, method="inverted_cdf") / 1000
        assert lateness.percentile_us(percent) == pytest.approx(expected_us, abs=10.0)
    assert lateness.summary()["max_us"] == delays_ns.max() / 1000


def test_delays_beyond_the_last_bin_count_and_keep_their_maximum() -> None:
    lateness = Lateness()
    for delay_ns in (5_000, 15_000_000, 80_000_000):
        lateness.add(delay_ns)
    assert lateness.summary() == {"median_us": pytest.approx(10_010), "p99_us": pytest.approx(10_010), "max_us": 80_000}
    assert (lateness.total, len(lateness.counts)) == (3, 1001)


def test_no_delays_have_no_percentiles() -> None:
    assert Lateness().summary() == {"median_us": 0.0, "p99_us": 0.0, "max_us": 0.0}
