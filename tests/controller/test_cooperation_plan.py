"""A path in, ten joint paths out: the case that works to its figures, and those that do not, with their reasons.

The working case's figures come from an independent script of the paper's equations with numpy's pseudo-inverse and
matrix products; so do the cosines and singular values of the cases that fail.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pinocchio
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from canarm.cooperation import (
    RHINO_XR,
    ArmPair,
    CarriedObject,
    CooperationError,
    CooperationPlan,
    FiveAxisArm,
    Path,
    PlanChecks,
    PlanLimits,
    Posture,
    Reason,
    RefusedPlanError,
    arc,
    circle,
    comply,
    follow,
    forward,
    inverse_branch,
    line,
    pair_of,
    plan_cooperation,
    position_jacobian,
    seen_from,
)
from canarm_protocol.cell.cell_file import load_cell
from tests.five_axis_arms import LAP, MIRRORED, PAIR, START, pinocchio_model

OTHER_START = np.radians([0.0, -60.0, 100.0, -130.0, 90.0])
STRETCHED = np.radians([0.0, 0.0, 0.0, -90.0, 90.0])


def degrees_apart(a: np.ndarray, b: object) -> float:
    """The greatest difference of angles, whatever full turns are between them."""
    return float(np.abs((np.degrees(a) - np.array(b) + 180.0) % 360.0 - 180.0).max())


def standing(x_m: float, y_m: float) -> ArmPair:
    return replace(PAIR, slave_base_m=(x_m, y_m, 0.0))


def test_the_half_inch_circle_is_planned_to_the_figures_of_an_independent_computation() -> None:
    plan = plan_cooperation(PAIR, LAP, START, newton_steps=0)
    checks = plan.checks()
    assert len(plan.time_s) == 361
    assert degrees_apart(plan.slave_rad[0], [0.0, -33.5157, 64.7664, -121.2507, -180.0]) < 1e-4
    assert math.degrees(checks.master_step_rad) == pytest.approx(0.046196, abs=1e-6)
    assert math.degrees(checks.slave_step_rad) == pytest.approx(0.102658, abs=1e-6)
    assert checks.path_error_m == pytest.approx(9.065e-8, rel=1e-3)
    np.testing.assert_array_equal(plan.master_rad[:, 4], START[4])  # the roll rests
    drift = np.degrees(plan.master_rad[-1] - plan.master_rad[0])
    assert np.abs(drift).max() == pytest.approx(0.00443, abs=1e-5)  # and a lap does not close


def test_the_circle_is_half_an_inch_in_radius_in_the_y_z_plane_and_closes() -> None:
    plan = plan_cooperation(PAIR, LAP, START)
    tip = forward(RHINO_XR, plan.master_rad)[:, :3, 3]
    centre = tip[0] - [0.0, 0.0127, 0.0]
    np.testing.assert_allclose(np.linalg.norm(tip - centre, axis=1), 0.0127, atol=1e-12)
    np.testing.assert_allclose(tip[:, 0], tip[0, 0], atol=1e-12)
    np.testing.assert_allclose(tip[-1], tip[0], atol=1e-12)


def test_definition_1_and_the_grasp_hold_along_the_path_by_an_independent_library() -> None:
    plan = plan_cooperation(PAIR, circle(), START)
    model = pinocchio_model(RHINO_XR)
    data, tip = model.createData(), model.getFrameId("tip")

    def pose(q: np.ndarray) -> np.ndarray:
        pinocchio.framesForwardKinematics(model, data, q)
        return np.array(data.oMf[tip].homogeneous)

    base = np.eye(4)
    base[:3, 3] = -0.28, -0.30, 0.0
    for master_rad, slave_rad in zip(plan.master_rad, plan.slave_rad, strict=True):
        master, slave = pose(master_rad), base @ pose(slave_rad)
        assert abs(slave[:3, 2] @ master[:3, 2]) < 1e-9
        np.testing.assert_allclose(slave[:3, 0], master[:3, 2], atol=1e-9)
        np.testing.assert_allclose(slave[:3, 3], (master @ [0.3, 0.0, 0.0, 1.0])[:3], atol=1e-12)
        assert np.linalg.norm(slave[:3, 3] - master[:3, 3]) == pytest.approx(0.3, abs=1e-12)
    checks = plan.checks()
    assert max(checks.perpendicular_error, checks.normal_error) < 1e-9
    assert max(checks.grasp_error_m, checks.point_error_m, checks.path_error_m) < 1e-12


def test_all_ten_joint_paths_are_continuous_at_400_hz() -> None:
    checks = plan_cooperation(PAIR, circle(), START).checks()  # 5 s a lap: 2000 steps of 40 um
    assert math.degrees(checks.master_step_rad) == pytest.approx(0.00832, abs=1e-5)
    assert math.degrees(checks.slave_step_rad) == pytest.approx(0.01848, abs=1e-5)


@pytest.mark.parametrize(
    ("pair", "start", "reason", "robot", "said"),
    [
        (standing(-0.28, -0.90), START, Reason.OUT_OF_REACH, "slave", "cosine would be 3.03"),
        (
            replace(PAIR, carried=CarriedObject(length_m=1.6)),
            START,
            Reason.OUT_OF_REACH,
            "slave",
            "cosine would be 2.20",
        ),
        (standing(0.2743, -0.30), START, Reason.BASE_AXIS, "slave", "B is 0.023 mm from it; must be at least 10 mm"),
        (standing(0.4577, -0.65), OTHER_START, Reason.PARALLEL, "slave", r"\|a_o x h\| = 5.07e-05; must be at least"),
        (standing(0.4477, -0.65), OTHER_START, Reason.PARALLEL, "slave", r"\|a_o x h\| = 0.0286; must be at least"),
        (PAIR, STRETCHED, Reason.SINGULAR, "master", "sigma_min of its Jacobian is 0.007 m/rad; must be at least 0.03"),
    ],
    ids=["base too far", "grasp too far", "on the axis", "parallel", "flips", "stretched"],
)
def test_what_cannot_be_done_is_refused_with_its_reason_before_anything_moves(
    pair: ArmPair, start: np.ndarray, reason: Reason, robot: str, said: str
) -> None:
    with pytest.raises(RefusedPlanError, match=said) as refused:
        plan_cooperation(pair, LAP, start)
    assert (refused.value.reason, refused.value.robot, refused.value.pose) == (reason, robot, 0)
    assert "\n" not in str(refused.value)


def test_a_hand_that_points_outward_at_every_pose_would_turn_round_at_once() -> None:
    """The base of the case "flips": chosen at every pose, s2 changes sign; kept, the hand spins instead."""
    master = forward(RHINO_XR, follow(RHINO_XR, OTHER_START, LAP.point_m + forward(RHINO_XR, OTHER_START)[:3, 3]))
    pair = standing(0.4477, -0.65)
    seen = seen_from(pair.base_transform, pair.carried.frame(master))
    anew = comply(RHINO_XR, seen[:, None], Posture(), least_crossing=0.0).frame[:, 0, :3, 2]
    turned = np.degrees(np.arccos(np.clip((anew[1:] * anew[:-1]).sum(axis=1), -1.0, 1.0)))
    assert turned.max() > 178.0
    with pytest.raises(RefusedPlanError, match=r"joint 3 would turn by .* deg from one pose to the next") as refused:
        plan_cooperation(pair, LAP, OTHER_START, posture=Posture(approach=1), limits=PlanLimits(least_crossing=0.0))
    assert refused.value.reason is Reason.BRANCH_FLIP


def test_the_same_path_through_the_stretched_pose_can_be_damped_but_not_followed_exactly() -> None:
    """Undamped, (5) leaves the path by 0.18 m there. Inwards, damping keeps the tip within a tenth of a millimetre."""
    inwards = line((-0.02, 0.0, -0.02), seconds=1.0)
    with pytest.raises(RefusedPlanError) as refused:
        plan_cooperation(PAIR, inwards, STRETCHED)
    assert refused.value.reason is Reason.SINGULAR
    target = inwards.point_m + forward(RHINO_XR, STRETCHED)[:3, 3]
    damped = follow(RHINO_XR, STRETCHED, target, damping_m=0.01)
    error = np.linalg.norm(forward(RHINO_XR, damped)[:, :3, 3] - target, axis=1)
    assert 1e-6 < error.max() < 5e-3
    assert error[-1] < 1e-12


def test_each_step_of_5_is_the_pseudo_inverse_of_the_whole_jacobian() -> None:
    for arm, start in ((RHINO_XR, START), (MIRRORED, np.radians([20.0, -50.0, -60.0, 30.0, 10.0]))):
        target = forward(arm, start)[:3, 3] + LAP.point_m[:40]
        found = follow(arm, start, target, newton_steps=0)
        q = start
        for point, ours in zip(target, found, strict=True):
            q = q + np.linalg.pinv(position_jacobian(arm, q)) @ (point - forward(arm, q)[:3, 3])
            np.testing.assert_allclose(ours, q, atol=1e-13)


def test_damping_is_that_of_the_damped_jacobian_where_the_plane_is_singular() -> None:
    q = np.radians([0.0, -5.0, 10.0, -93.0, 0.0])
    jacobian = position_jacobian(RHINO_XR, q)
    sigma = np.linalg.svd(jacobian, compute_uv=False)[-1]
    point = forward(RHINO_XR, q)[:3, 3] + [-1e-4, 0.0, 2e-4]
    squared = 0.02**2 * (1.0 - (sigma / 0.05) ** 2)
    plane = jacobian @ jacobian.T + squared * np.diag([1.0, 0.0, 1.0])  # the waist alone is far from singular
    expected = q + jacobian.T @ np.linalg.solve(plane, point - forward(RHINO_XR, q)[:3, 3])
    found = follow(RHINO_XR, q, [point], newton_steps=0, damping_m=0.02, damped_below_m=0.05)
    assert sigma < 0.05
    np.testing.assert_allclose(found[0], expected, atol=1e-12)


def test_damping_is_that_of_the_damped_jacobian_where_the_tip_is_near_the_waists_axis() -> None:
    downward = np.diag([1.0, -1.0, -1.0, 1.0])
    downward[:3, 3] = 0.03, 0.02, 0.35
    q = inverse_branch(RHINO_XR, downward).q_rad
    tip, jacobian = forward(RHINO_XR, q)[:3, 3], position_jacobian(RHINO_XR, q)
    distance = math.hypot(tip[0], tip[1])
    assert distance < 0.05
    across = np.array([-math.sin(q[0]), math.cos(q[0]), 0.0])
    point = tip + 1e-4 * across
    damped = jacobian @ jacobian.T + 0.02**2 * (1.0 - (distance / 0.05) ** 2) * np.outer(across, across)
    found = follow(RHINO_XR, q, [point], newton_steps=0, damping_m=0.02, damped_below_m=0.05)
    np.testing.assert_allclose(found[0], q + jacobian.T @ np.linalg.solve(damped, point - tip), atol=1e-12)


def test_a_damped_plan_may_pass_singular_poses_and_states_how_far_the_tip_lags() -> None:
    pair, inwards = standing(0.2755, -0.30), line((-0.02, 0.0, -0.02), seconds=1.0)
    limits = PlanLimits(largest_path_error_m=5e-3)
    with pytest.raises(RefusedPlanError):
        plan_cooperation(pair, inwards, STRETCHED, limits=limits)
    plan = plan_cooperation(pair, inwards, STRETCHED, damping_m=0.01, limits=limits)
    assert plan.checks().least_singular_value_m < 0.01
    assert 1e-6 < plan.checks().path_error_m < 5e-3


def test_a_hand_that_must_point_straight_up_or_down_points_down() -> None:
    """The object's approach level and towards or away from the slave, B straight ahead at x = 0.4 m."""
    for heading in (1.0, -1.0):
        seen = np.eye(4)
        seen[:3, :3] = np.array([[0.0, 0.0, heading], [0.0, heading, 0.0], [-1.0, 0.0, 0.0]])
        seen[:3, 3] = 0.4, 0.0, 0.3
        found = comply(RHINO_XR, seen[None], Posture())
        np.testing.assert_allclose(found.frame[0, :3, 2], [0.0, 0.0, -1.0], atol=1e-15)


