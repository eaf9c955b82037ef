"""Faults of amplifiers, latches and motors, in closed form. Joint 2 has 1.5 A, 2.5 ohm, 1.25 mH, K_I = 4.08 N·m/A."""

import math
from collections.abc import Callable

import pytest

from canarm_emulator.faults.declaration import JointFault, SignalFault
from canarm_emulator.robot.drives import decay_over
from canarm_emulator.robot.drives.d669 import DAC_FULL_SCALE, D669Drive
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
SOUND = Truth.from_settings(CELL).joints[0]
MS, CYCLE_NS = 1_000_000, 2_500_000
CURRENT, LATCH, MOTOR = "joint2.amplifier.current", "joint2.latch", "joint2.motor"
Begin = Callable[..., SignalFault]
BeginJoint = Callable[..., JointFault]


def drive_of(joint: JointTruth, fraction: float = DAC_FULL_SCALE) -> D669Drive:
    drive = D669Drive(CELL.joints[0], joint)
    drive.set_dac_output(fraction)
    drive.set_direction(DirectionBits.COUNTER_CLOCKWISE)
    return drive


def settled(drive: D669Drive, speed_rad_s: float = 0.0) -> tuple[float, float]:
    """Current and torque when the winding's current has settled."""
    decay = decay_over(0.1, drive.time_constant_s)
    drive.step(speed_rad_s, *decay)
    torque_nm = drive.step(speed_rad_s, *decay)
    return drive.current_a, torque_nm


# Amplifier


def test_an_amplifier_folds_back_until_less_is_asked_for(begin: Begin) -> None:
    fault = begin(CURRENT, "current-limit", limit=0.6, fold_back=0.2)
    asked = [0.5, 0.6, 0.7, 0.5, 0.21, 0.2, 0.5]
    assert [fault.apply(value, 0) for value in asked] == [0.5, 0.6, 0.2, 0.2, 0.2, 0.2, 0.5]


def test_without_fold_back_it_is_a_plain_limit(begin: Begin) -> None:
    fault = begin(CURRENT, "current-limit", limit=0.4, fold_back=0.4)
    assert [fault.apply(value, 0) for value in (0.3, 0.5, 0.3)] == [0.3, 0.4, 0.3]


def test_it_never_folds_back_to_more_than_its_limit(begin: Begin) -> None:
    assert begin(CURRENT, "current-limit", limit=0.4, fold_back=0.9).apply(1.0, 0) == 0.4


def test_a_thermal_switch_trips_when_the_mean_square_passes_its_limit(begin: Begin) -> None:
    fault = begin(CURRENT, "thermal-trip", limit=0.6, time_constant=0.5)
    values = [fault.apply(1.2, k * MS) for k in range(300)]
    # 1.44 A² · (1 − e^(−t/0.5 s)) = 0.36 A² at t = 0.5 s · ln(4/3) = 143.8 ms
    assert values.index(0.0) == 144
    assert set(values[:144]) == {1.2}
    assert set(values[144:]) == {0.0}


def test_it_closes_again_when_it_has_cooled_to_half_the_current(begin: Begin) -> None:
    fault = begin(CURRENT, "thermal-trip", limit=0.6, time_constant=0.5)
    values = [fault.apply(1.2, k * MS) for k in range(1000)]
    # From 0.36 A² to 0.09 A²: 0.5 s · ln 4 = 693 ms after it has tripped
    assert values.index(1.2, 200) == pytest.approx(144 + 693, abs=2)


def test_it_never_trips_at_its_limit(begin: Begin) -> None:
    fault = begin(CURRENT, "thermal-trip", limit=0.6, time_constant=0.01)
    assert {fault.apply(0.6, k * MS) for k in range(1000)} == {0.6}


def test_it_cools_while_the_bridge_is_off_and_asks_for_nothing(begin: Begin) -> None:
    fault = begin(CURRENT, "thermal-trip", limit=0.6, time_constant=0.5)
    warm = [fault.apply(1.2, k * MS) for k in range(140)]
    later = [fault.apply(1.2, (10_000 + k) * MS) for k in range(140)]
    assert set(warm) == set(later) == {1.2}


# Latch


