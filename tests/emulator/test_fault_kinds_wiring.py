"""Faults of wires, against the arithmetic of the circuits that are assumed around the pins."""

import itertools
import math
import statistics
from collections.abc import Callable

import pytest

from canarm_emulator.faults.declaration import JointFault, SignalFault
from canarm_emulator.robot.drives import decay_over
from canarm_emulator.robot.drives.d669 import DAC_FULL_SCALE, D669Drive
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
SOUND = Truth.from_settings(CELL).joints[0]  # 2.5 ohm, 1.25 mH, 15 V, 0.08·60 V·s/rad
MS, CYCLE_NS = 1_000_000, 2_500_000
TAP, MOTOR, SUPPLY = "joint2.potentiometer", "joint2.motor", "joint2.amplifier.supply"
Begin = Callable[..., SignalFault]
BeginJoint = Callable[..., JointFault]


def settled_current_a(joint: JointTruth, speed_rad_s: float = 0.0) -> float:
    """Current at full command and a constant speed, after 100 ms: two hundred time constants."""
    drive = D669Drive(CELL.joints[0], joint)
    drive.set_dac_output(DAC_FULL_SCALE)
    drive.set_direction(DirectionBits.COUNTER_CLOCKWISE)
    drive.step(speed_rad_s, *decay_over(0.1, drive.time_constant_s))
    return drive.current_a


# Sensors


def test_an_open_wire_lets_the_pin_decay_to_ground(begin: Begin) -> None:
    fault = begin(TAP, "open-load", time_constant=0.01)
    assert fault.apply(4.0, 0) == 4.0
    assert fault.apply(3.0, 10 * MS) == pytest.approx(4.0 / math.e)
    assert fault.apply(3.0, 100 * MS) < 0.001


def test_the_filter_at_the_pin_holds_10_ms(begin: Begin) -> None:
    fault = begin(TAP, "open-load")
    fault.apply(4.0, 0)
    assert fault.apply(4.0, 10 * MS) == pytest.approx(4.0 / math.e)  # 100 kohm · 100 nF


def test_without_a_filter_an_open_pin_is_at_ground_at_once(begin: Begin) -> None:
    assert begin(TAP, "open-load", time_constant=0.0).apply(4.0, 0) == 0.0


@pytest.mark.parametrize(("name", "volts"), [("short-to-ground", 0.0), ("short-to-supply", 5.0)])
def test_a_short_leaves_the_voltage_of_what_the_wire_touches(begin: Begin, name: str, volts: float) -> None:
    fault = begin(TAP, name)
    assert [fault.apply(value, 0) for value in (1.0, 4.0)] == [volts, volts]


@pytest.mark.parametrize(("ohm", "volts"), [(0.0, 4.0), (25e3, 3.2), (100e3, 2.0)])
def test_resistance_in_the_wire_divides_with_100_kiloohm_at_the_pin(begin: Begin, ohm: float, volts: float) -> None:
    assert begin(TAP, "in-line-resistance", resistance=ohm).apply(4.0, 0) == pytest.approx(volts)


@pytest.mark.parametrize(("ohm", "volts"), [(2.5e3, 2.0), (7.5e3, 3.0), (10e6, 3.999)])
def test_leakage_divides_with_2_5_kiloohm_of_the_sensor(begin: Begin, ohm: float, volts: float) -> None:
    assert begin(TAP, "leakage", resistance=ohm).apply(4.0, 0) == pytest.approx(volts, rel=1e-5)


@pytest.mark.parametrize("duty", [0.2, 0.7])
def test_a_loose_contact_is_open_for_its_share_of_the_time(begin: Begin, duty: float) -> None:
    fault = begin(TAP, "loose-contact", duty=duty, frequency=10.0, seed=5)
    is_open = [fault.apply(4.0, k * MS) < 4.0 for k in range(60_000)]
    breaks = sum(later and not earlier for earlier, later in itertools.pairwise(is_open))
    # Of 600 periods, each the sum of two exponential times: the share's standard deviation is below 0.02.
    assert statistics.fmean(is_open) == pytest.approx(duty, abs=0.06)
    assert breaks == pytest.approx(600, rel=0.15)


