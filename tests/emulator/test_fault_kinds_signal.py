"""Faults of a signal: each on a tachometer of 0 to 5 V, sampled every 2.5 ms, against its definition."""

import statistics
from collections.abc import Callable

import pytest

from canarm_emulator.faults.declaration import SignalFault

MS, CYCLE_NS = 1_000_000, 2_500_000
TAP = "joint2.tachometer"
Begin = Callable[..., SignalFault]


def series(fault: SignalFault, count: int, value: float = 2.5) -> list[float]:
    """A constant under the fault, sampled once per cycle from the fault's beginning."""
    return [fault.apply(value, k * CYCLE_NS) for k in range(count)]


def test_stuck_keeps_what_was_there_when_it_began(begin: Begin) -> None:
    fault = begin(TAP, "stuck")
    assert [fault.apply(value, 0) for value in (3.1, 0.2, 4.9)] == [3.1, 3.1, 3.1]


def test_stuck_takes_the_value_it_is_given(begin: Begin) -> None:
    fault = begin(TAP, "stuck", value=1.5)
    assert [fault.apply(value, 0) for value in (3.1, 0.2)] == [1.5, 1.5]


def test_an_offset_is_a_tenth_of_the_range_unless_given(begin: Begin) -> None:
    assert begin(TAP, "offset").apply(2.0, 0) == 2.5
    assert begin(TAP, "offset", value=-0.3).apply(2.0, 0) == 1.7


def test_a_gain_acts_about_zero_unless_told_otherwise(begin: Begin) -> None:
    assert begin(TAP, "gain", factor=1.5).apply(2.0, 0) == 3.0


def test_a_tachometer_that_stands_still_does_so_with_a_gain_about_its_middle(begin: Begin) -> None:
    fault = begin(TAP, "gain", factor=-1.0, about=2.5)
    assert [fault.apply(value, 0) for value in (2.5, 3.0, 0.0)] == [2.5, 2.0, 5.0]


def test_a_drift_of_half_a_volt_a_second_is_50_millivolts_after_100_ms(begin: Begin) -> None:
    fault = begin(TAP, "drift", now_ns=7 * MS, rate=0.5)
    assert fault.apply(2.0, 7 * MS) == 2.0
    assert fault.apply(2.0, 107 * MS) == pytest.approx(2.05)


def test_noise_has_its_standard_deviation_and_no_mean(begin: Begin) -> None:
    values = series(begin(TAP, "noise", deviation=0.2), 4000)
    assert statistics.fmean(values) == pytest.approx(2.5, abs=4 * 0.2 / 4000**0.5)
    assert statistics.stdev(values) == pytest.approx(0.2, rel=4 / (2 * 4000) ** 0.5)


def test_noise_is_white(begin: Begin) -> None:
    noise = [value - 2.5 for value in series(begin(TAP, "noise", deviation=1.0), 4000)]
    assert abs(statistics.correlation(noise, noise[1:] + noise[:1])) < 4 / 4000**0.5


def test_noise_depends_on_its_seed_alone(begin: Begin) -> None:
    runs = [series(begin(TAP, "noise", seed=seed), 20) for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_noise_of_one_instant_is_one_value(begin: Begin) -> None:
    fault = begin(TAP, "noise")
    assert fault.apply(2.5, CYCLE_NS) == fault.apply(2.5, CYCLE_NS) != fault.apply(2.5, 2 * CYCLE_NS)


def test_a_spike_is_one_sample_wide_and_comes_every_interval(begin: Begin) -> None:
    values = series(begin(TAP, "spike", height=1.0, interval=0.1), 100)
    assert [k for k, value in enumerate(values) if value == 3.5] == [0, 40, 80]
    assert values.count(2.5) == 97


def test_spikes_that_nobody_samples_are_not_made_up_for(begin: Begin) -> None:
    fault = begin(TAP, "spike", height=1.0, interval=0.1)
    times_ns = [0, 350 * MS, 353 * MS, 398 * MS, 400 * MS]
    assert [fault.apply(2.5, now_ns) for now_ns in times_ns] == [3.5, 3.5, 2.5, 2.5, 3.5]


def test_saturated_is_clipped_at_both_ends(begin: Begin) -> None:
    fault = begin(TAP, "saturated", low=1.0, high=4.0)
    assert [fault.apply(value, 0) for value in (0.5, 2.0, 4.5)] == [1.0, 2.0, 4.0]


def test_saturated_rises_no_further_than_it_was_unless_given(begin: Begin) -> None:
    fault = begin(TAP, "saturated")
    assert [fault.apply(value, 0) for value in (2.0, 3.0, 1.0)] == [2.0, 2.0, 1.0]


def test_dropout_leaves_nothing_of_the_signal(begin: Begin) -> None:
    assert series(begin(TAP, "dropout"), 3) == [0.0, 0.0, 0.0]
    assert series(begin(TAP, "dropout", value=5.0), 1) == [5.0]


def test_delayed_by_50_ms_is_20_cycles_late(begin: Begin) -> None:
    fault = begin(TAP, "delayed", delay=0.05)
    values = [fault.apply(float(k), k * CYCLE_NS) for k in range(100)]
    assert values == [0.0] * 20 + [float(k) for k in range(80)]


def test_delayed_passes_on_the_last_value_of_an_instant(begin: Begin) -> None:
    fault = begin("joint2.dac.code", "delayed", delay=0.0025)
    for value in (0x00, 0x0F, 0xFF):
        fault.apply(value, 0)
    assert fault.apply(0x10, CYCLE_NS) == 0xFF


def test_a_delay_of_nothing_changes_nothing(begin: Begin) -> None:
    fault = begin(TAP, "delayed", delay=0.0)
    assert [fault.apply(float(k), k * CYCLE_NS) for k in range(5)] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_intermittent_is_gone_for_its_duty_and_back_for_the_rest(begin: Begin) -> None:
    values = series(begin(TAP, "intermittent", duty=0.25, frequency=10.0), 80)
    assert values == 2 * (10 * [0.0] + 30 * [2.5])


def test_intermittent_puts_its_own_value_in_place(begin: Begin) -> None:
    assert series(begin(TAP, "intermittent", value=5.0), 21)[::20] == [5.0, 2.5]


@pytest.mark.parametrize(("name", "bits"), [("stuck", 2), ("dropout", 0), ("intermittent", 0), ("delayed", 2)])
def test_direction_bits_can_stick_vanish_and_come_late(begin: Begin, name: str, bits: int) -> None:
    fault = begin("joint2.latch", name)
    fault.apply(2, 0)
    assert fault.apply(1, CYCLE_NS) == bits