def test_newton_steps_take_the_error_from_its_square_to_rounding() -> None:
    errors = [plan_cooperation(PAIR, LAP, START, newton_steps=n).checks().path_error_m for n in range(4)]
    assert errors[0] == pytest.approx(9.07e-8, rel=0.01)
    assert errors[1] < 1e-13
    assert errors[2] < 5e-16
    coarse = plan_cooperation(PAIR, circle(seconds=0.45), START, newton_steps=0).checks().path_error_m
    assert coarse / errors[0] == pytest.approx(4.0, rel=0.02)  # of the order of the step's square


def test_the_checks_of_a_plan_are_of_its_joint_angles_and_see_what_is_wrong_with_them() -> None:
    """A roll 0.01 rad off turns the normal by as much, a pitch the hand; a waist moves the tip by 0.01 of its reach."""
    plan = plan_cooperation(PAIR, LAP, START)

    def off_by(robot: str, joint: int) -> PlanChecks:
        angles = getattr(plan, robot).copy()
        angles[:, joint] += 0.01
        return replace(plan, **{robot: angles}).checks()

    assert off_by("slave_rad", 4).normal_error == pytest.approx(0.01, rel=1e-3)
    assert off_by("slave_rad", 3).perpendicular_error == pytest.approx(0.01, rel=1e-3)
    assert off_by("slave_rad", 0).point_error_m == pytest.approx(0.0056, abs=2e-4)
    assert off_by("slave_rad", 3).grasp_error_m > 1e-6
    assert off_by("master_rad", 0).path_error_m == pytest.approx(0.00274, rel=0.02)


