"""Five-axis arms there and back: forward kinematics and Jacobian against Pinocchio, the closed form against both."""

import math
from itertools import pairwise

import numpy as np
import pinocchio
import pytest

from canarm.cooperation import (
    BRANCHES,
    RHINO_XR,
    CooperationError,
    DhChain,
    FiveAxisArm,
    Reason,
    forward,
    inverse,
    inverse_branch,
    least_singular_value_m,
    position_jacobian,
)
from canarm_protocol.cell.cell_file import load_cell
from tests.five_axis_arms import MIRRORED, pinocchio_model

MIXED = FiveAxisArm(d_m=(0.1, 0, 0, 0, 0.12), a_m=(-0.03, 0.2, 0.31, 0.0, 0), alpha_deg=(-90, 0, 0, 90, 0))
ARMS = {"rhino": RHINO_XR, "mirrored": MIRRORED, "mixed": MIXED}
ANY_CHAIN = DhChain(
    d_m=(0.1, -0.2, 0.3, 0.0, 0.15, 0.07, 0.11),
    a_m=(0.3, 0.0, -0.1, 0.2, 0.0, 0.05, 0.02),
    alpha_deg=(40.0, -90.0, 13.0, 90.0, -77.0, 180.0, 5.0),
    theta_offset_deg=(0.0, 30.0, -90.0, 12.0, 0.0, 180.0, -3.0),
)


def random_angles(chain: DhChain, count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-math.pi, math.pi, (count, chain.joint_count))


def rotated(pose: np.ndarray, axis: str, angle: float) -> np.ndarray:
    turned = pose.copy()
    turned[:3, :3] = pose[:3, :3] @ pinocchio.utils.rotate(axis, angle)
    return turned


