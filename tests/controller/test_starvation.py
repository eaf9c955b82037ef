"""Which want of computing time is named, and what it can explain. Cycles are of 2.5 ms."""

import pytest

from canarm_controller.run.starvation import Starvation, explains, long_law

MS = 1_000_000


@pytest.mark.parametrize(("cycles", "is_starved"), [(15, False), (16, True)])
def test_sixteen_cycles_within_a_second_are_starvation(cycles: int, is_starved: bool) -> None:
    starvation = Starvation(2_500_000)
    for cycle in range(cycles):
        starvation.left_out(cycle * 60 * MS, 1)
    assert (starvation.cause(950 * MS) is not None) == is_starved


def test_what_was_lost_long_ago_explains_nothing_any_more() -> None:
    starvation = Starvation(2_500_000)
    starvation.left_out(0, 1200)
    assert starvation.cause(1000 * MS) is not None
    assert starvation.cause(1001 * MS) is None
    assert starvation.of_the_run(4000) is not None


def test_a_run_that_lost_one_cycle_in_a_thousand_is_not_called_starved() -> None:
    starvation = Starvation(2_500_000)
    for cycle in range(20):
        starvation.left_out(cycle * 2500 * MS, 1)
    assert starvation.of_the_run(20_000) is None


@pytest.mark.parametrize(
    ("law_ms", "named"),
    [(0.1, "this machine kept the controller waiting: "), (10, "the law took up to 10 ms a cycle: ")],
)
def test_the_law_is_named_when_the_time_was_the_laws(law_ms: float, named: str) -> None:
    starvation = Starvation(2_500_000)
    for cycle in range(6):
        starvation.law(round(law_ms * MS))
        starvation.left_out(cycle * 12 * MS, 4)
    cause = starvation.cause(72 * MS)
    assert cause is not None
    assert cause.startswith(f"{named}24 cycles of 2.5 ms were left out")


def test_in_lockstep_only_a_law_beyond_a_second_is_worth_a_word() -> None:
    assert long_law(999 * MS, 7) is None
    assert long_law(12_000 * MS, 7) == (
        "the law took 12 s in cycle 7, longer than others wait; --sync-timeout sets how long"
    )


@pytest.mark.parametrize(
    ("detector", "detail", "on_the_wall_clock", "in_lockstep"),
    [
        ("potentiometer-jump", "", True, False),
        ("both-sensors", "", True, False),
        ("card-emergency", "card 'dac' (node 0x12) reports error 0x8130", True, True),
        ("card-emergency", "card 'dac' (node 0x12) reports error 0x4210", False, False),
        ("card-state", "card 'dac' (node 0x12) is in PRE_OPERATIONAL, not OPERATIONAL", True, True),
        ("card-state", "card 'dac' (node 0x12) is in STOPPED, not OPERATIONAL", True, True),
        ("card-state", "card 'dac' (node 0x12) is in BOOT_UP, not OPERATIONAL", False, False),
        ("inputs-repeated", "", True, False),
        ("law-output", "", False, False),
        ("interrupted", "", False, False),
    ],
)
def test_starvation_explains_what_time_can_do_and_no_more(
    detector: str, detail: str, on_the_wall_clock: bool, in_lockstep: bool
) -> None:
    assert explains(detector, detail, is_lockstep=False) == on_the_wall_clock
    assert explains(detector, detail, is_lockstep=True) == in_lockstep
