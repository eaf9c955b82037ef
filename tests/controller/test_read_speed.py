"""The speed of a joint by its readings: right within what it says it is in doubt by, whatever the model lacks."""

import math

import pytest

from canarm_controller.supervision.read_speed import ReadSpeed

PERIOD_S, COUNT_RAD = 0.0025, 2.0 * math.pi / 8192
"""A cycle, and a step of an encoder of 2048 lines."""
ROUNDING = COUNT_RAD / math.sqrt(12.0)
FRICTION_RAD_S2 = 3.3


def readings(angle: float) -> float:
    return COUNT_RAD * round(angle / COUNT_RAD)


@pytest.mark.parametrize("start_rad_s", [-0.5, 0.03, 0.2])
@pytest.mark.parametrize("model_rad_s2", [0.0, 4.0])
@pytest.mark.parametrize("lacking_rad_s2", [-FRICTION_RAD_S2, 0.0, FRICTION_RAD_S2])
def test_a_speed_is_right_within_its_doubt(start_rad_s: float, model_rad_s2: float, lacking_rad_s2: float) -> None:
    """On x = v·t + a·t²/2, of which the model knows only a part of a."""
    read = ReadSpeed(ROUNDING, FRICTION_RAD_S2, PERIOD_S)
    acceleration = model_rad_s2 + lacking_rad_s2
    read.start(0.0, 0.0)
    known = 0
    for cycle in range(1, 60):
        time_s = cycle * PERIOD_S
        angle = start_rad_s * time_s + 0.5 * acceleration * time_s**2
        read.take(readings(angle), model_rad_s2 * time_s, 0.0, FRICTION_RAD_S2)
        if read.doubt_rad_s < math.inf:
            known += 1
            assert abs(read.speed - start_rad_s - acceleration * time_s) <= 1.01 * read.doubt_rad_s
    assert known > 40
    assert read.doubt_rad_s < 1.5 * math.sqrt(2.0 * COUNT_RAD * FRICTION_RAD_S2)


def test_what_the_model_lacks_and_is_known_to_lack_leaves_no_error() -> None:
    read = ReadSpeed(ROUNDING, FRICTION_RAD_S2, PERIOD_S)
    read.start(0.0, 0.0)
    for cycle in range(1, 60):
        time_s = cycle * PERIOD_S
        read.take(0.2 * time_s + 0.5 * 7.0 * time_s**2, 5.0 * time_s, 2.0, 0.0)
    assert read.speed == pytest.approx(0.2 + 7.0 * 59 * PERIOD_S, abs=1e-9)
    assert read.unforeseen_rad_s2 < 1e-6


def test_a_joint_that_swings_on_its_wire_is_seen_to_accelerate_as_nobody_foresaw() -> None:
    """Half a degree at 12 Hz: 50 rad/s2 at most, of which windows of about a quarter of a swing show much."""
    amplitude_rad, swing_rad_s = math.radians(0.5), 2.0 * math.pi * 12.0
    read = ReadSpeed(ROUNDING, FRICTION_RAD_S2, PERIOD_S)
    read.start(0.0, 0.0)
    for cycle in range(1, 200):
        read.take(readings(amplitude_rad * math.sin(swing_rad_s * cycle * PERIOD_S)), 0.0, 0.0, FRICTION_RAD_S2)
    assert 0.3 * amplitude_rad * swing_rad_s**2 < read.unforeseen_rad_s2 < 1.2 * amplitude_rad * swing_rad_s**2


def test_a_sensor_that_is_too_coarse_says_so() -> None:
    read = ReadSpeed(math.radians(1.06) * 0.42, FRICTION_RAD_S2, PERIOD_S)
    read.start(0.0, 0.0)
    for _ in range(200):
        read.take(0.0, 0.0, 0.0, FRICTION_RAD_S2)
    assert read.doubt_rad_s > 0.3