def test_the_path_of_the_master_ends_where_5_would_leap() -> None:
    here = forward(RHINO_XR, START)[:3, 3]
    found = follow(RHINO_XR, START, here + np.array([[0, 0, 0], [0, 0.01, 0], [0, 0.6, -0.5], [0, 0, 0]]))
    assert np.isfinite(found[:2]).all()
    assert np.isnan(found[2:]).all()


@pytest.mark.parametrize("normal", [1, -1])
@pytest.mark.parametrize("elbow", [1, -1])
@pytest.mark.parametrize("approach", [1, -1])
def test_every_posture_keeps_definition_1(approach: int, elbow: int, normal: int) -> None:
    posture = Posture(approach=approach, elbow=elbow, normal=normal)
    plan = plan_cooperation(standing(0.15, -0.55), LAP, START, posture=posture)
    checks = plan.checks()
    assert plan.posture == posture
    assert max(checks.perpendicular_error, checks.normal_error, checks.grasp_error_m, checks.point_error_m) < 1e-12
    assert (np.sign(np.sin(plan.slave_rad[:, 2])) == elbow).all()


def test_the_other_normal_turns_the_roll_by_half_a_turn_and_nothing_else() -> None:
    one, other = (plan_cooperation(PAIR, LAP, START, posture=Posture(normal=normal)) for normal in (1, -1))
    np.testing.assert_allclose(other.slave_rad[:, :4], one.slave_rad[:, :4], atol=1e-12)
    assert degrees_apart(other.slave_rad[:, 4], np.degrees(one.slave_rad[:, 4]) + 180.0) < 1e-9
    assert other.travel_ratio == pytest.approx(one.travel_ratio, rel=1e-9)


