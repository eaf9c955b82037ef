"""The whole loop with converters of 8 to 16 bits, and with two A/D cards: it follows as well, and finer."""

import math

import pytest

from canarm import Rig
from canarm.rig.rig import State
from canarm_protocol.cell.model import Cell
from tests.resolutions import cell_of_bits, cell_of_encoders, cell_of_two_adcs

STEP_OF_8_BITS_RAD = math.radians(270.0) / 255


def error_rad(cell: Cell) -> tuple[float, float]:
    """RMS error of each joint in the last second of three, rad."""
    with Rig(cell, law="mras", trajectory="sine", seed=0) as rig:
        rig.run(seconds=3.0)
        assert rig.state is State.RUNNING, rig.events
        assert not rig.detections
        errors = [joint.true_angle_rad[-400:] - joint.reference_rad[-400:] for joint in rig.joints.values()]
    first, second = (math.sqrt(float((each**2).mean())) for each in errors)
    return first, second


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_the_loop_runs_with_converters_of_any_resolution(bits: int) -> None:
    assert max(error_rad(cell_of_bits(bits))) < STEP_OF_8_BITS_RAD


def test_finer_converters_follow_no_worse_than_the_8_bits_of_the_real_robot() -> None:
    coarse, fine = error_rad(cell_of_bits(8)), error_rad(cell_of_bits(12))
    assert sum(fine) <= sum(coarse)


def test_the_loop_runs_with_the_joints_at_two_adc_cards() -> None:
    assert max(error_rad(cell_of_two_adcs())) < STEP_OF_8_BITS_RAD


@pytest.mark.parametrize("counter_bits", [16, 32])
def test_the_loop_runs_on_encoders_that_are_counted_finer_than_eight_bits(counter_bits: int) -> None:
    assert max(error_rad(cell_of_encoders(counter_bits=counter_bits))) < STEP_OF_8_BITS_RAD
