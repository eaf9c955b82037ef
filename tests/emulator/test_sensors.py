"""Sensor voltages against the scale factors of the parts: 270° and ±2.5 rad/s on 0..5 V, 1.5 A on 5 V."""

import itertools
import math

import numpy as np
import pytest

from canarm_emulator.robot.sensors import Source, normal_deviates, source
from canarm_emulator.robot.truth import Truth
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Quantity
from canarm_protocol.cell.sensing import joint_sensors

CELL = load_cell("konkuk1")


def joint3_source(quantity: Quantity, **truth: str) -> Source:
    settings = {f"joint3.{key}": value for key, value in truth.items()}
    wired = joint_sensors(CELL)[1].measuring(quantity)
    assert wired is not None
    return source(wired, Truth.from_settings(CELL, settings).joints[1])


@pytest.mark.parametrize(("angle_deg", "volts"), [(0, 2.5), (27, 3.0), (-27, 2.0), (135, 5.0), (140, 5.0), (-140, 0.0)])
def test_the_potentiometer_spans_270_degrees(angle_deg: float, volts: float) -> None:
    sensor = joint3_source(Quantity.POSITION)
    assert sensor.volts(math.radians(angle_deg), 0.0) == pytest.approx(volts, abs=1e-12)


@pytest.mark.parametrize(("speed_rad_s", "volts"), [(0, 2.5), (2.5, 5.0), (-2.5, 0.0), (1, 3.5), (9, 5.0), (-9, 0.0)])
def test_the_tachometer_is_centred_at_half_scale_and_rises_counter_clockwise(speed_rad_s: float, volts: float) -> None:
    assert joint3_source(Quantity.VELOCITY).volts(speed_rad_s, 0.0) == pytest.approx(volts, abs=1e-12)


@pytest.mark.parametrize(("current_a", "volts"), [(0.0, 0.0), (0.6, 2.0), (1.5, 5.0), (1.6, 5.0)])
def test_the_current_sense_gives_5_volts_at_1_5_amperes(current_a: float, volts: float) -> None:
    assert joint3_source(Quantity.CURRENT).volts(current_a, 0.0) == pytest.approx(volts, abs=1e-12)


def test_a_true_offset_shifts_the_reading_by_as_much() -> None:
    potentiometer = joint3_source(Quantity.POSITION, potentiometer_offset_deg="2.7")
    assert potentiometer.volts(0.0, 0.0) == pytest.approx(2.55)
    assert joint3_source(Quantity.VELOCITY, tachometer_offset="-0.1").volts(0.0, 0.0) == pytest.approx(2.4)


def test_one_deviate_moves_the_reading_by_the_noise_in_steps_of_8_bits() -> None:
    sensor = joint3_source(Quantity.POSITION, noise_lsb="0.5")
    one_step_v = sensor.volts(math.radians(270 / 255), 0.0) - 2.5  # 1 LSB = 1.059°
    assert sensor.volts(0.0, 1.0) - 2.5 == pytest.approx(0.5 * one_step_v)


def test_noise_cannot_leave_the_range_of_the_supply() -> None:
    sensor = joint3_source(Quantity.CURRENT)
    assert sensor.volts(0.0, -3.0) == 0.0
    assert sensor.volts(1.5, 3.0) == 5.0


def test_deviates_are_those_of_pcg64_whatever_the_block() -> None:
    ours = list(itertools.islice(normal_deviates(7), 10_000))
    assert ours == np.random.Generator(np.random.PCG64(7)).standard_normal(10_000).tolist()