def test_a_tilted_slave_of_another_shape_and_an_object_at_an_angle_work_as_well() -> None:
    pair = ArmPair(
        master=MIRRORED,
        slave=RHINO_XR,
        carried=CarriedObject(length_m=0.5, grasp_distance_m=0.35, theta_x_deg=25.0, theta_z_deg=-10.0),
        slave_base_m=(0.6, 0.4, 0.1),
        slave_base_rpy_deg=(8.0, -5.0, 120.0),
    )
    plan = plan_cooperation(pair, circle(0.02, plane="zx"), np.radians([20.0, -50.0, -60.0, 30.0, 10.0]))
    checks = plan.checks()
    assert max(checks.perpendicular_error, checks.normal_error) < 1e-12
    assert max(checks.grasp_error_m, checks.point_error_m, checks.path_error_m) < 1e-12


def test_joint_limits_of_either_arm_refuse_the_plan_and_name_the_joint() -> None:
    def limited(low: float, high: float, joint: int) -> FiveAxisArm:
        limits = [(-400.0, 400.0)] * 5
        limits[joint - 1] = (low, high)
        return replace(RHINO_XR, limits_deg=tuple(limits))

    with pytest.raises(RefusedPlanError, match=r"joint 4 would be at -121\.3 deg; must be within") as refused:
        plan_cooperation(replace(PAIR, slave=limited(-120.0, 120.0, 4)), LAP, START)
    assert (refused.value.reason, refused.value.robot) == (Reason.JOINT_LIMIT, "slave")
    with pytest.raises(RefusedPlanError, match=r"joint 2 would be at -80.* deg; must be within -80") as refused:
        plan_cooperation(replace(PAIR, master=limited(-80.0, 0.0, 2)), LAP, START)
    assert (refused.value.reason, refused.value.robot) == (Reason.JOINT_LIMIT, "master")
    elbow = np.degrees(plan_cooperation(PAIR, LAP, START).slave_rad[:, 2])
    highest = (elbow[0] + elbow.max()) / 2
    with pytest.raises(RefusedPlanError, match="joint 3 would be at") as refused:
        plan_cooperation(replace(PAIR, slave=limited(-100.0, highest, 3)), LAP, START)
    assert refused.value.pose == np.flatnonzero(elbow > highest)[0] > 10
    turned = plan_cooperation(replace(PAIR, slave=limited(90.0, 300.0, 5)), LAP, START)
    assert np.degrees(turned.slave_rad[:, 4]).min() > 170.0


