"""Arms of 1 to 7 joints against Pinocchio and MuJoCo, and the paper's trace form against the fast forms."""

from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canarm_controller.dynamics import (
    COULOMB_SMOOTHING_RAD_S,
    Chain,
    NominalArm,
    SerialArm,
    chain_of,
    lagrange_euler,
    nominal_arm,
)
from canarm_controller.dynamics.newton_euler import lumped_inertias, torque_program
from canarm_controller.dynamics.scalar import compile_scalar, source
from canarm_controller.errors import DynamicsError
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Robot

KONKUK = load_cell("konkuk1").robot[0]
State = tuple[np.ndarray, np.ndarray, np.ndarray]


def arm_of_links(links: list[dict[str, object]], gravity: tuple[float, ...]) -> Robot:
    """A robot with these links, and the drives of KON-KUK I's joint 2."""
    template = KONKUK.joint[0]
    joints = tuple(
        template.model_copy(update={"name": f"axis{i + 1}", "link": template.link.model_copy(update=link)})
        for i, link in enumerate(links)
    )
    return KONKUK.model_copy(update={"name": "arm", "gravity_m_s2": gravity, "joint": joints})


def rhino() -> Robot:
    """Geometry and masses of the RHINO XR; links as rods of 4 cm thickness along their own x or, the last, z axis."""
    a, d = (0.0, 0.2286, 0.2286, 0.0095, 0.0), (0.2604, 0.0, 0.0, 0.0, 0.1683)
    alpha, mass = (-90.0, 0.0, 0.0, -90.0, 0.0), (3.0, 2.2, 1.2, 0.5, 0.35)
    thick = [0.02**2 * m / 2 for m in mass]
    links: list[dict[str, object]] = [
        {
            "a_m": a[i],
            "d_m": d[i],
            "alpha_deg": alpha[i],
            "mass_kg": mass[i],
            "centre_of_mass_m": (-a[i] / 2, 0.0, -0.08 if i == 4 else 0.0),
            "inertia_kg_m2": (thick[i], mass[i] * 0.2**2 / 12, mass[i] * 0.2**2 / 12),
        }
        for i in range(5)
    ]
    return arm_of_links(links, (0.0, 0.0, -9.8062))


@st.composite
def robots(draw: st.DrawFn, joints: st.SearchStrategy[int], planar: bool = False) -> Robot:
    """Arms with right angles, zeros and anything between; bodies that can exist (moments from second moments)."""

    def number(low: float, high: float, *special: float) -> float:
        ordinary = st.floats(low, high).map(lambda x: round(x, 3))
        return draw(st.sampled_from(special) | ordinary if special else ordinary)

    def link() -> dict[str, object]:
        x, y, z = (number(1e-3, 0.05) for _ in range(3))
        return {
            "a_m": number(-0.5, 0.5, 0.0),
            "alpha_deg": 0.0 if planar else number(-180, 180, 0.0, 90.0, -90.0, 180.0),
            "d_m": number(-0.5, 0.5, 0.0),
            "theta_offset_deg": number(-180, 180, 0.0),
            "mass_kg": number(0.1, 5.0),
            "centre_of_mass_m": tuple(number(-0.3, 0.3, 0.0) for _ in range(3)),
            "inertia_kg_m2": (y + z, x + z, x + y),
        }

    gravity = tuple(number(-10, 10, 0.0) for _ in range(3))
    return arm_of_links([link() for _ in range(draw(joints))], gravity)


def random_states(joints: int, count: int) -> State:
    """Angles, speeds and accelerations, (count, joints) each."""
    rng = np.random.default_rng(11)
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, count, joints))
    return np.pi * q, 3.0 * qd, 20.0 * qdd


def pinocchio_model(robot: Robot) -> pinocchio.Model:
    """The same chain in Pinocchio, placed joint by joint from its Denavit-Hartenberg parameters."""
    model = pinocchio.Model()
    model.gravity.linear = np.array(robot.gravity_m_s2)
    parent, place = 0, pinocchio.SE3.Identity()
    for joint in robot.joint:
        link = joint.link
        turn = pinocchio.SE3(pinocchio.utils.rotate("z", np.radians(link.theta_offset_deg)), np.zeros(3))
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), place * turn, joint.name)
        twist = pinocchio.utils.rotate("x", np.radians(link.alpha_deg))
        place = pinocchio.SE3(twist, np.array([link.a_m, 0.0, link.d_m]))
        inertia = pinocchio.Inertia(link.mass_kg, np.array(link.centre_of_mass_m), np.diag(link.inertia_kg_m2))
        model.appendBodyToJoint(parent, inertia, place)
    return model