@pytest.mark.parametrize("chain", [*ARMS.values(), ANY_CHAIN], ids=[*ARMS, "seven twisted joints"])
def test_tip_and_jacobian_are_those_of_pinocchio(chain: DhChain) -> None:
    model = pinocchio_model(chain)
    data, tip = model.createData(), model.getFrameId("tip")
    q = random_angles(chain, 300)
    poses, jacobians = forward(chain, q), position_jacobian(chain, q)
    for each, pose, jacobian in zip(q, poses, jacobians, strict=True):
        expected = pinocchio.computeFrameJacobian(model, data, each, tip, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
        pinocchio.framesForwardKinematics(model, data, each)
        np.testing.assert_allclose(pose, data.oMf[tip].homogeneous, rtol=0, atol=3e-15)
        np.testing.assert_allclose(jacobian, expected, rtol=0, atol=3e-15)


def test_the_jacobian_of_a_point_beyond_the_tip_is_that_of_pinocchio() -> None:
    """Such as B on the object, fixed in the master's tool frame."""
    model, point = pinocchio_model(RHINO_XR), np.array([0.3, -0.1, 0.05])
    tip = model.frames[model.getFrameId("tip")]
    beyond = tip.placement * pinocchio.SE3(np.eye(3), point)
    at_b = model.addFrame(pinocchio.Frame("b", tip.parentJoint, beyond, pinocchio.FrameType.OP_FRAME))
    data = model.createData()
    for q in random_angles(RHINO_XR, 50):
        expected = pinocchio.computeFrameJacobian(model, data, q, at_b, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
        np.testing.assert_allclose(position_jacobian(RHINO_XR, q, point), expected, rtol=0, atol=3e-15)
    with pytest.raises(CooperationError, match=r"point_m has shape \(2,\); must be \(3,\)"):
        position_jacobian(RHINO_XR, q, [0.0, 0.0])


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_a_hundred_thousand_poses_there_and_back_close_to_1e_12_on_every_branch(arm: FiveAxisArm) -> None:
    q = random_angles(arm, 100_000)
    poses = forward(arm, q)
    found = inverse(arm, poses)
    distance = np.abs((found.q_rad - q[:, None] + math.pi) % (2 * math.pi) - math.pi).max(axis=-1)
    assert np.nanmin(np.where(found.found, distance, np.nan), axis=1).max() < 1e-7  # the angles that made the pose
    for branch in range(4):
        works = found.found[:, branch]
        assert works.mean() > 0.5
        np.testing.assert_allclose(forward(arm, found.q_rad[works, branch]), poses[works], rtol=0, atol=1e-12)
    assert set(np.unique(found.reason)) == {Reason.NONE, Reason.OUT_OF_REACH}  # the other facing may not reach


def test_branches_are_what_they_are_called() -> None:
    poses = forward(RHINO_XR, random_angles(RHINO_XR, 2000))
    found = inverse(RHINO_XR, poses)
    for place, branch in enumerate(BRANCHES):
        q = found.q_rad[found.found[:, place], place]
        towards = np.cos(q[:, 0]) * poses[found.found[:, place], 0, 3]
        towards = towards + np.sin(q[:, 0]) * poses[found.found[:, place], 1, 3]
        assert (np.sign(towards) == branch.facing).all()
        assert (np.sign(np.sin(q[:, 2])) == branch.elbow).all()


def test_one_pose_is_taken_as_well_as_many() -> None:
    q = np.radians([10.0, -40.0, 60.0, -30.0, 20.0])
    found = inverse(RHINO_XR, forward(RHINO_XR, q))
    assert found.q_rad.shape == (4, 5)
    np.testing.assert_allclose(found.q_rad[0], q, atol=1e-12)
    assert position_jacobian(RHINO_XR, np.zeros((2, 3, 5))).shape == (2, 3, 3, 5)


def test_a_stretched_arm_and_a_point_just_beyond_it() -> None:
    q = np.radians([20.0, -30.0, 0.0, 10.0, 5.0])
    pose = forward(RHINO_XR, q)
    np.testing.assert_allclose(inverse_branch(RHINO_XR, pose).q_rad, q, atol=1e-6)
    pose[2, 3] += 1e-6
    found = inverse_branch(RHINO_XR, pose)
    assert found.reason == Reason.OUT_OF_REACH
    assert found.elbow_cosine > 1.0
    assert np.isnan(found.q_rad).all()


def test_a_pose_with_a_yaw_is_refused_and_reached_in_its_point_alone_where_yaw_is_passed_over() -> None:
    q = np.radians([15.0, -60.0, 80.0, -100.0, 40.0])
    upright = pinocchio.utils.rotate("z", math.radians(3.0))
    pose = forward(RHINO_XR, q)
    pose[:3, :3] = upright @ pose[:3, :3]
    assert inverse_branch(RHINO_XR, pose).reason == Reason.YAW
    missed = forward(RHINO_XR, inverse_branch(RHINO_XR, pose, yaw_tolerance=math.inf).q_rad)
    np.testing.assert_allclose(missed[:3, 3], pose[:3, 3], atol=1e-14)
    assert math.degrees(math.acos(missed[:3, 2] @ pose[:3, 2])) == pytest.approx(
        math.degrees(math.asin(abs(pose[:3, 2] @ (-pose[1, 3], pose[0, 3], 0) / math.hypot(*pose[:2, 3])))), abs=1e-9
    )


def test_a_point_on_the_base_axis_has_a_waist_angle_only_by_its_approach() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 0.0, 0.0, 0.5
    assert inverse_branch(RHINO_XR, pose).reason == Reason.BASE_AXIS
    aside = rotated(pose, "y", 0.5 * math.pi)
    found = inverse_branch(RHINO_XR, aside)
    np.testing.assert_allclose(forward(RHINO_XR, found.q_rad), aside, atol=1e-14)


def test_joint_limits_choose_the_full_turn_or_refuse() -> None:
    q = np.radians([170.0, -40.0, 60.0, -30.0, -175.0])
    pose = forward(RHINO_XR, q)
    values = {"d_m": RHINO_XR.d_m, "a_m": RHINO_XR.a_m, "alpha_deg": RHINO_XR.alpha_deg}
    turned = FiveAxisArm(**values, limits_deg=((-360, 0), (-180, 180), (-180, 180), (-180, 180), (0, 360)))
    found = inverse(turned, pose)
    np.testing.assert_allclose(np.degrees(found.q_rad[0]), [-190.0, -40.0, 60.0, -30.0, 185.0], atol=1e-9)
    wide = FiveAxisArm(**values, limits_deg=((-180, 900), *((-400, 400),) * 4))
    np.testing.assert_allclose(inverse(wide, pose).q_rad[0], q, atol=1e-12)  # within them already: left as it is
    narrow = FiveAxisArm(**values, limits_deg=((-180, 180), (-180, 180), (-50, 50), (-180, 180), (-180, 180)))
    assert inverse(narrow, pose).reason[0] == Reason.JOINT_LIMIT
    assert np.isnan(inverse(narrow, pose).q_rad[0]).all()


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_the_least_singular_value_is_that_of_the_jacobian(arm: FiveAxisArm) -> None:
    q = random_angles(arm, 1000)
    expected = np.linalg.svd(position_jacobian(arm, q), compute_uv=False)[:, -1]
    np.testing.assert_allclose(least_singular_value_m(arm, q), expected, atol=1e-14)


def test_the_rhino_has_the_lengths_of_its_inches() -> None:
    """RHINO XR: 10.25 inch to the shoulder, 9 and 9 inch, 0.375 and 6.625 inch to the tip."""
    inches = [RHINO_XR.d_m[0], *RHINO_XR.a_m[1:4], RHINO_XR.d_m[4]]
    np.testing.assert_allclose(np.array(inches) / 0.0254, [10.25, 9.0, 9.0, 0.375, 6.625], atol=0.003)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"d_m": (0.26, 0.0, 0.01, 0.0, 0.17)}, "d_m of joint 3 = 0.01; must be 0 in a five-axis arm"),
        ({"alpha_deg": (-90.0, 0.0, 0.0, 0.0, 0.0)}, "alpha_deg of joint 4 = 0; must be 90 or -90"),
        ({"a_m": (0.0, 0.2, 0.0, 0.01, 0.0)}, "a_m of joint 3 = 0; must be positive"),
        ({"a_m": (0.0, 228.6, 0.2, 0.01, 0.0)}, "a_m of joint 2 = 228.6 m; must be within"),
        ({"a_m": (0.0, 0.2, 0.2)}, "a_m has 3 numbers, d_m has 5; must have one for every joint"),
        ({"a_m": (0.0, math.nan, 0.2, 0.0, 0.0)}, "a_m of joint 2 = nan; must be finite"),
        ({"a_m": "22222x"}, "a_m = '22222x'; must be a list of numbers"),
        ({"limits_deg": ((10, -10),) * 5}, "limits_deg of joint 1 = .*; must be a lower and a higher angle"),
        ({"limits_deg": ((10,),) * 5}, "limits_deg of joint 1 = .*; must be a lower and a higher angle"),
    ],
)
def test_another_shape_is_refused_with_what_would_be_right(changed: dict[str, object], said: str) -> None:
    values = {"d_m": RHINO_XR.d_m, "a_m": RHINO_XR.a_m, "alpha_deg": RHINO_XR.alpha_deg} | changed
    with pytest.raises(CooperationError, match=said):
        FiveAxisArm(**values)  # type: ignore[arg-type]