def test_a_master_that_is_led_beyond_its_reach_is_told_how_far_the_point_is() -> None:
    with pytest.raises(RefusedPlanError, match=r"m from the shoulder; the arm reaches 0\.626 m") as refused:
        plan_cooperation(PAIR, Path(np.array([0.0, 1.0]), np.array([[0.9, 0, 0], [0.9, 0, 0.1]]), False), START)
    assert (refused.value.reason, refused.value.robot, refused.value.pose) == (Reason.OUT_OF_REACH, "master", 0)


def test_steps_too_large_for_5_are_refused_as_off_the_path() -> None:
    with pytest.raises(RefusedPlanError, match=r"the tip would be .* mm beside it; at most 0\.1 mm") as refused:
        plan_cooperation(PAIR, circle(0.05, seconds=0.03), START, newton_steps=0)
    assert (refused.value.reason, refused.value.robot) == (Reason.OFF_PATH, "master")


def test_a_path_so_coarse_that_the_masters_joints_leap_is_refused() -> None:
    with pytest.raises(RefusedPlanError, match="from one pose to the next; at most 5 deg") as refused:
        plan_cooperation(PAIR, circle(0.05, seconds=0.02), START)
    assert (refused.value.reason, refused.value.robot) == (Reason.BRANCH_FLIP, "master")


def test_a_slave_with_a_straight_elbow_is_refused_as_singular() -> None:
    y_m = next(y for y in np.arange(-0.30, -0.60, -0.0005).tolist() if _elbow_cosine(standing(-0.28, y)) > 0.9992)
    with pytest.raises(RefusedPlanError, match=r"the elbow is straight or folded, its cosine is 0\.99") as refused:
        plan_cooperation(standing(-0.28, y_m), LAP, START)
    assert refused.value.reason is Reason.SINGULAR


def _elbow_cosine(pair: ArmPair) -> float:
    seen = seen_from(pair.base_transform, pair.carried.frame(forward(RHINO_XR, START[None])))
    return float(comply(RHINO_XR, seen, Posture()).elbow_cosine[0])


def test_a_path_of_places_begins_where_the_tip_is_led_to_first() -> None:
    here = forward(RHINO_XR, START)[:3, 3]
    path = Path(LAP.time_s, LAP.point_m + here + [0.0, 0.004, 0.003], from_start=False)
    plan = plan_cooperation(PAIR, path, START)
    assert plan.checks().path_error_m < 1e-12
    np.testing.assert_allclose(plan.target_m[0], here + np.array([0.0, 0.004, 0.003]), atol=1e-15)


