"""What has become of a tachometer is said by its right name: a pin without a wire, a slow drift, a code that stands."""

import math

import pytest

from canarm import Rig
from canarm.rig.rig import State
from canarm_controller.supervision.step_trial import StepTrial
from canarm_controller.supervision.suspicion import Suspicion

PERIOD_S = 0.0025
NOISE_CODES = math.hypot(0.3, 12**-0.5)
"""Of konkuk1's converter: 0.3 steps, and rounding."""


def falls(codes: list[float]) -> bool:
    """Whether a trial holds these codes of a tachometer, from the first that has stepped on, for a pin's fall."""
    trial = StepTrial(math.radians(1.06), PERIOD_S, 9, NOISE_CODES)
    trial.begin(-0.5, round(codes[0]))
    for code in codes[1:]:
        trial.take(-1.0, 0.0, round(code))
    return trial.has_fallen


@pytest.mark.parametrize("time_constant_s", [0.006, 0.01, 0.014])
@pytest.mark.parametrize("first", [90.0, 200.0])
def test_a_pin_that_nothing_drives_is_told_by_its_fall(first: float, time_constant_s: float) -> None:
    """100 kohm and 100 nF are 10 ms."""
    assert falls([first * math.exp(-k * PERIOD_S / time_constant_s) for k in range(5)])


@pytest.mark.parametrize("step", [5.0, 12.0, 20.0])
@pytest.mark.parametrize("first", [90.0, 200.0])
def test_an_arm_that_slows_down_steadily_is_no_such_pin(first: float, step: float) -> None:
    assert not falls([first - k * step for k in range(5)])


@pytest.mark.parametrize("swing_hz", [10.0, 14.0, 20.0, 28.0])
def test_a_motor_that_swings_on_its_wire_is_no_such_pin(swing_hz: float) -> None:
    """From 10 to 28 Hz, konkuk1's wires in the box: it slows down as the sine does, from 160 steps to 40."""
    turns = [2.0 * math.pi * swing_hz * k * PERIOD_S for k in range(1, 6)]
    assert not falls([160.0 - 120.0 * math.sin(min(turn, 0.5 * math.pi)) for turn in turns])


def is_slow(drift_lsb: list[float], limit_lsb: float = 0.65) -> bool:
    """The verdict on a residual of the angle, by cycles, when a filter over 16 cycles passes the limit."""
    suspicion, mismatch = Suspicion(400, 30.0, PERIOD_S), 0.0
    for cycle, astray in enumerate(drift_lsb):
        mismatch += (astray - mismatch) / 16.0
        if mismatch >= limit_lsb:
            return suspicion.is_slow(mismatch)
        if not cycle & 3:
            suspicion.take(mismatch)
    raise AssertionError("the limit is never passed")


def test_a_tachometers_drift_is_slow_and_a_potentiometers_is_not() -> None:
    """By 10 % of the range in a second: of 256 steps the one, the other as the integral of 0.5 rad/s²."""
    times = [k * PERIOD_S for k in range(400)]
    assert not is_slow([25.6 * time for time in times])
    assert is_slow([0.25 * time**2 / math.radians(1.06) for time in times])


def test_a_tachometer_that_drifts_is_named_and_the_run_goes_on_without_it() -> None:
    with Rig("konkuk1", law="mras", seed=4) as rig:
        rig.inject("joint2.tachometer", "drift", at=2.4)
        rig.run(4.0)
        assert rig.state is State.RUNNING
        first = rig.detections[0]
        assert (first.detector, first.where) == ("tachometer-mismatch", "joint2")
        assert rig.joints["joint2"].max_error_lsb < 3.0


DRAWN = {
    "joint2.wire": 1, "joint2.wire_stiffness": 109.597, "joint2.coulomb": 0.21528, "joint2.viscous": 0.0172026,
    "joint3.wire": 1, "joint3.wire_stiffness": 98.7482, "joint3.coulomb": 0.0299928, "joint3.viscous": 0.0137542,
    "joint3.mass": 0.313013,
}  # fmt: skip
"""A whole robot of the box."""
AT_S, FLOOR_RAD_S = 4.7625, 0.125


def test_a_code_that_stood_rightly_on_a_stretch_of_constant_speed_is_found_when_the_arm_slows_down() -> None:
    """It stands for 0.25 s before; what payload and friction might have made of so long a time hid the fault."""
    with Rig("konkuk1", law="computed-torque", trajectory="trapezoid", seed=791823130, truth=DRAWN) as rig:
        rig.inject("joint2.tachometer", "stuck", at=AT_S)
        rig.run(5.2)
        first = rig.detections[0]
        assert (first.detector, first.where) == ("tachometer-stuck", "joint2")
        begun = round(AT_S / PERIOD_S)
        speeds = rig.joints["joint2"].true_speed_rad_s
        is_wrong = abs(speeds[begun:] - speeds[begun]) > FLOOR_RAD_S
        assert is_wrong.any()
        assert first.tick <= begun + int(is_wrong.argmax()) + 10


@pytest.mark.parametrize("joint", ["joint2", "joint3"])
def test_a_tachometer_that_steps_while_the_arm_surprises_is_no_acceleration(joint: str) -> None:
    """The wire of joint 3 swings a little at this moment, so that accelerations are being measured already."""
    truth = {
        "joint2.coulomb": 0.0899981, "joint2.viscous": 0.0621389, "joint3.wire": 1, "joint3.wire_stiffness": 58.294,
        "joint3.coulomb": 0.125495, "joint3.viscous": 0.03707, "joint3.mass": 0.428525,
    }  # fmt: skip
    with Rig("konkuk1", law="slotine-li", seed=649873593, truth=truth) as rig:
        rig.inject(f"{joint}.tachometer", "offset", at=7.305)
        rig.run(seconds=7.4)
        assert (rig.detections[0].detector, rig.detections[0].where) == ("tachometer-jump", joint)