def mujoco_model(robot: Robot) -> mujoco.MjModel:
    """The same chain in MuJoCo: every body sits on its own joint's axis, its link's frame further out."""

    def quaternion(axis: tuple[float, float, float], angle_deg: float) -> np.ndarray:
        half = np.radians(angle_deg) / 2
        return np.array([np.cos(half), *(np.sin(half) * np.array(axis))])

    def rotated(quat: np.ndarray, vector: object) -> np.ndarray:
        result = np.zeros(3)
        mujoco.mju_rotVecQuat(result, np.array(vector), quat)
        return result

    spec = mujoco.MjSpec()
    spec.option.gravity = robot.gravity_m_s2
    parent, position, twist = spec.worldbody, np.zeros(3), quaternion((1, 0, 0), 0.0)
    for joint in robot.joint:
        link, turned = joint.link, np.zeros(4)
        mujoco.mju_mulQuat(turned, twist, quaternion((0, 0, 1), link.theta_offset_deg))
        parent = parent.add_body(name=joint.name, pos=position, quat=turned)
        parent.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        position, twist = np.array([link.a_m, 0.0, link.d_m]), quaternion((1, 0, 0), link.alpha_deg)
        parent.explicitinertial = True
        parent.mass, parent.iquat = link.mass_kg, twist
        parent.inertia = np.maximum(link.inertia_kg_m2, 1e-12)  # a thin rod is no body to MuJoCo
        parent.ipos = position + rotated(twist, link.centre_of_mass_m)
    return spec.compile()