@pytest.mark.parametrize(
    "path", [line((0.02, 0.0, 0.03)), arc(0.03, -120.0, plane="xy", start_deg=30.0), circle(0.00635, laps=3)]
)
def test_lines_arcs_and_several_laps_are_planned_as_well(path: Path) -> None:
    checks = plan_cooperation(PAIR, path, START).checks()
    assert max(checks.path_error_m, checks.grasp_error_m, checks.normal_error, checks.perpendicular_error) < 1e-12


def test_a_longer_object_and_another_grasp_move_b_as_2_says() -> None:
    """K = L/2 unless given; cos and sin of 30 and 40 degrees."""
    tip = np.eye(4)
    assert CarriedObject(length_m=0.8).distance_m == 0.4
    carried = CarriedObject(length_m=1.0, grasp_distance_m=0.2, theta_x_deg=30.0, theta_z_deg=40.0)
    expected = 0.2 * np.array([0.766044443 * 0.866025404, 0.766044443 * 0.5, 0.642787610])
    np.testing.assert_allclose(carried.frame(tip)[:3, 3], expected, atol=1e-9)
    np.testing.assert_array_equal(carried.frame(tip)[:3, :3], np.eye(3))


def test_the_pair_of_a_cell_stands_where_its_bases_are() -> None:
    robot = load_cell("konkuk1").robot[0]
    link = robot.joint[0].dh_link
    joints = tuple(
        robot.joint[0].model_copy(
            update={"link": link.model_copy(update={"a_m": a, "d_m": d, "alpha_deg": alpha}), "limits_deg": (-400, 400)}
        )
        for a, d, alpha in zip(RHINO_XR.a_m, RHINO_XR.d_m, RHINO_XR.alpha_deg, strict=True)
    )
    master, slave = (
        robot.model_copy(update={"name": name, "joint": joints, "base_m": base, "base_rpy_deg": rpy})
        for name, base, rpy in (
            ("left", (1.0, 2.0, 0.5), (0.0, 0.0, 90.0)),
            ("right", (1.3, 1.72, 0.5), (10.0, 20.0, 120.0)),
        )
    )
    pair = pair_of(master, slave, PAIR.carried)
    world = pinocchio.SE3(pinocchio.utils.rotate("z", math.pi / 2), np.array([1.0, 2.0, 0.5]))
    other = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(*np.radians([10.0, 20.0, 120.0])), np.array([1.3, 1.72, 0.5]))
    np.testing.assert_allclose(pair.base_transform, (world.inverse() * other).homogeneous, atol=1e-12)
    assert pair.names == ("left", "right")
    level = pair_of(master, slave.model_copy(update={"base_rpy_deg": (0.0, 0.0, 90.0)}), PAIR.carried)
    np.testing.assert_allclose(level.slave_base_m, (-0.28, -0.30, 0.0), atol=1e-12)
    assert plan_cooperation(level, LAP, START).checks().grasp_error_m < 1e-12


def test_the_columns_of_a_plan_are_a_trajectory_in_degrees(tmp_path: FilePath) -> None:
    plan = plan_cooperation(PAIR, LAP, START)
    plan.write_csv(tmp_path / "lap.csv")
    with (tmp_path / "lap.csv").open(encoding="utf-8") as stream:
        header, *rows = list(csv.reader(stream))
    assert header[:2] == ["time_s", "master_joint1_deg"]
    assert header[-1] == "slave_joint5_deg"
    np.testing.assert_array_equal(np.array(rows, float)[:, 1:], np.degrees(plan.joint_rad))
    named = plan.columns([f"axis{i}" for i in range(10)])
    assert list(named) == ["time_s", *(f"axis{i}" for i in range(10))]
    with pytest.raises(CooperationError, match="9 names; must be one for each of the ten joints"):
        plan.columns(["axis"] * 9)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: CarriedObject(length_m=0.0), "length_m = 0.0; must be positive"),
        (
            lambda: CarriedObject(length_m=0.6, grasp_distance_m=0.8),
            "grasp_distance_m = 0.8; must be above 0",
        ),
        (lambda: CarriedObject(length_m=0.6, theta_x_deg=math.nan), "theta_x_deg = nan; must be finite"),
        (lambda: replace(PAIR, slave_base_m=(0.0, math.inf, 0.0)), "slave_base_m = .*; must be three finite numbers"),
        (lambda: Posture(elbow=0), "elbow = 0; must be 1 or -1"),
        (lambda: PlanLimits(least_crossing=-1.0), "least_crossing = -1.0; must be 0 or more"),
        (lambda: plan_cooperation(PAIR, LAP, START[:4]), r"joint angles have shape \(4,\); must be"),
        (lambda: plan_cooperation(PAIR, LAP, START, newton_steps=-1), "newton_steps = -1, damping_m = 0.0; must be"),
        (lambda: plan_cooperation(PAIR, LAP, START * math.nan), "the start is .*; must be 5 finite angles in rad"),
        (lambda: plan_cooperation(PAIR, LAP, START[None]), "the start is .*; must be 5 finite angles in rad"),
    ],
)
def test_what_fits_nothing_is_refused_in_one_line(make: object, said: str) -> None:
    with pytest.raises(CooperationError, match=said):
        make()  # type: ignore[operator]


