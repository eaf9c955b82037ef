"""Where the slave's base may stand: each square of the map is what a plan for that base says."""

from dataclasses import replace

import numpy as np
import pytest

from canarm.cooperation import (
    POSTURES,
    CarriedObject,
    CooperationError,
    Posture,
    Reason,
    RefusedPlanError,
    circle,
    least_motion,
    plan_cooperation,
    reachability,
)
from tests.five_axis_arms import PAIR, START

COARSE = circle(period_s=0.1)
X_M, Y_M = np.linspace(-0.8, 0.9, 18), np.linspace(-1.1, 0.5, 17)


def test_every_square_of_the_map_says_what_a_plan_for_that_base_says() -> None:
    found = reachability(PAIR, COARSE, START, X_M, Y_M)
    seen = set()
    for row, y in enumerate(Y_M.tolist()):
        for column, x in enumerate(X_M.tolist()):
            pair = replace(PAIR, slave_base_m=(x, y, 0.0))
            reason = Reason(int(found.reason[row, column]))
            seen.add(reason)
            if reason is Reason.NONE:
                plan = plan_cooperation(pair, COARSE, START)
                assert found.travel_ratio[row, column] == pytest.approx(plan.travel_ratio, rel=1e-9)
                assert found.largest_step_rad[row, column] == pytest.approx(plan.checks().slave_step_rad, rel=1e-6)
            else:
                with pytest.raises(RefusedPlanError) as refused:
                    plan_cooperation(pair, COARSE, START)
                assert (refused.value.reason, refused.value.pose) == (reason, found.pose[row, column])
    assert seen >= {Reason.NONE, Reason.OUT_OF_REACH}
    assert sum(found.shares().values()) == pytest.approx(1.0)


def test_no_base_works_over_which_b_passes() -> None:
    """B runs from (0.274, -0.3) to (0.274, -0.325) and back."""
    near = reachability(PAIR, COARSE, START, [0.2743], np.linspace(-0.33, -0.30, 13))
    assert Reason.BASE_AXIS in near.shares()
    assert set(near.shares()) <= {Reason.BASE_AXIS, Reason.BRANCH_FLIP}


def test_joint_limits_show_in_the_map() -> None:
    narrow = replace(PAIR.slave, limits_deg=((-30.0, 30.0), *((-400.0, 400.0),) * 4))
    free = reachability(PAIR, COARSE, START, X_M, Y_M)
    limited = reachability(replace(PAIR, slave=narrow), COARSE, START, X_M, Y_M)
    assert limited.shares()[Reason.JOINT_LIMIT] > 0.1
    assert limited.shares()[Reason.NONE] < free.shares()[Reason.NONE]
    np.testing.assert_array_equal(np.isnan(limited.travel_ratio), limited.reason != Reason.NONE)
    np.testing.assert_array_equal(limited.reason[free.reason != Reason.NONE], free.reason[free.reason != Reason.NONE])


def test_the_map_names_the_pose_at_which_a_limit_is_passed() -> None:
    elbow = np.degrees(plan_cooperation(PAIR, COARSE, START).slave_rad[:, 2])
    highest = (elbow[0] + elbow.max()) / 2
    low = replace(PAIR.slave, limits_deg=(*((-400.0, 400.0),) * 2, (-100.0, highest), *((-400.0, 400.0),) * 2))
    found = reachability(replace(PAIR, slave=low), COARSE, START, [-0.28], [-0.30])
    assert found.reason == Reason.JOINT_LIMIT
    assert found.pose == np.flatnonzero(elbow > highest)[0] > 0


def test_the_arrangement_of_least_motion_is_the_least_of_all_and_a_plan_confirms_it() -> None:
    objects = [CarriedObject(length_m=0.6, grasp_distance_m=distance) for distance in (0.2, 0.3)]
    found = least_motion(PAIR, COARSE, START, X_M, Y_M, objects=objects)
    assert [each.travel_ratio for each in found] == sorted(each.travel_ratio for each in found)
    assert len(found) == len(objects) * len(POSTURES)
    best = found[0]
    plan = plan_cooperation(best.pair, COARSE, START, posture=best.posture)
    assert plan.travel_ratio == pytest.approx(best.travel_ratio, rel=1e-9)
    maps = [
        reachability(replace(PAIR, carried=carried), COARSE, START, X_M, Y_M, posture=posture)
        for carried in objects
        for posture in POSTURES
    ]
    assert best.travel_ratio == min(float(np.nanmin(each.travel_ratio)) for each in maps)


def test_there_is_none_where_none_works() -> None:
    assert least_motion(PAIR, COARSE, START, [3.0], [3.0]) == []


def test_a_grid_that_is_none_or_too_large_is_refused() -> None:
    with pytest.raises(CooperationError, match=r"x_m has shape \(0,\); must be a list of finite numbers in m"):
        reachability(PAIR, COARSE, START, [], [0.0])
    with pytest.raises(CooperationError, match="y_m must be a list of numbers in m"):
        reachability(PAIR, COARSE, START, [0.0], ["here"])
    with pytest.raises(CooperationError, match="places and 51 poses; must be at most 2e\\+08 poses in all"):
        reachability(PAIR, COARSE, START, np.linspace(0, 1, 3000), np.linspace(0, 1, 3000), posture=Posture())