def test_reversed_direction_swaps_the_two_sides_of_the_bridge(begin: Begin) -> None:
    fault = begin(LATCH, "reversed-direction")
    assert [fault.apply(bits, 0) for bits in (0b00, 0b01, 0b10, 0b11)] == [0b00, 0b10, 0b01, 0b11]


@pytest.mark.parametrize(
    ("bit", "value", "expected"),
    [(0, 0, [0, 0, 2, 2]), (0, 1, [1, 1, 3, 3]), (1, 0, [0, 1, 0, 1]), (1, 1, [2, 3, 2, 3])],
)
def test_a_latch_bit_is_stuck(begin: Begin, bit: int, value: int, expected: list[int]) -> None:
    fault = begin(LATCH, "latch-bit-stuck", bit=bit, value=value)
    assert [fault.apply(bits, 0) for bits in range(4)] == expected


# Motor


def test_an_open_winding_carries_nanoamperes(begin: BeginJoint) -> None:
    current_a, torque_nm = settled(drive_of(begin(MOTOR, "winding-open").change(SOUND, 0)))
    assert current_a == pytest.approx(0.0, abs=20e-9)
    assert torque_nm == pytest.approx(0.0, abs=100e-9)


def test_a_weaker_magnet_takes_torque_and_back_emf(begin: BeginJoint) -> None:
    changed = begin(MOTOR, "loss-of-torque-constant", share=0.25).change(SOUND, 0)
    assert settled(drive_of(changed)) == pytest.approx((1.5, 1.5 * 4.08 * 0.75))
    # At 3.75 rad/s 13.5 V of back-EMF leave 0.6 A; with a sound motor, 18 V leave nothing.
    assert settled(drive_of(changed), 3.75)[0] == pytest.approx(0.6)
    assert settled(drive_of(SOUND), 3.75)[0] == 0.0


def test_shorted_turns_take_their_share_of_the_torque(begin: BeginJoint) -> None:
    changed = begin(MOTOR, "winding-short", share=0.2).change(SOUND, 0)
    assert settled(drive_of(changed)) == pytest.approx((1.5, 1.5 * 4.08 * 0.8))


def test_fewer_turns_have_less_resistance_and_the_square_of_the_inductance(begin: BeginJoint) -> None:
    drive = drive_of(begin(MOTOR, "winding-short", share=0.2).change(SOUND, 0))
    assert drive.time_constant_s == pytest.approx(1.25e-3 * 0.64 / (2.5 * 0.8))
    # At 3.5 rad/s: (15 − 0.8 · 16.8) V / (0.8 · 2.5 ohm)
    assert settled(drive, 3.5)[0] == pytest.approx(0.78)


@pytest.mark.parametrize("direction", [-1, 1])
def test_shorted_turns_brake_as_a_generator_with_the_bridge_off(begin: BeginJoint, direction: int) -> None:
    drive = drive_of(begin(MOTOR, "winding-short", share=0.2).change(SOUND, 0), fraction=0.0)
    _, torque_nm = settled(drive, direction * 0.5)
    loop_a = (0.2 * 0.08 * 60 * 0.5) / (0.2 * 2.5)  # EMF and resistance of the turns that are shorted
    assert torque_nm == pytest.approx(-direction * 0.2 * 4.08 * loop_a)


def test_a_sound_motor_does_not_brake(begin: BeginJoint) -> None:
    assert settled(drive_of(SOUND, fraction=0.0), 2.0)[1] == 0.0


def test_the_worse_of_two_shorts_counts(begin: BeginJoint) -> None:
    worse = begin(MOTOR, "winding-short", share=0.4).change(SOUND, 0)
    assert begin(MOTOR, "winding-short", share=0.2).change(worse, 0) == worse


def test_the_supply_of_a_weak_motor_can_be_low_as_well(begin: BeginJoint) -> None:
    weak = begin(MOTOR, "loss-of-torque-constant", share=0.5).change(SOUND, 0)
    both = begin("joint2.amplifier.supply", "supply-undervoltage", ratio=0.1).change(weak, 0)
    current_a, torque_nm = settled(drive_of(both))
    assert (current_a, torque_nm) == pytest.approx((0.6, 0.6 * 2.04))  # 1.5 V / 2.5 ohm
    assert math.isclose(both.torque_constant_nm_a, 0.04)
