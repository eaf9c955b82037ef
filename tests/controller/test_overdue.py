"""When the next count of an encoder is overdue: by arithmetic of constant speed and of friction that stops a joint."""

import math
from collections.abc import Iterator

import pytest

from canarm_controller.dynamics import SeveralArms, cell_arm
from canarm_controller.supervision.nominal import JointNominal, joint_nominals
from canarm_controller.supervision.overdue import KNOWN_SHARE, LEAST_CYCLES, SURE_SHARE, OverdueCount, is_counted
from canarm_controller.supervision.tachless import sudden_rad
from canarm_controller.supervision.timing import Timing
from canarm_protocol.cell import load_cell

CELL = load_cell("rhino-pair")
ARM = cell_arm(CELL.laden, CELL.joint_names)
assert isinstance(ARM, SeveralArms)
ELBOW: JointNominal = joint_nominals(CELL, ARM.parts)[7]
T = CELL.bus.cycle_s
TIMING = Timing.of(T)
STEP = math.radians(1.0) / (524 * 6 / 360)  # 524:1, 6 periods a turn: the Mark III's 8.7 counts a degree
FRICTION = ELBOW.coulomb_nm * ELBOW.mobility_per_kg_m2[1]


def drive(count: OverdueCount, way: Iterator[tuple[float, float]]) -> float | None:
    """The time, s, at which a count is overdue of a joint that goes this way: true angle and reference."""
    for cycle, (true, reference) in enumerate(way):
        if count.step(STEP * math.floor(true / STEP), 0.0, 0.0, reference):
            return cycle * T
    return None


def jammed(counts_s: float, jam_s: float, until_s: float, begin: float = 0.0) -> Iterator[tuple[float, float]]:
    """Constant speed until the jam; the reference goes on."""
    for cycle in range(round(until_s / T)):
        reference = STEP * (begin + counts_s * cycle * T)
        yield STEP * (begin + counts_s * min(cycle * T, jam_s)), reference


def test_the_elbow_is_judged_by_its_counts_and_a_joint_with_a_tachometer_is_not() -> None:
    assert ELBOW.name == "slave_elbow"
    assert is_counted(ELBOW)
    assert ELBOW.position.step == pytest.approx(STEP)
    konkuk = load_cell("konkuk1")
    assert not any(map(is_counted, joint_nominals(konkuk, [cell_arm(konkuk.laden, konkuk.joint_names)])))


def late_s(counts_s: float, share: float, before_s: float) -> float:
    """When v·t - δ = c·t·(t + Δt)/2 after the last count, with c that share of friction: the smaller root."""
    lacking = share * FRICTION / STEP
    half = counts_s - 0.5 * lacking * before_s
    return (half - math.sqrt(half**2 - 2.0 * lacking)) / lacking


@pytest.mark.parametrize("counts_s", [50.0, 57.0, 64.0])
@pytest.mark.parametrize("phase", [0.1, 0.5, 0.9])
def test_a_jam_shows_soon_after_the_count_that_does_not_come(counts_s: float, phase: float) -> None:
    """At the latest by the last two counts, whose speed is known to a cycle: Δt = δ/v + T. At the earliest by all."""
    jam_s = 3.0 + phase / counts_s
    found_s = drive(OverdueCount(ELBOW, TIMING), jammed(counts_s, jam_s, 4.0, 0.001))
    assert found_s is not None
    last_s = math.floor(counts_s * jam_s) / counts_s
    by_two_s = late_s(1.0 / (1.0 / counts_s + T), SURE_SHARE, 1.0 / counts_s + T)
    by_all_s = late_s(counts_s, KNOWN_SHARE, 1.0 / counts_s)
    assert max(by_all_s, LEAST_CYCLES * T) - 2 * T <= found_s - last_s <= by_two_s + 3 * T
    assert found_s - jam_s < 1.0 / counts_s + 0.03