Parts = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def pinocchio_parts(robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> Parts:
    """D, H, G and τ of the links."""
    model = pinocchio_model(robot)
    data = model.createData()
    upper = np.triu(pinocchio.crba(model, data, q))
    still = np.zeros(len(q))
    gravity = pinocchio.rnea(model, data, q, still, still).copy()
    bias = pinocchio.rnea(model, data, q, qd, still).copy()
    return upper + np.triu(upper, 1).T, bias - gravity, gravity, pinocchio.rnea(model, data, q, qd, qdd)


def mujoco_parts(robot: Robot, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> Parts:
    """D, H, G and τ of the links."""
    model = mujoco_model(robot)
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    gravity = data.qfrc_bias.copy()
    data.qvel[:] = qd
    mujoco.mj_forward(model, data)
    bias = data.qfrc_bias.copy()
    return inertia, bias - gravity, gravity, inertia @ qdd + bias


def assert_close(actual: object, expected: np.ndarray, relative: float, scale: float = 0.0) -> None:
    """Alike to `relative` of the largest entry, or of `scale` where large terms cancel."""
    size = max(float(np.abs(expected).max()), scale)
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=relative * size)


def assert_parts_agree(robot: Robot, engine: Callable[..., Parts], planar: bool = False) -> None:
    arm = NominalArm.from_robot(robot) if planar else SerialArm.from_robot(robot)
    for q, qd, qdd in zip(*random_states(len(robot.joint), 3), strict=True):
        inertia, coriolis, gravity, torque = engine(robot, q, qd, qdd)
        scale = float(np.abs(inertia).max() * 20.0 + np.abs(gravity).max())
        assert_close(arm.inertia(q.tolist()), inertia, 1e-9)
        assert_close(arm.coriolis(q.tolist(), qd.tolist()), coriolis, 1e-9, scale)
        assert_close(arm.gravity(q.tolist()), gravity, 1e-9, scale)
        drive = np.array(arm.rotor_inertia) * qdd + arm.friction(qd.tolist())
        assert_close(np.array(arm.torque_nm(q.tolist(), qd.tolist(), qdd.tolist())) - drive, torque, 1e-9, scale)


@pytest.mark.parametrize("engine", [pinocchio_parts, mujoco_parts], ids=["Pinocchio", "MuJoCo"])
@pytest.mark.parametrize("robot", [KONKUK, rhino()], ids=["konkuk1", "rhino"])
def test_shipped_geometries_agree_with_physics_engines(robot: Robot, engine: Callable[..., Parts]) -> None:
    assert_parts_agree(robot, engine)


@given(robot=robots(st.integers(1, 7)))
@settings(max_examples=60)
def test_any_arm_agrees_with_pinocchio(robot: Robot) -> None:
    assert_parts_agree(robot, pinocchio_parts)


@given(robot=robots(st.integers(2, 6)))
@settings(max_examples=60)
def test_any_arm_agrees_with_mujoco(robot: Robot) -> None:
    assert_parts_agree(robot, mujoco_parts)


@given(robot=robots(st.just(2), planar=True))
@settings(max_examples=60)
def test_any_planar_pair_in_closed_form_agrees_with_pinocchio(robot: Robot) -> None:
    assert_parts_agree(robot, pinocchio_parts, planar=True)


@given(robot=robots(st.integers(1, 7)))
@settings(max_examples=25)
def test_fast_form_is_the_trace_form_to_rounding(robot: Robot) -> None:
    chain = chain_of(robot)
    arm = SerialArm.from_robot(robot)
    links_alone = compile_scalar(torque_program(chain), chain.joint_names)
    q, qd, qdd = (part[0] for part in random_states(len(robot.joint), 1))
    inertia = lagrange_euler.inertia(chain, q)
    coriolis = lagrange_euler.coriolis(chain, q, qd)
    gravity = lagrange_euler.gravity(chain, q)
    scale = float(np.abs(inertia @ qdd).max() + np.abs(coriolis).max() + np.abs(gravity).max())
    assert_close(arm.inertia(q.tolist()), inertia, 1e-12)
    assert_close(arm.coriolis(q.tolist(), qd.tolist()), coriolis, 1e-12, scale)
    assert_close(arm.gravity(q.tolist()), gravity, 1e-12, scale)
    torque = lagrange_euler.joint_torques(chain, q, qd, qdd)
    assert_close(links_alone(q.tolist(), qd.tolist(), qdd.tolist()), torque, 1e-12, scale)


@given(robot=robots(st.integers(1, 7)))
@settings(max_examples=25)
def test_batch_gives_the_torques_of_single_states(robot: Robot) -> None:
    arm = SerialArm.from_robot(robot)
    q, qd, qdd = random_states(len(robot.joint), 20)
    single = np.array([arm.torque_nm(*state) for state in zip(q.tolist(), qd.tolist(), qdd.tolist(), strict=True)])
    assert_close(arm.torque_batch_nm(q, qd, qdd), single, 1e-12)
    assert_close(arm.batch(q.T, qd.T, qdd.T), single.T, 1e-12)


def test_a_batch_longer_than_a_block_has_no_seams() -> None:
    arm = SerialArm.from_robot(rhino())
    states = random_states(5, 9001)
    result = arm.torque_batch_nm(*states)
    for sample in (0, 4095, 4096, 8191, 8192, 9000):
        alone = arm.torque_nm(*(part[sample].tolist() for part in states))
        np.testing.assert_allclose(result[sample], alone, rtol=1e-11, atol=1e-11)


def test_cosines_by_half_angles_hold_at_half_turns_and_after_many() -> None:
    arm = SerialArm.from_robot(KONKUK)
    angles = np.array([0.0, np.pi, -np.pi, np.pi / 2, 3 * np.pi, 1e4 * np.pi, 1e8])
    q = np.stack([angles, angles[::-1]], axis=1)
    expected = [arm.gravity(pose) for pose in q.tolist()]
    np.testing.assert_allclose(arm.torque_batch_nm(q, 0 * q, 0 * q), expected, rtol=0.0, atol=1e-14)


def test_results_land_in_the_array_that_is_given() -> None:
    arm = SerialArm.from_robot(rhino())
    q, qd, qdd = (np.ascontiguousarray(part.T) for part in random_states(5, 7))
    out = np.full((5, 7), np.nan)
    assert arm.batch(q, qd, qdd, out=out) is out
    np.testing.assert_array_equal(out, arm.batch(q, qd, qdd))
    with pytest.raises(DynamicsError, match=r"out has shape \(7, 5\); must be \(5, 7\)"):
        arm.batch(q, qd, qdd, out=out.T)


def test_an_empty_batch_is_empty() -> None:
    assert SerialArm.from_robot(KONKUK).torque_batch_nm(*np.zeros((3, 0, 2))).shape == (0, 2)


def test_serial_and_closed_form_are_one_arm_for_konkuk1() -> None:
    closed, serial = NominalArm.from_robot(KONKUK), SerialArm.from_robot(KONKUK)
    for name in ("joint_names", "rotor_inertia", "viscous_nm_s", "coulomb_nm", "torque_per_ampere", "max_current_a"):
        assert getattr(serial, name) == getattr(closed, name)
    assert serial.effective_inertia == pytest.approx(closed.effective_inertia, rel=1e-13)
    states = random_states(2, 100)
    np.testing.assert_allclose(serial.torque_batch_nm(*states), closed.torque_batch_nm(*states), rtol=0, atol=1e-12)


def test_the_closed_form_is_taken_for_a_planar_pair_alone() -> None:
    assert isinstance(nominal_arm(KONKUK), NominalArm)
    assert isinstance(nominal_arm(rhino()), SerialArm)


def test_drive_adds_rotor_viscous_and_smoothed_coulomb_terms() -> None:
    """N²J = 60²·1.5e-5 = 0.054 kg·m², 0.05 N·m·s and 0.15 N·m of KON-KUK I's joint 2, here on every axis."""
    robot = rhino()
    arm, chain = SerialArm.from_robot(robot), chain_of(robot)
    q, qd, qdd = (part[0] for part in random_states(5, 1))
    drive = 0.054 * qdd + 0.05 * qd + 0.15 * np.tanh(qd / COULOMB_SMOOTHING_RAD_S)
    links = lagrange_euler.joint_torques(chain, q, qd, qdd)
    np.testing.assert_allclose(arm.torque_nm(q.tolist(), qd.tolist(), qdd.tolist()), links + drive, rtol=1e-12)


@given(robot=robots(st.integers(1, 7)))
@settings(max_examples=25)
def test_accelerations_under_a_torque_agree_with_pinocchio(robot: Robot) -> None:
    arm, model = SerialArm.from_robot(robot), pinocchio_model(robot)
    model.armature = np.array(arm.rotor_inertia)
    q, qd, _ = (part[0] for part in random_states(len(robot.joint), 1))
    torque = np.linspace(-2.0, 3.0, len(q))
    expected = pinocchio.aba(model, model.createData(), q, qd, torque - arm.friction(qd.tolist()))
    assert_close(arm.acceleration_rad_s2(q.tolist(), qd.tolist(), torque.tolist()), expected, 1e-9)


def test_a_joint_without_inertia_is_refused_where_its_acceleration_is_asked_for() -> None:
    """A thin rod that turns about its own length, on a rotor without inertia: no torque balance holds."""
    needle = {"a_m": 0.0, "centre_of_mass_m": (0.0, 0.0, 0.1), "inertia_kg_m2": (0.01, 0.01, 0.0)}
    robot = arm_of_links([{"alpha_deg": 90.0}, needle], (0.0, 0.0, -9.8))
    motor = robot.joint[1].motor.model_copy(update={"rotor_inertia_kg_m2": 0.0})
    robot = robot.model_copy(update={"joint": (robot.joint[0], robot.joint[1].model_copy(update={"motor": motor}))})
    arm = SerialArm.from_robot(robot)
    assert len(arm.torque_nm((0.1, 0.2), (0.0, 0.0), (0.0, 0.0))) == 2
    with pytest.raises(DynamicsError, match=r"axis2: inertia matrix is singular here \(pivot .*; must be positive"):
        arm.acceleration_rad_s2((0.1, 0.2), (0.0, 0.0), (1.0, 1.0))


NAN, INFINITY = float("nan"), float("inf")


@pytest.mark.parametrize("make", [NominalArm.from_robot, SerialArm.from_robot], ids=["closed form", "serial"])
@pytest.mark.parametrize(
    ("state", "message"),
    [
        (((0.0, NAN), (0.0, 0.0), (0.0, 0.0)), "q of joint3 = nan; must be finite"),
        (((0.0, 0.0), (-INFINITY, 0.0), (0.0, 0.0)), "qd of joint2 = -inf; must be finite"),
        (((0.0, 0.0), (INFINITY, -INFINITY), (0.0, 0.0)), "qd of joint2 = inf; must be finite"),
        (((0.0, 0.0), (0.0, 0.0), (0.0, 0.0, 0.0)), r"qdd has shape \(3,\); must be \(2,\)"),
        (((0.0,), (0.0, 0.0), (0.0, 0.0)), r"q has shape \(1,\); must be \(2,\)"),
        ((0.0, (0.0, 0.0), (0.0, 0.0)), r"q has shape \(\); must be \(2,\)"),
        ((("a", "b"), (0.0, 0.0), (0.0, 0.0)), r"q = \('a', 'b'\); must be one number per joint"),
    ],
)
def test_a_bad_state_is_refused_with_quantity_and_joint(
    make: Callable[..., NominalArm], state: tuple[object, ...], message: str
) -> None:
    with pytest.raises(DynamicsError, match=message):
        make(KONKUK).torque_nm(*state)


def test_the_angle_of_a_joint_that_needs_no_torque_may_not_be_nan_either() -> None:
    """The waist of an upright arm appears in no equation, so that nothing but a check can notice."""
    arm = SerialArm.from_robot(rhino())
    with pytest.raises(DynamicsError, match="q of axis1 = nan; must be finite"):
        arm.torque_nm((NAN, 0.0, 0.0, 0.0, 0.0), (0.0,) * 5, (0.0,) * 5)
    with pytest.raises(DynamicsError, match="q of axis1 = nan; must be finite"):
        arm.gravity((NAN, 0.0, 0.0, 0.0, 0.0))


def test_huge_but_finite_states_whose_sum_overflows_are_not_refused() -> None:
    arm = SerialArm.from_robot(KONKUK)
    assert arm.torque_nm((0.0, 0.0), (0.0, 0.0), (1.5e308, 1.5e308))[0] > 1e306


@pytest.mark.parametrize("make", [NominalArm.from_robot, SerialArm.from_robot], ids=["closed form", "serial"])
def test_a_bad_batch_is_refused_with_sample_and_joint(make: Callable[..., NominalArm]) -> None:
    arm = make(KONKUK)
    q, qd, qdd = np.zeros((3, 50, 2))
    qd[17, 1] = NAN
    with pytest.raises(DynamicsError, match="qd of joint3 at sample 17 = nan; must be finite"):
        arm.torque_batch_nm(q, qd, qdd)
    with pytest.raises(DynamicsError, match=r"qdd: 2 x 49 \(joints x samples\); must be 2 x 50"):
        arm.torque_batch_nm(q, 0 * q, qdd[:49])
    with pytest.raises(DynamicsError, match=r"q: 3 x 50 \(joints x samples\); must be 2 x 50"):
        arm.torque_batch_nm(np.zeros((50, 3)), q, qdd)
    with pytest.raises(DynamicsError, match=r"q: 50 \(joints x samples\); must be 2 x 50"):
        arm.torque_batch_nm(np.zeros(50), q, qdd)


def test_more_than_seven_joints_are_refused() -> None:
    with pytest.raises(DynamicsError, match=r"robot 'arm' has 8 joints; must have 1 to 7"):
        SerialArm.from_robot(arm_of_links([{}] * 8, (0.0, 0.0, -9.8)))


@pytest.mark.parametrize("make", [NominalArm.from_robot, SerialArm.from_robot], ids=["closed form", "serial"])
def test_a_parameter_that_is_no_number_is_refused_with_its_key(make: Callable[..., NominalArm]) -> None:
    with pytest.raises(DynamicsError, match=r"axis2\.link\.centre_of_mass_m = \(0\.0, nan, 0\.0\): must be finite"):
        make(arm_of_links([{}, {"centre_of_mass_m": (0.0, NAN, 0.0)}], (0.0, -9.8, 0.0)))
    with pytest.raises(DynamicsError, match=r"gravity_m_s2 = .*: must be finite"):
        make(arm_of_links([{}, {}], (0.0, INFINITY, 0.0)))


def test_names_from_a_cell_stay_out_of_the_compiled_text() -> None:
    robot = rhino()
    evil = robot.joint[0].model_copy(update={"name": "__import__('os')"})
    chain: Chain = chain_of(robot.model_copy(update={"joint": (evil, *robot.joint[1:])}))
    assert "import" not in source(torque_program(chain))


def test_mass_on_a_joints_axis_is_moved_to_the_link_before() -> None:
    """After that, m, m·c_z and ∫z² dm are zero in the frame on the axis, whatever the link."""
    for inertia in lumped_inertias(chain_of(rhino())):
        assert not inertia[2:, 2:].any()