LENGTHS_M = st.floats(0.1, 0.4)
ANGLES_DEG = st.floats(-180.0, 180.0)


@settings(max_examples=150)
@given(
    start_deg=st.tuples(*(ANGLES_DEG,) * 5),
    away_m=st.tuples(st.floats(0.1, 0.5), st.floats(-0.4, 0.1)),
    side_deg=ANGLES_DEG,
    rpy_deg=st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), ANGLES_DEG),
    directions_deg=st.tuples(ANGLES_DEG, st.floats(-90.0, 90.0)),
    lengths_m=st.tuples(LENGTHS_M, LENGTHS_M, LENGTHS_M),
    signs=st.tuples(*(st.sampled_from((1, -1)),) * 4),
)
def test_a_plan_keeps_what_it_promises_or_is_refused(
    start_deg: tuple[float, ...],
    away_m: tuple[float, float],
    side_deg: float,
    rpy_deg: tuple[float, float, float],
    directions_deg: tuple[float, float],
    lengths_m: tuple[float, float, float],
    signs: tuple[int, int, int, int],
) -> None:
    """Any two arms of the shape, a base anywhere about B, any object and posture: a reason, or a path that holds."""
    arm = replace(RHINO_XR, a_m=(0.02, lengths_m[0], lengths_m[1], 0.0095, 0.0))
    carried = CarriedObject(length_m=2 * lengths_m[2], theta_x_deg=directions_deg[0], theta_z_deg=directions_deg[1])
    b = carried.frame(forward(RHINO_XR, np.radians(start_deg)))[:3, 3]
    side = math.radians(side_deg)
    x, y, z = (b + np.array([away_m[0] * math.cos(side), away_m[0] * math.sin(side), away_m[1]])).tolist()
    base_m = (x, y, z)
    pair = ArmPair(master=RHINO_XR, slave=arm, carried=carried, slave_base_m=base_m, slave_base_rpy_deg=rpy_deg)
    posture = Posture(approach=signs[0], normal=signs[1], elbow=signs[2], facing=signs[3])
    try:
        plan = plan_cooperation(pair, circle(seconds=0.3), np.radians(start_deg), posture=posture)
    except RefusedPlanError as refused:
        event(refused.reason.name)
        return
    event("planned")
    checks, limits = plan.checks(), PlanLimits()
    assert max(checks.perpendicular_error, checks.normal_error) < 1e-9
    assert max(checks.grasp_error_m, checks.point_error_m, checks.path_error_m) < 1e-12
    assert max(checks.master_step_rad, checks.slave_step_rad) <= math.radians(limits.largest_step_deg)
    assert checks.least_singular_value_m >= limits.least_singular_value_m
    assert (np.sign(np.sin(plan.slave_rad[:, 2])) == signs[2]).all()


def test_a_plan_knows_how_far_each_arm_moves() -> None:
    plan: CooperationPlan = plan_cooperation(PAIR, LAP, START)
    lengths = [np.linalg.norm(np.diff(q, axis=0), axis=1).sum() for q in (plan.master_rad, plan.slave_rad)]
    np.testing.assert_allclose(plan.travel_rad, lengths, rtol=1e-12)
    assert plan.travel_ratio == pytest.approx(0.53367 / 0.27078, rel=1e-4)
