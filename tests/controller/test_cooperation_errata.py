"""Every row of docs/cooperation-errata.md: what the paper prints does not hold, and what stands beside it does.

Yaws are measured as the angle between a vector and the plane through the slave's base's axis and B, in plain numpy.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from canarm.cooperation import (
    RHINO_XR,
    CarriedObject,
    DhChain,
    PlanLimits,
    Posture,
    Reason,
    RefusedPlanError,
    circle,
    comply,
    follow,
    forward,
    inverse_branch,
    least_singular_value_m,
    plan_cooperation,
    position_jacobian,
    printed_steps,
    seen_from,
)
from tests.five_axis_arms import LAP, PAIR, START


def object_frames(
    roll_deg: float, pitch_deg: float = -10.0, base_m: tuple[float, float, float] = PAIR.slave_base_m
) -> np.ndarray:
    """o* along the lap from the slave's base, the master's tool rolled, and the object turned so that B stays."""
    start = START.copy()
    start[3:] = np.radians([pitch_deg, roll_deg])
    turned = replace(PAIR, carried=replace(PAIR.carried, theta_x_deg=90.0 - roll_deg), slave_base_m=base_m)
    q = follow(RHINO_XR, start, LAP.point_m + forward(RHINO_XR, start)[:3, 3])
    return seen_from(turned.base_transform, turned.carried.frame(forward(RHINO_XR, q)))


def yaw_deg(vectors: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """How far vectors stand out of the vertical plane through B."""
    normal = np.stack([-seen[:, 1, 3], seen[:, 0, 3], np.zeros(len(seen))], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return np.degrees(np.arcsin(np.clip(np.abs((vectors * normal).sum(axis=1)), 0.0, 1.0)))


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0)))


def test_the_second_clause_of_definition_1_contradicts_the_steps_and_cannot_be_met() -> None:
    """n_o = a_s in print. STEP 3 makes n_s = ±a_o, and leaves a_s across n_o; a hand along n_o has a yaw."""
    seen = object_frames(75.0)
    printed = printed_steps(seen).third
    np.testing.assert_allclose(np.abs((printed[:, :3, 0] * seen[:, :3, 2]).sum(axis=1)), 1.0, atol=1e-12)
    np.testing.assert_allclose((printed[:, :3, 2] * seen[:, :3, 0]).sum(axis=1), 0.0, atol=1e-12)
    assert yaw_deg(seen[:, :3, 0], seen).min() > 70.0
    right = comply(RHINO_XR, seen, Posture()).frame
    np.testing.assert_allclose(right[:, :3, 0], seen[:, :3, 2], atol=1e-15)
    np.testing.assert_allclose((right[:, :3, 2] * seen[:, :3, 2]).sum(axis=1), 0.0, atol=1e-15)
    assert yaw_deg(right[:, :3, 2], seen).max() < 1e-12


def test_w_is_a_translation_too() -> None:
    """Rotated alone, the slave's base would be where the master's is, and B 0.41 m from where it is."""
    rotated = PAIR.base_transform.copy()
    rotated[:3, 3] = 0.0
    frame = PAIR.carried.frame(forward(RHINO_XR, START[None]))
    missed = seen_from(rotated, frame)[0, :3, 3] - seen_from(PAIR.base_transform, frame)[0, :3, 3]
    assert np.linalg.norm(missed) == pytest.approx(math.hypot(0.28, 0.30))


@pytest.mark.parametrize(("from_end", "beside"), [(0.0, 0.0), (0.1, 0.1)])
def test_half_the_length_from_a_is_the_middle_only_if_a_is_the_end(from_end: float, beside: float) -> None:
    carried = CarriedObject(length_m=0.6)
    assert from_end + carried.distance_m - carried.length_m / 2 == pytest.approx(beside)
    assert CarriedObject(length_m=0.6, grasp_distance_m=0.3 - from_end).distance_m + from_end == pytest.approx(0.3)


def test_5_takes_the_shortest_step_and_not_that_of_least_energy() -> None:
    """Kinetic energy of masses at the ends of the links; weighted by them, the same displacement costs less."""
    masses_kg = (3.0, 2.2, 1.2, 0.5, 0.35)
    inertia = 1e-4 * np.eye(5)
    for count, mass in enumerate(masses_kg, start=1):
        part = DhChain(d_m=RHINO_XR.d_m[:count], a_m=RHINO_XR.a_m[:count], alpha_deg=RHINO_XR.alpha_deg[:count])
        moved = np.zeros((3, 5))
        moved[:, :count] = position_jacobian(part, START[:count])
        inertia += mass * moved.T @ moved
    jacobian, step = position_jacobian(RHINO_XR, START), np.array([0.0, -1e-4, 2e-4])
    shortest = follow(RHINO_XR, START, [forward(RHINO_XR, START)[:3, 3] + step], newton_steps=0)[0] - START
    weighted = np.linalg.solve(inertia, jacobian.T)
    cheapest = weighted @ np.linalg.solve(jacobian @ weighted, step)
    np.testing.assert_allclose(jacobian @ shortest, step, atol=1e-15)
    np.testing.assert_allclose(jacobian @ cheapest, step, atol=1e-15)
    assert np.linalg.norm(shortest) < np.linalg.norm(cheapest)
    assert cheapest @ inertia @ cheapest < 0.7 * (shortest @ inertia @ shortest)


def test_5_never_turns_the_roll_and_does_not_come_back_to_where_it_began() -> None:
    np.testing.assert_allclose(position_jacobian(RHINO_XR, START)[:, 4], 0.0, atol=1e-16)
    laps = plan_cooperation(PAIR, circle(laps=3, seconds=0.9), START)
    drift = np.degrees(laps.master_rad[[360, 720, 1080]] - laps.master_rad[0])
    np.testing.assert_array_equal(drift[:, 4], 0.0)
    np.testing.assert_allclose(np.abs(drift).max(axis=1), [0.0044, 0.0088, 0.0132], atol=1e-4)


def test_5_blows_up_near_a_singular_pose() -> None:
    """Stretched out, sigma_min is 0.007 m/rad, and steps of 0.22 mm take the tip 0.1 m away and more."""
    stretched = np.radians([0.0, 0.0, 0.0, -90.0, 90.0])
    assert least_singular_value_m(RHINO_XR, stretched) == pytest.approx(0.007, abs=5e-4)
    jacobian = position_jacobian(RHINO_XR, stretched)
    assert np.linalg.svd(jacobian, compute_uv=False)[-1] == pytest.approx(0.007, abs=5e-4)
    q, worst = stretched, 0.0
    target = LAP.point_m + forward(RHINO_XR, stretched)[:3, 3]
    for point in target:
        q = q + np.linalg.pinv(position_jacobian(RHINO_XR, q)) @ (point - forward(RHINO_XR, q)[:3, 3])
        worst = max(worst, float(np.linalg.norm(point - forward(RHINO_XR, q)[:3, 3])))
    assert worst > 0.1


def test_step_1_reaches_the_plane_through_b_and_the_axis_but_not_the_line_between_them() -> None:
    seen = object_frames(75.0)
    first = printed_steps(seen).first
    line = seen[:, :3, 3] / np.linalg.norm(seen[:, :3, 3], axis=1)[:, None]
    assert yaw_deg(first[:, :3, 2], seen).max() < 1e-12
    assert np.minimum(angle_deg(first[:, :3, 2], line), angle_deg(-first[:, :3, 2], line)).min() > 10.0


def test_a_2_of_8_is_no_unit_vector_unless_step_1_does_not_turn() -> None:
    seen = object_frames(75.0, pitch_deg=-50.0, base_m=(0.0, -0.7, 0.0))
    steps = printed_steps(seen)
    length = np.linalg.norm(np.cross(seen[:, :3, 2], steps.first[:, :3, 0]), axis=1)
    np.testing.assert_allclose(length, np.abs(np.cos(steps.theta_1s_rad)), atol=1e-12)
    assert np.abs(length - 1.0).max() > 1e-3


def test_the_axes_are_the_columns_of_10_and_11_and_not_their_rows() -> None:
    """'The third row vector' is to be a_2, 'the first row vector' n_3."""
    steps = printed_steps(object_frames(75.0))
    a_o = object_frames(75.0)[:, :3, 2]
    np.testing.assert_allclose((steps.third[:, :3, 0] * a_o).sum(axis=1), 1.0, atol=1e-12)
    assert np.abs((steps.third[:, 0, :3] * a_o).sum(axis=1) - 1.0).min() > 0.1
    np.testing.assert_allclose(steps.second[:, :3, 2], steps.third[:, :3, 2], atol=1e-12)
    assert angle_deg(steps.second[:, 2, :3], steps.third[:, :3, 2]).min() > 10.0


@pytest.mark.parametrize(("roll_deg", "worst_deg"), [(90.0, 2.67), (75.0, 15.0), (60.0, 30.0), (30.0, 60.0)])
def test_the_steps_as_printed_lead_along_o_o_wherever_the_slave_stands_and_miss_by_its_yaw(
    roll_deg: float, worst_deg: float
) -> None:
    seen = object_frames(roll_deg)
    steps = printed_steps(seen)
    hand = steps.third[:, :3, 2]
    np.testing.assert_allclose(np.abs((hand * seen[:, :3, 1]).sum(axis=1)), 1.0, atol=1e-12)
    assert (hand[10:350, :2] * seen[10:350, :2, 3]).sum(axis=1).min() > 0.0  # away from the slave's base
    np.testing.assert_allclose(yaw_deg(hand, seen), np.degrees(steps.yaw_rad), atol=1e-6)
    assert np.degrees(steps.yaw_rad).max() == pytest.approx(worst_deg, abs=0.01)
    assert set(inverse_branch(RHINO_XR, steps.third[10:350]).reason) == {Reason.YAW}
    exact = comply(RHINO_XR, seen, Posture())
    assert set(exact.reason) == {Reason.NONE}
    reached = forward(RHINO_XR, exact.q_rad)
    np.testing.assert_allclose(reached, exact.frame, atol=1e-12)


def test_of_the_two_turns_of_step_1_the_one_is_taken_after_which_the_hand_points_away_from_the_base() -> None:
    """The paper does not say which. Objects in any direction; the other steps hold for all of them."""
    seen = forward(RHINO_XR, np.random.default_rng(4).uniform(-math.pi, math.pi, (500, 5)))
    hand = printed_steps(seen).third[:, :3, 2]
    assert (hand[:, :2] * seen[:, :2, 3]).sum(axis=1).min() > -1e-12
    np.testing.assert_allclose(np.abs((hand * seen[:, :3, 1]).sum(axis=1)), 1.0, atol=1e-12)


def test_step_2_always_turns_by_a_right_angle_and_step_3_undoes_step_1() -> None:
    """So neither plays the part of θ4 or θ5, which the text gives them: those follow from T_s4 alone."""
    seen = object_frames(75.0)
    steps = printed_steps(seen)
    first, second, third = steps.first[:, :3, :3], steps.second[:, :3, :3], steps.third[:, :3, :3]
    np.testing.assert_allclose((first[:, :, 2] * second[:, :, 2]).sum(axis=1), 0.0, atol=1e-12)
    np.testing.assert_allclose((third[:, :, 0] * seen[:, :3, 2]).sum(axis=1), 1.0, atol=1e-12)
    joints = comply(RHINO_XR, seen, Posture()).q_rad
    assert np.ptp(np.degrees(joints[:, 3])) > 1.0  # θ4 moves while the turn of STEP 2 stays


def test_12_leaves_the_sign_open_which_is_half_a_turn_of_the_roll() -> None:
    plus, minus = (comply(RHINO_XR, object_frames(75.0), Posture(normal=normal)).q_rad for normal in (1, -1))
    np.testing.assert_allclose(plus[:, :4], minus[:, :4], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.degrees(plus[:, 4] - minus[:, 4])), 180.0, atol=1e-9)


def test_a_solution_does_not_always_exist() -> None:
    """Even of the right steps: of slave bases within 1 m, the circle of the paper works from less than half."""
    random = np.random.default_rng(3)
    bases = np.tile(PAIR.base_transform, (2000, 1, 1))
    bases[:, :2, 3] = random.uniform(-1.0, 1.0, (2000, 2))
    seen = seen_from(bases, PAIR.carried.frame(forward(RHINO_XR, START[None])))
    reason = comply(RHINO_XR, seen, Posture()).reason[:, 0]
    assert 0.1 < np.mean(reason == Reason.NONE) < 0.5
    assert np.mean(reason == Reason.OUT_OF_REACH) > 0.4


def test_joint_paths_are_not_continuous_wherever_there_is_a_solution_at_every_pose() -> None:
    """B passes 0.02 mm beside the axis of the base: every pose has a solution, and the waist swings round at once."""
    master = forward(RHINO_XR, follow(RHINO_XR, START, LAP.point_m + forward(RHINO_XR, START)[:3, 3]))
    x, y, _ = PAIR.carried.frame(master)[45, :3, 3].tolist()
    pair = replace(PAIR, slave_base_m=(x + 2e-5, y, 0.0))
    found = comply(RHINO_XR, seen_from(pair.base_transform, pair.carried.frame(master)), Posture())
    assert set(found.reason) == {Reason.NONE}
    assert np.degrees(np.abs(np.diff(np.unwrap(found.q_rad[:, 0])))).max() > 60.0
    with pytest.raises(RefusedPlanError) as refused:
        plan_cooperation(pair, LAP, START)
    assert refused.value.reason is Reason.BASE_AXIS
    with pytest.raises(RefusedPlanError, match="joint 1 would turn by") as refused:
        plan_cooperation(pair, LAP, START, limits=PlanLimits(least_axis_distance_m=0.0))
    assert refused.value.reason is Reason.BRANCH_FLIP