def test_a_loose_contact_breaks_when_it_begins_and_the_pin_decays_from_there(begin: Begin) -> None:
    fault = begin(TAP, "loose-contact", duty=0.99, frequency=0.01)
    assert [fault.apply(4.0, now_ns) for now_ns in (0, 10 * MS)] == [4.0, pytest.approx(4.0 / math.e)]


def test_a_contact_that_holds_again_gives_the_voltage_of_that_moment(begin: Begin) -> None:
    fault = begin(TAP, "loose-contact", frequency=100.0)
    values = [(fault.apply(1.0 + k / 1000, k * MS), 1.0 + k / 1000) for k in range(1000)]
    assert sum(seen == true for seen, true in values) > 200
    assert all(seen <= true for seen, true in values)


def test_a_ground_shift_adds_to_every_reading(begin: Begin) -> None:
    assert begin(TAP, "ground-shift", shift=-0.25).apply(2.0, 0) == 1.75


@pytest.mark.parametrize(("name", "ratio", "volts"), [("undervoltage", 0.9, 2.25), ("overvoltage", 1.1, 2.75)])
def test_sensors_follow_their_supply_and_the_converter_does_not(
    begin: Begin, name: str, ratio: float, volts: float
) -> None:
    assert begin(TAP, f"supply-{name}", ratio=ratio).apply(2.5, 0) == pytest.approx(volts)


# Supply and motor leads


def test_half_the_supply_drives_0_6_amperes_against_6_volts(begin: BeginJoint) -> None:
    changed = begin(SUPPLY, "supply-undervoltage", ratio=0.5).change(SOUND, 0)
    assert changed.supply_v == 7.5
    assert settled_current_a(SOUND, 1.25) == pytest.approx(1.5)  # (15 − 6) V / 2.5 ohm is more than the amplifier gives
    assert settled_current_a(changed, 1.25) == pytest.approx(0.6)  # (7.5 − 6) V / 2.5 ohm


def test_more_supply_drives_full_current_at_a_speed_where_it_was_limited(begin: BeginJoint) -> None:
    changed = begin(SUPPLY, "supply-overvoltage", ratio=1.5).change(SOUND, 0)
    assert settled_current_a(SOUND, 2.5) == pytest.approx(1.2)  # (15 − 12) V / 2.5 ohm
    assert settled_current_a(changed, 2.5) == pytest.approx(1.5)


def test_a_broken_lead_carries_nanoamperes(begin: BeginJoint) -> None:
    assert settled_current_a(begin(MOTOR, "open-load").change(SOUND, 0)) == pytest.approx(0.0, abs=20e-9)


def test_a_broken_lead_stops_a_current_at_once(begin: BeginJoint) -> None:
    drive = D669Drive(CELL.joints[0], SOUND)
    drive.set_dac_output(DAC_FULL_SCALE)
    drive.set_direction(DirectionBits.CLOCKWISE)
    drive.step(0.0, *decay_over(0.1, drive.time_constant_s))
    drive.change(begin(MOTOR, "open-load").change(SOUND, 0))
    torque_nm = drive.step(0.0, *decay_over(1e-6, drive.time_constant_s))
    assert drive.current_a == pytest.approx(0.0, abs=20e-9)
    assert torque_nm == pytest.approx(0.0, abs=1e-4)


def test_10_ohm_in_a_lead_leave_1_2_amperes_that_come_in_a_tenth_of_a_millisecond(begin: BeginJoint) -> None:
    changed = begin(MOTOR, "in-line-resistance", resistance=10.0).change(SOUND, 0)
    assert settled_current_a(changed) == pytest.approx(1.2)  # 15 V / 12.5 ohm
    assert D669Drive(CELL.joints[0], changed).time_constant_s == pytest.approx(1e-4)  # 1.25 mH / 12.5 ohm


def test_a_loose_lead_is_as_broken_or_as_sound(begin: BeginJoint) -> None:
    fault = begin(MOTOR, "loose-contact", duty=0.5, frequency=20.0, seed=1)
    states = [fault.change(SOUND, k * CYCLE_NS) for k in range(4000)]
    assert fault.varies
    assert states[0] == begin(MOTOR, "open-load").change(SOUND, 0)
    assert statistics.fmean(state == SOUND for state in states) == pytest.approx(0.5, abs=0.15)
    assert {state.winding_ohm for state in states} == {2.5, states[0].winding_ohm}