def test_all_counts_together_tell_sooner_than_the_last_two() -> None:
    """At 35 a second, of a joint that is known for 6 s, and of one that has just begun."""
    known, fresh = (
        drive(OverdueCount(ELBOW, TIMING), jammed(35.0, jam_s, jam_s + 1.0, 0.001)) for jam_s in (6.01, 1.01)
    )
    assert known is not None
    by_all_s = late_s(35.0, KNOWN_SHARE, 1.0 / 35.0)
    last_s = math.floor(35.0 * 6.01) / 35.0
    assert by_all_s - 2 * T <= known - last_s <= by_all_s + 4 * T
    assert fresh is None or fresh - math.floor(35.0 * 1.01) / 35.0 > known - last_s + 4 * T


def test_a_sound_joint_never_is_late() -> None:
    for counts_s in (2.0, 17.0, 61.0, 400.0):
        assert drive(OverdueCount(ELBOW, TIMING), jammed(counts_s, math.inf, 6.0)) is None


def test_of_a_joint_so_slow_that_friction_may_have_stopped_it_nothing_is_said() -> None:
    """What is lacking is 0.34·v²/δ at most, here at 10 counts a second."""
    assert 0.343 * 10.0**2 * STEP < 0.3 * FRICTION
    assert drive(OverdueCount(ELBOW, TIMING), jammed(10.0, 3.0, 6.0)) is None


def test_a_joint_that_is_not_meant_to_turn_may_stand() -> None:
    """Its reference stands as well."""
    still = ((true, min(reference, STEP * 40.0 * 3.0)) for true, reference in jammed(40.0, 3.0, 5.0))
    assert drive(OverdueCount(ELBOW, TIMING), still) is None


def test_a_robot_that_sticks_is_given_what_was_seen_of_it() -> None:
    """It rests for 14 ms while nothing is known of it yet: the limit is higher afterwards."""
    fresh, used = OverdueCount(ELBOW, TIMING), OverdueCount(ELBOW, TIMING)

    def sticking() -> Iterator[tuple[float, float]]:
        rest = 0.0
        for cycle in range(round(3.0 / T)):
            at_s = cycle * T
            if 1.5 <= at_s < 1.514:
                rest += T
            yield STEP * 40.0 * (at_s - rest), STEP * 40.0 * at_s

    assert drive(used, sticking()) is None
    drive(fresh, jammed(40.0, math.inf, 3.0))
    late = [drive(each, jammed(40.0, 0.5, 2.0, 120.0)) for each in (fresh, used)]
    assert late[0] is not None
    assert late[1] is None or late[1] > late[0]


def test_a_joint_that_stands_while_more_than_friction_drives_it_is_held() -> None:
    """While it is unknown how it sticks, friction may be 2.7 times nominal one way, and 0.7 of it the other way."""
    for drive, begun_s, found in ((2.3, 2.5, True), (2.0, 2.5, False), (2.3, 0.5, False), (3.6, 0.5, True)):
        count = OverdueCount(ELBOW, TIMING)
        assert not any(count.step(0.0, 0.0, 0.0, 0.0) for _ in range(round(begun_s / T)))
        told = [count.step(0.0, -drive * FRICTION, 0.0, STEP * 0.003 * cycle) for cycle in range(250)]
        assert any(told) == found
        assert not any(told[:160])  # its reference has not gone half a count yet


def test_a_joint_that_was_driven_as_much_before_its_counts_came_may_be_so_again() -> None:
    count = OverdueCount(ELBOW, TIMING)
    assert not any(count.step(0.0, -3.0 * FRICTION, 0.0, STEP * 0.003 * cycle) for cycle in range(250))
    for cycle in range(round(3.0 / T)):
        count.step(STEP * (1 + cycle), 0.0, 0.0, STEP * (1 + cycle))
    at_rad = STEP * (1 + cycle)
    for drive, found in ((4.2, False), (4.8, True)):
        told = [count.step(at_rad, -drive * FRICTION, 0.0, at_rad + STEP * 0.003 * each) for each in range(300)]
        assert any(told) == found


def test_no_reading_changes_by_two_counts_in_a_cycle() -> None:
    """Rounding makes one, and half of the fastest speed, 477 counts a second, 0.6 more."""
    assert sudden_rad(ELBOW, T) == pytest.approx(STEP * (1.0 + 0.5 * ELBOW.fastest_rad_s / STEP * T))
    assert sudden_rad(ELBOW, T) < 2.0 * STEP
