"""Faults of the bench's time: how long the world's cycle is while the controller's count goes on."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError

NOMINAL_NS, BEGIN, CYCLES = 2_500_000, 40, 80

Drive = Callable[..., Any]
FaultText = Callable[..., str]


def lengths(run: Any, count: int = CYCLES) -> list[int]:
    """Length `n` is the time from SYNC `n` to the next one."""
    times = [record.time_ns for record in run.cycles(count) if record.frame.can_id == 0x80]
    return [after - before for before, after in pairwise(times)]


@pytest.mark.parametrize("fault", ["clock-drift", "late-sync", "jitter"])
def test_on_the_wall_clock_it_is_refused(drive: Drive, fault_text: FaultText, fault: str) -> None:
    with pytest.raises(FaultError, match="--clock sync"):
        drive(fault_text("bench.clock", fault), Clock.WALL)


def test_drift_stretches_every_cycle_from_the_first_on(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("bench.clock", "clock-drift", duration=20 * 0.0025, rate=4.0))
    stretched = 2_600_000
    found = lengths(run)
    assert found[:BEGIN] == [NOMINAL_NS] * BEGIN
    ended = found.index(NOMINAL_NS, BEGIN)
    assert set(found[BEGIN:ended]) == {stretched}
    assert ended - BEGIN == 20  # 19.2 long cycles last 50 ms
    assert set(found[ended:]) == {NOMINAL_NS}
    assert run.is_sound


def test_late_sync_is_late_once(drive: Drive, fault_text: FaultText) -> None:
    found = lengths(drive(fault_text("bench.clock", "late-sync", delay=5.0, duration=0.1)))
    assert [(number, length) for number, length in enumerate(found) if length != NOMINAL_NS] == [(BEGIN, 7_500_000)]


def test_a_sync_that_is_a_second_late_finds_cards_that_have_protected_themselves(
    drive: Drive, fault_text: FaultText
) -> None:
    run = drive(fault_text("bench.clock", "late-sync", delay=1000, duration=None))
    run.cycles(BEGIN + 2)
    assert run.joints[-1][0].command_a == 0.0
    lost = [(record.time_ns, record.frame.data[:2]) for record in run.log if record.frame.can_id == 0x92]
    assert lost[0][1] == b"\x30\x81"
    assert lost[0][0] < 220_000_000


def test_jitter_keeps_every_sync_within_its_amplitude_of_the_grid(drive: Drive, fault_text: FaultText) -> None:
    """konkuk1's scan takes 0.6 ms of the 1.5 ms that are left at least."""
    run = drive(fault_text("bench.clock", "jitter", at=0.0, duration=None, amplitude=0.5))
    times = [record.time_ns for record in run.cycles(200) if record.frame.can_id == 0x80]
    off_grid = [time_ns - number * NOMINAL_NS for number, time_ns in enumerate(times)]
    assert max(map(abs, off_grid)) <= 500_000
    assert max(off_grid) > 400_000
    assert min(off_grid) < -400_000


def test_the_same_seed_jitters_alike_and_another_otherwise(drive: Drive, fault_text: FaultText) -> None:
    text = fault_text("bench.clock", "jitter")
    one, again, other = (lengths(drive(text, seed=seed)) for seed in (1, 1, 2))
    assert one == again
    assert one != other


def test_cycles_that_would_be_over_before_the_scan_wait_for_it(drive: Drive, fault_text: FaultText) -> None:
    both = fault_text("bench.clock", "clock-drift", 0.0, None, rate=-50) * 2
    run = drive("parallel = true\n" + both)
    assert set(lengths(run)) == {625_000}
    run = drive("parallel = true\n" + both + fault_text("bench.clock", "clock-drift", 0.0, None, rate=-50))
    assert set(lengths(run)) == {600_000}
    assert run.stamps_never_go_back


def test_of_two_equal_faults_the_one_that_is_over_ends(drive: Drive, fault_text: FaultText) -> None:
    short, long = (fault_text("bench.clock", "clock-drift", 0.1, duration, rate=100) for duration in (0.02, 0.05))
    found = lengths(drive("parallel = true\n" + short + long))
    assert found[BEGIN : BEGIN + 10] == [10_000_000] * 2 + [5_000_000] * 6 + [NOMINAL_NS] * 2