def test_arrays_of_another_shape_are_refused() -> None:
    with pytest.raises(CooperationError, match=r"joint angles have shape \(4,\); must be \(\.\.\., 5\)"):
        forward(RHINO_XR, [0.0] * 4)
    with pytest.raises(CooperationError, match=r"a pose has shape \(3, 3\); must be \(\.\.\., 4, 4\)"):
        inverse(RHINO_XR, np.eye(3))
    with pytest.raises(CooperationError, match="must be numbers in rad"):
        forward(RHINO_XR, ["a"] * 5)


def test_the_arm_of_a_cell_is_taken_with_its_limits_and_one_of_another_shape_named() -> None:
    robot = load_cell("konkuk1").robot[0]
    with pytest.raises(CooperationError, match="robot 'konkuk1': an arm of 2 joints; a five-axis arm has 5"):
        FiveAxisArm.of_robot(robot)
    joints = [
        robot.joint[0].model_copy(
            update={
                "name": f"axis{i + 1}",
                "limits_deg": (-100.0 - i, 100.0),
                "link": robot.joint[0].dh_link.model_copy(
                    update={"a_m": RHINO_XR.a_m[i], "d_m": RHINO_XR.d_m[i], "alpha_deg": RHINO_XR.alpha_deg[i]}
                ),
            }
        )
        for i in range(5)
    ]
    arm = FiveAxisArm.of_robot(robot.model_copy(update={"joint": tuple(joints)}))
    assert (arm.d_m, arm.a_m, arm.alpha_deg) == (RHINO_XR.d_m, RHINO_XR.a_m, RHINO_XR.alpha_deg)
    assert [low for low, _ in arm.limits_deg] == [-100.0, -101.0, -102.0, -103.0, -104.0]
    assert all(a < b for a, b in pairwise(sorted(arm.limits_rad[0])))
