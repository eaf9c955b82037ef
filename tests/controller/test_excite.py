"""The motion made for identification: within the limits, the same each time, and better for it than the others."""

import numpy as np
import pytest

from canarm_controller.dynamics.inertial_regressor import InertialRegressor
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.excite import MOST_OF_CURRENT, PERIOD_S, judgement
from canarm_controller.reference.trajectory import make_trajectory, usual_motion
from canarm_protocol.cell.cell_file import load_cell

KONKUK = load_cell("konkuk1")


def test_it_stays_within_angles_speeds_and_currents_of_the_cell() -> None:
    at = make_trajectory("excite", KONKUK).sample(0, 4096, KONKUK.bus.cycle_s)
    assert np.abs(np.degrees(at.position_rad)).max() < 130.0
    assert np.abs(at.velocity_rad_s).max() <= 0.8 * 2.5 + 1e-3, "the tachometer's range is 2.5 rad/s"
    regressor = InertialRegressor(KONKUK.robot[0])
    motors = [joint.motor for joint in KONKUK.joints]
    friction = [[getattr(each, name) for each in motors] for name in ("viscous_friction_nm_s", "coulomb_friction_nm")]
    torque_nm = regressor.rows(at.position_rad, at.velocity_rad_s, at.acceleration_rad_s2) @ regressor.values(
        KONKUK.robot[0], *friction
    )
    # K_I of the paper's gears: 0.08 N m/A x 60 x 0.85 and x 40.
    current_a = np.abs(torque_nm / np.array([4.08, 2.72]))
    assert current_a.max() <= MOST_OF_CURRENT * 1.5 + 1e-3


def test_its_speeds_are_the_derivatives_of_its_angles_and_it_repeats() -> None:
    motion = make_trajectory("excite", KONKUK)
    at = motion.sample(0, 2001, PERIOD_S / 2000)
    step_s = PERIOD_S / 2000
    speed = (at.position_rad[2:] - at.position_rad[:-2]) / (2 * step_s)
    np.testing.assert_allclose(speed, at.velocity_rad_s[1:-1], atol=1e-3)
    acceleration = (at.velocity_rad_s[2:] - at.velocity_rad_s[:-2]) / (2 * step_s)
    np.testing.assert_allclose(acceleration, at.acceleration_rad_s2[1:-1], atol=1e-2)
    np.testing.assert_allclose(at.position_rad[0], at.position_rad[-1], atol=1e-12)


def test_it_is_the_same_each_time() -> None:
    one, other = (make_trajectory("excite", KONKUK).sample(0, 100, 0.0025) for _ in range(2))
    np.testing.assert_array_equal(one.position_rad, other.position_rad)


def test_it_shows_every_parameter_and_better_than_the_other_motions_do() -> None:
    regressor = InertialRegressor(KONKUK.robot[0])
    unseen, condition = judgement(make_trajectory("excite", KONKUK), regressor)
    assert unseen == 0
    assert (unseen, condition) < judgement(make_trajectory("sine", KONKUK), regressor)
    assert judgement(make_trajectory("trapezoid", KONKUK), regressor)[0] > 0, "a constant speed shows no inertia"


def test_nobody_takes_it_unasked_and_robots_with_an_object_never() -> None:
    assert usual_motion(KONKUK) == "sine"
    with pytest.raises(TrajectoryError, match="tear the object apart"):
        make_trajectory("excite", load_cell("rhino-pair"))
