"""Deadlines and how they are kept, on a clock that the test moves."""

import pytest

from canarm_controller.run.pacing import Pacer

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


@pytest.mark.parametrize(("delay_ns", "stalls"), [(100_000_000, 0), (100_000_001, 1), (180_000_000_000, 1)])
def test_a_delay_longer_than_the_cards_wait_is_a_stall_whatever_its_length(
    clock: FakeClock, delay_ns: int, stalls: int
) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    clock.now_ns += delay_ns
    pacer.begin()
    assert (pacer.stalls, pacer.late, pacer.missed) == (stalls, 1, delay_ns // PERIOD_NS)
    clock.now_ns = pacer.next_ns
    pacer.begin()
    assert (pacer.stalls, pacer.late) == (stalls, 1)


def test_an_early_start_is_not_late(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    pacer.begin()
    pacer.begin()
    assert (pacer.late, pacer.missed, pacer.lateness.max_ns) == (0, 0, 0)


def test_jitter_is_how_far_an_interval_is_from_the_period_to_either_side(clock: FakeClock) -> None:
    """One SYNC 400 µs late: the interval before it is 400 µs too long, the one after it too short."""
    pacer = Pacer(PERIOD_NS, clock)
    for delay_ns in (0, 0, 400_000, 0):
        clock.now_ns = pacer.next_ns + delay_ns
        pacer.begin()
    assert pacer.jitter.summary()["histogram"] == {"from_us": [0, 400], "count": [1, 2]}
    assert pacer.lateness.summary()["histogram"] == {"from_us": [0, 400], "count": [3, 1]}


def test_a_constant_delay_is_lateness_and_no_jitter(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    for _ in range(100):
        clock.now_ns = pacer.next_ns + 70_000
        pacer.begin()
    assert (pacer.lateness.max_ns, pacer.jitter.max_ns) == (70_000, 0)
    assert (pacer.lateness.count, pacer.jitter.count) == (100, 99)


def test_a_cycle_is_split_where_its_inputs_are_complete(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    pacer.begin()
    inputs_ns = clock.now_ns + 650_000
    clock.now_ns += 770_000
    pacer.controlled(inputs_ns)
    summary = pacer.summary()
    assert (summary["answer"]["max_us"], summary["computing"]["max_us"]) == (650.0, 120.0)


def test_the_summary_says_everything_in_microseconds(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    pacer.begin()
    clock.now_ns += 5_300_000
    pacer.begin()
    summary = pacer.summary()
    counts = {name: value for name, value in summary.items() if not isinstance(value, dict)}
    assert counts == {"period_us": 2500.0, "late": 1, "left_out": 1, "stalls": 0}
    assert summary["lateness"]["max_us"] == summary["jitter"]["max_us"] == 2800.0


def test_deadlines_of_a_safe_stop_are_neither_late_nor_left_out(clock: FakeClock) -> None:
    pacer = Pacer(PERIOD_NS, clock)
    clock.now_ns += 200_000_000
    pacer.begin(counts=False)
    assert (pacer.late, pacer.missed, pacer.stalls) == (0, 0, 0)
    assert pacer.left_s() == pytest.approx(PERIOD_NS * 1e-9)  # the grid goes on all the same
