"""Joint 2's drive against the arithmetic of its circuit: 2.5 ohm, 1.25 mH, 15 V, 0.08·60 V·s/rad."""

import math

import pytest

from canarm_emulator.robot.drives import decay_over
from canarm_emulator.robot.drives.d669 import DAC_FULL_SCALE, D669Drive
from canarm_emulator.robot.truth import Truth
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
TORQUE_NM_A = 4.08  # K_I of joint 2


def joint2_drive(fraction: float = 0.0, direction: int = DirectionBits.COUNTER_CLOCKWISE, **truth: str) -> D669Drive:
    settings = {f"joint2.{key}": value for key, value in truth.items()}
    drive = D669Drive(CELL.joints[0], Truth.from_settings(CELL, settings).joints[0])
    drive.set_dac_output(fraction)
    drive.set_direction(direction)
    return drive


def run(drive: D669Drive, duration_s: float, speed_rad_s: float = 0.0, steps: int = 1) -> float:
    """Mean torque over `duration_s` at a constant motor speed."""
    decay = decay_over(duration_s / steps, drive.time_constant_s)
    return sum(drive.step(speed_rad_s, *decay) for _ in range(steps)) / steps


@pytest.mark.parametrize(("code", "amperes"), [(0, 0.0), (1, 1.5 / 255), (102, 0.6), (255, 1.5)])
def test_a_dac_code_is_worth_5_88_milliamperes(code: int, amperes: float) -> None:
    assert joint2_drive(code / 256).command_a == pytest.approx(amperes, abs=1e-15)


@pytest.mark.parametrize(("fraction", "amperes"), [(1.0, 1.5), (-0.1, 0.0)])
def test_the_amplifier_saturates_outside_the_range_of_the_dac(fraction: float, amperes: float) -> None:
    assert joint2_drive(fraction).command_a == amperes


def test_counter_clockwise_is_positive_and_clockwise_negative() -> None:
    assert joint2_drive(0.5, 0b10).command_a > 0
    assert joint2_drive(0.5, 0b01).command_a < 0
    assert joint2_drive(0.5, 0b00).command_a == 0


def test_both_bridge_sides_at_once_open_the_bridge_and_are_counted() -> None:
    drive = joint2_drive(0.5)
    drive.set_direction(0b11)
    assert (drive.command_a, drive.is_on, drive.illegal_directions) == (0.0, False, 1)


def test_direction_bits_beyond_two_are_a_mistake_of_the_caller() -> None:
    with pytest.raises(ValueError, match="direction bits 4"):
        joint2_drive().set_direction(4)


@pytest.mark.parametrize("step_us", [50, 100, 500, 650, 2000])
def test_the_current_rises_exponentially_with_half_a_millisecond(step_us: int) -> None:
    drive = joint2_drive(DAC_FULL_SCALE)
    run(drive, step_us * 1e-6)
    assert drive.current_a == pytest.approx(1.5 * (1 - math.exp(-step_us / 500)), rel=1e-12)


def test_one_long_step_makes_the_same_impulse_as_many_short_ones() -> None:
    long, short = joint2_drive(0.4), joint2_drive(0.4)
    assert run(long, 2e-3) == pytest.approx(run(short, 2e-3, steps=1000), rel=1e-12)
    # ∫ of 1 − e^(−t/τ) over 4 τ, by hand
    mean_a = 1.5 * 0.4 * 256 / 255 * (1 - (1 - math.exp(-4)) / 4)
    assert run(joint2_drive(0.4), 2e-3) == pytest.approx(TORQUE_NM_A * mean_a, rel=1e-12)


def test_the_current_inside_a_step_is_on_the_same_curve() -> None:
    drive = joint2_drive(DAC_FULL_SCALE)
    run(drive, 600e-6)
    assert drive.current_after(200e-6, 0.0) == pytest.approx(1.5 * (1 - math.exp(-0.4)), rel=1e-12)


def test_an_open_bridge_lets_the_current_decay() -> None:
    drive = joint2_drive(DAC_FULL_SCALE)
    run(drive, 1.0)
    drive.set_direction(DirectionBits.OFF)
    run(drive, 1e-3)
    assert drive.current_a == pytest.approx(1.5 * math.exp(-2), rel=1e-12)


def test_an_open_supply_lets_the_current_decay_until_it_is_closed_again() -> None:
    drive = joint2_drive(DAC_FULL_SCALE)
    run(drive, 1.0)
    drive.set_supply(False)
    assert not drive.is_on
    run(drive, 0.1)
    assert drive.current_a == pytest.approx(0.0, abs=1e-12)
    drive.set_supply(True)
    run(drive, 0.1)
    assert drive.current_a == pytest.approx(1.5)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("speed_rad_s", "amperes"),
    [
        (2.0, 1.5),  # (15 − 9.6)/2.5 = 2.16 A would flow
        (2.5, 1.2),  # (15 − 12)/2.5
        (3.0, 0.24),  # (15 − 14.4)/2.5
        (15 / 4.8, 0.0),  # no-load speed
        (4.0, 0.0),  # beyond it, one NPN transistor cannot carry the current back
        (-4.0, 1.5),  # braking: (15 + 19.2)/2.5 = 13.7 A would flow
    ],
)
def test_the_supply_less_back_emf_limits_the_current(speed_rad_s: float, amperes: float, sign: int) -> None:
    drive = joint2_drive(DAC_FULL_SCALE, DirectionBits.COUNTER_CLOCKWISE if sign > 0 else DirectionBits.CLOCKWISE)
    run(drive, 1.0, sign * speed_rad_s)
    assert drive.current_a == pytest.approx(sign * amperes, abs=1e-12)
    assert drive.supply_limited_steps == (amperes < 1.5)


def test_a_low_supply_limits_at_standstill() -> None:
    drive = joint2_drive(DAC_FULL_SCALE, supply_v="2.5")
    run(drive, 1.0)
    assert drive.current_a == pytest.approx(1.0)


def test_the_two_limits_are_counted_apart() -> None:
    drive = joint2_drive(DAC_FULL_SCALE)
    run(drive, 1e-3, 0.0, steps=3)
    assert (drive.own_limited_steps, drive.supply_limited_steps) == (3, 0)
    drive.set_dac_output(254 / 256)
    run(drive, 1e-3, 3.0, steps=2)
    assert (drive.own_limited_steps, drive.supply_limited_steps) == (3, 2)


def test_the_true_torque_constant_makes_torque_and_back_emf() -> None:
    drive = joint2_drive(DAC_FULL_SCALE, torque_constant="0.04")
    run(drive, 1.0)
    assert run(drive, 1e-3) == pytest.approx(1.5 * TORQUE_NM_A / 2)
    run(drive, 1.0, speed_rad_s=5.0)
    assert drive.current_a == pytest.approx(1.2)  # (15 − 0.04·60·5)/2.5
