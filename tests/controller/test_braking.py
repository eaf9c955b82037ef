"""The way to rest of a safe stop: its derivatives, its length, and what the amplifiers have for it."""

import itertools

import numpy as np
import pytest

from canarm_controller.dynamics import cell_arm
from canarm_controller.supervision.braking import LONGEST_SMOOTH_S, Braking
from canarm_protocol.cell.cell_file import load_cell

PERIOD_S = 2.5e-3
HOME = (0.35, 0.0)
NO_LOAD = [[0.0, 0.0], [0.0, 0.0]]
SOFT = (1.0 / 100.0, 1.0 / 40.0)  # rad/(N m), the softest of the box


def way(
    speed_rad_s: tuple[float, float],
    lacking_nm: tuple[float, float] = (0.0, 0.0),
    start: tuple[float, float] = (0.0, 0.0),
) -> Braking:
    cell = load_cell("konkuk1")
    arm = cell_arm(cell.robot, cell.joint_names)
    return Braking(arm, HOME, speed_rad_s, start, SOFT, lacking_nm, NO_LOAD, PERIOD_S)


@pytest.mark.parametrize("speed", [(0.5, -0.4), (-0.9, 1.9)], ids=["slow", "as fast as the amplifiers allow"])
@pytest.mark.parametrize("start", [(0.0, 0.0), (3.0, -5.0)], ids=["steady", "accelerating"])
def test_each_derivative_is_that_of_the_one_before(speed: tuple[float, float], start: tuple[float, float]) -> None:
    plan = way(speed, start=start)
    moments = [plan.at(cycle) for cycle in range(plan.cycles)]
    rows = {
        name: np.array([getattr(moment, name) for moment in moments])
        for name in ("speed", "acceleration", "jerk", "snap")
    }
    names = list(rows)
    for of, derivative in itertools.pairwise(names):
        # Simpson over two cycles; the snap of the eased ends jumps where the deceleration becomes constant.
        grown = rows[of][2:] - rows[of][:-2]
        area = (rows[derivative][2:] + 4.0 * rows[derivative][1:-1] + rows[derivative][:-2]) * PERIOD_S / 3.0
        allowed = 0.35 if derivative == "snap" else 0.02
        assert np.abs(grown - area).max() <= allowed * np.abs(grown).max()


@pytest.mark.parametrize("start", [(0.0, 0.0), (3.0, -5.0)])
def test_it_begins_as_the_arm_moves_and_ends_at_rest(start: tuple[float, float]) -> None:
    speed = (0.5, -0.4)
    plan = way(speed, start=start)
    first, last = plan.at(0), plan.at(plan.cycles - 1)
    assert first.speed == pytest.approx(speed)
    assert first.acceleration == pytest.approx(start, abs=1e-9)
    assert np.abs(last.speed).max() < 0.002
    assert plan.at(plan.cycles).speed == plan.at(plan.cycles).acceleration == (0.0, 0.0)


def test_where_amplifiers_need_the_time_the_deceleration_comes_quicker_and_lasts() -> None:
    """It sinks with 0.45 kg, which joint 2 has to bear at 0.27 m: two fifths of its drive are left."""
    slow, fast = way((0.5, -0.4)), way((-1.1, 0.5), lacking_nm=(1.2, 0.4))
    assert slow.cycles * PERIOD_S == pytest.approx(0.08)
    assert fast.cycles * PERIOD_S == pytest.approx(LONGEST_SMOOTH_S)
    for plan, most in ((slow, 1.9), (fast, 1.7)):
        speeds = np.array([plan.at(cycle).speed[0] for cycle in range(plan.cycles + 1)])
        mean = speeds[0] / plan.cycles
        assert 1.0 < np.abs(np.diff(speeds)).max() / abs(mean) < most


def test_a_heavy_arm_brakes_with_more_of_its_drive_but_not_with_all() -> None:
    """It rises slowly, so that what weighs brakes it; sinking, joint 2 has little left beyond what holds it."""
    cell = load_cell("konkuk1")
    arm = cell_arm(cell.robot, cell.joint_names)
    lacking_nm, speed = (1.9, 0.6), (-0.6, 0.3)
    plan = way(speed, lacking_nm=lacking_nm)
    assert plan.cycles * PERIOD_S <= LONGEST_SMOOTH_S
    drive_nm = [amperes * most for amperes, most in zip(arm.torque_per_ampere, arm.max_current_a, strict=True)]
    shares = []
    for cycle in range(plan.cycles):
        moment = plan.at(cycle)
        model_nm = arm.torque_nm(HOME, moment.speed, moment.acceleration)
        shares += [
            abs(model + lacking) / most for model, lacking, most in zip(model_nm, lacking_nm, drive_nm, strict=True)
        ]
    assert 0.8 < max(shares) < 0.98
