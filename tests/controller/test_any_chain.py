"""Chains of 1 to 7 joints as bodies of any tensor about any axis: every form of their dynamics against Pinocchio.

Pinocchio gets the joints as the cell has them, placed in the link before and turning about their own axes.
"""

from math import sin

import numpy as np
import pinocchio
import pytest

from canarm_controller.dynamics import (
    COULOMB_SMOOTHING_RAD_S,
    NominalArm,
    SerialArm,
    SeveralArms,
    cell_arm,
    chain_of,
    lagrange_euler,
    nominal_arm,
)
from canarm_controller.dynamics.inertial_regressor import InertialRegressor
from canarm_controller.estimation.arm_model import SeveralModels, arm_model
from canarm_controller.estimation.chain_regressor import ChainRegressor
from canarm_controller.estimation.regressor import Regressor
from canarm_protocol.cell.arm import Body, Link, Robot
from canarm_protocol.cell.cell_file import load_cell

KONKUK = load_cell("konkuk1").robot[0]
COUNTS = range(1, 8)
AXES = [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.6, 0.0, -0.8), (0.0, 1.0, 0.0)]
TURNS = [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (0.0, -90.0, 180.0), (12.0, -70.0, 133.0)]
POSES = 3


def robot_of(solids: list[Body | Link], gravity: tuple[float, float, float] = (1.0, -2.0, -9.5)) -> Robot:
    """A robot of these solids, with the drives of KON-KUK I's joint 3."""
    template = KONKUK.joint[1]
    joints = tuple(
        template.model_copy(
            update={
                "name": f"axis{i + 1}",
                "home_deg": 10.0 * i,
                "link": solid if isinstance(solid, Link) else None,
                "body": solid if isinstance(solid, Body) else None,
            }
        )
        for i, solid in enumerate(solids)
    )
    return KONKUK.model_copy(update={"name": "arm", "gravity_m_s2": gravity, "joint": joints})


def random_body(rng: np.random.Generator, is_special: bool = False) -> Body:
    """A body that can exist, about any axis; with right angles and axes of the frame if `is_special`."""
    spread = rng.normal(size=(3, 3)) * 0.08
    second = spread @ spread.T
    tensor = np.trace(second) * np.eye(3) - second
    axis = rng.normal(size=3)
    choice, turn = int(rng.integers(len(AXES))), int(rng.integers(len(TURNS)))
    return Body(
        origin_m=tuple(rng.uniform(-0.4, 0.4, 3).tolist()),
        origin_rpy_deg=TURNS[turn] if is_special else tuple(rng.uniform(-180.0, 180.0, 3).tolist()),
        axis=AXES[choice] if is_special else tuple((axis / np.linalg.norm(axis)).tolist()),
        mass_kg=float(rng.uniform(0.1, 5.0)),
        centre_of_mass_m=tuple(rng.uniform(-0.2, 0.2, 3).tolist()),
        inertia_kg_m2=tuple(float(tensor[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))),
    )


def random_robot(joints: int, seed: int) -> Robot:
    """Bodies; those of an odd seed have right angles, and one of them is a Denavit-Hartenberg link."""
    rng = np.random.default_rng(seed)
    solids: list[Body | Link] = [random_body(rng, is_special=seed % 2 == 1) for _ in range(joints)]
    if seed % 2:
        solids[joints // 2] = KONKUK.joint[0].dh_link.model_copy(
            update={"alpha_deg": -90.0, "d_m": 0.1, "theta_offset_deg": 30.0}
        )
    return robot_of(solids)


def pinocchio_model(robot: Robot) -> pinocchio.Model:
    """The robot in Pinocchio: bodies as URDF has them, links by the steps of Denavit and Hartenberg."""
    model = pinocchio.Model()
    model.gravity.linear = np.array(robot.gravity_m_s2)
    parent, link_frame = 0, pinocchio.SE3.Identity()
    for joint in robot.joint:
        if joint.body is not None:
            body = joint.body
            turn = pinocchio.rpy.rpyToMatrix(*np.radians(body.origin_rpy_deg))
            place = pinocchio.SE3(turn, np.array(body.origin_m))
            parent = model.addJoint(
                parent,
                pinocchio.JointModelRevoluteUnaligned(np.array(body.axis)),
                link_frame * place,
                joint.name,
            )
            xx, yy, zz, xy, xz, yz = body.inertia_kg_m2
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            link_frame = pinocchio.SE3.Identity()
        else:
            link = joint.dh_link
            offset = pinocchio.SE3(pinocchio.utils.rotate("z", np.radians(link.theta_offset_deg)), np.zeros(3))
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), link_frame * offset, joint.name)
            twist = pinocchio.utils.rotate("x", np.radians(link.alpha_deg))
            link_frame = pinocchio.SE3(twist, np.array([link.a_m, 0.0, link.d_m]))
            tensor = np.diag(link.inertia_kg_m2)
        solid = joint.solid
        inertia = pinocchio.Inertia(solid.mass_kg, np.array(solid.centre_of_mass_m), tensor)
        model.appendBodyToJoint(parent, inertia, link_frame)
    return model


def inertia_of(model: pinocchio.Model, q: np.ndarray) -> np.ndarray:
    upper = np.triu(pinocchio.crba(model, model.createData(), q))
    return upper + np.triu(upper, 1).T


def states(joints: int, groups: int) -> list[list[np.ndarray]]:
    rng = np.random.default_rng(7)
    return [list(rng.uniform(-2.0, 2.0, (groups, joints))) for _ in range(POSES)]


def assert_close(actual: object, expected: np.ndarray, scale: float) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-9 * scale)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("joints", COUNTS)
def test_bodies_of_any_tensor_about_any_axis_move_as_in_pinocchio(joints: int, seed: int) -> None:
    robot = random_robot(joints, seed)
    arm, model = SerialArm.from_robot(robot), pinocchio_model(robot)
    data = model.createData()
    rest = np.zeros(joints)
    for q, qd, qdd in states(joints, 3):
        inertia = inertia_of(model, q)
        torque = pinocchio.rnea(model, data, q, qd, qdd).copy()
        weight = pinocchio.rnea(model, data, q, rest, rest).copy()
        scale = 1.0 + float(np.abs(torque).max())
        assert_close(arm.inertia(q.tolist()), inertia, 1.0 + float(np.abs(inertia).max()))
        assert_close(arm.gravity(q.tolist()), weight, scale)
        drive = np.array(arm.rotor_inertia) * qdd + arm.friction(qd.tolist())
        whole = arm.torque_nm(q.tolist(), qd.tolist(), qdd.tolist())
        assert_close(np.array(whole) - drive, torque, scale)
        assert_close(arm.torque_batch_nm(q[None], qd[None], qdd[None])[0], np.array(whole), scale)
        model.armature = np.array(arm.rotor_inertia)
        expected = pinocchio.aba(model, data, q, qd, np.array(whole) - arm.friction(qd.tolist()))
        model.armature = rest
        assert_close(arm.acceleration_rad_s2(q.tolist(), qd.tolist(), whole), expected, 100.0)
        assert_close(expected, qdd, 100.0)


@pytest.mark.parametrize("joints", [1, 3, 7])
def test_the_trace_form_of_bodies_is_the_fast_form(joints: int) -> None:
    robot = random_robot(joints, 4)
    arm, chain = SerialArm.from_robot(robot), chain_of(robot)
    q, qd, qdd = states(joints, 3)[0]
    drive = np.array(arm.rotor_inertia) * qdd + arm.friction(qd.tolist())
    expected = lagrange_euler.joint_torques(chain, q, qd, qdd) + drive
    scale = 1.0 + float(np.abs(expected).max())
    assert_close(arm.torque_nm(q.tolist(), qd.tolist(), qdd.tolist()), expected, scale)


def test_bodies_with_right_angles_cost_no_more_than_links() -> None:
    """KON-KUK I as URDF would have it: the rod's frame on its own axis, the next joint 0.18 m along it."""
    links = [joint.dh_link for joint in KONKUK.joint]
    bodies: list[Body | Link] = [
        Body(
            origin_m=(links[i - 1].a_m if i else 0.0, 0.0, 0.0),
            mass_kg=link.mass_kg,
            centre_of_mass_m=(link.a_m + link.centre_of_mass_m[0], 0.0, 0.0),
            inertia_kg_m2=(*link.inertia_kg_m2, 0.0, 0.0, 0.0),
        )
        for i, link in enumerate(links)
    ]
    arm = SerialArm.from_robot(robot_of(bodies, KONKUK.gravity_m_s2))
    by_links = SerialArm.from_robot(robot_of([*links], KONKUK.gravity_m_s2))
    assert len(arm.torque_nm.__code__.co_code) <= len(by_links.torque_nm.__code__.co_code)  # type: ignore[attr-defined]
    for q, qd, qdd in states(2, 3):
        state = q.tolist(), qd.tolist(), qdd.tolist()
        np.testing.assert_allclose(arm.torque_nm(*state), by_links.torque_nm(*state), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("joints", COUNTS)
def test_the_regressor_spans_the_torques_of_pinocchios_regressor(joints: int, seed: int) -> None:
    """Rows of Y come from Yᵀs with s a unit vector. Y(q, q̇, q̇, q̈) must give the torque of Pinocchio's Y of ten
    parameters per link, and span the same torques: no parameter that can be told apart by moving is missing, unless it
    is nominally zero, as some are of robots with right angles (odd seeds).
    """
    robot = random_robot(joints, seed)
    arm, model = SerialArm.from_robot(robot), pinocchio_model(robot)
    regressor, data = ChainRegressor(arm), model.createData()
    rows, full = [], []
    rng = np.random.default_rng(1)
    for _ in range(12):
        q, qd, qdd = rng.uniform(-2.0, 2.0, (3, joints))
        state = regressor.at(q.tolist(), qd.tolist(), qd.tolist(), qdd.tolist(), qd.tolist())
        own = np.array([state.gradient(unit) for unit in np.eye(joints).tolist()])
        rows.append(own)
        full.append(pinocchio.computeJointTorqueRegressor(model, data, q, qd, qdd).copy())
        ten = np.concatenate([model.inertias[i + 1].toDynamicParameters() for i in range(joints)])
        drive = np.array(arm.rotor_inertia) * qdd + arm.friction(qd.tolist())
        expected = full[-1] @ ten + drive
        scale = 1.0 + float(np.abs(expected).max())
        assert_close(own @ np.array(regressor.nominal), expected, scale)
        assert_close(state.torque_nm(regressor.nominal), expected, scale)
    whole, links = np.vstack(rows), np.vstack(full)
    missing = links - whole @ np.linalg.lstsq(whole, links, rcond=None)[0]
    assert seed % 2 or np.abs(missing).max() < 1e-8
    independent = np.linalg.matrix_rank(links, tol=1e-8) + 3 * joints  # rotors and friction
    assert len(regressor.nominal) <= independent + 3 * joints


@pytest.mark.parametrize("joints", [1, 2, 4, 7])
def test_the_reference_speed_goes_through_the_coriolis_matrix_of_the_christoffel_symbols(joints: int) -> None:
    """Pinocchio's computeCoriolisMatrix is that matrix; with it Ḋ - 2C is skew-symmetric (Slotine and Li 1987)."""
    robot = random_robot(joints, 2)
    arm, model = SerialArm.from_robot(robot), pinocchio_model(robot)
    regressor, data = ChainRegressor(arm), model.createData()
    for q, qd, qd_r, qdd_r, sliding in states(joints, 5):
        coriolis = pinocchio.computeCoriolisMatrix(model, data, q, qd) @ qd_r
        weight = pinocchio.computeGeneralizedGravity(model, data, q).copy()
        links = inertia_of(model, q) @ qdd_r + coriolis + weight
        drives = np.array(arm.rotor_inertia) * qdd_r + np.array(arm.viscous_nm_s) * qd_r
        drives += np.array(arm.coulomb_nm) * np.tanh(sliding / COULOMB_SMOOTHING_RAD_S)
        state = regressor.at(*(part.tolist() for part in (q, qd, qd_r, qdd_r, sliding)))
        scale = 1.0 + float(np.abs(links).max())
        assert_close(state.torque_nm(regressor.nominal), links + drives, scale)


@pytest.mark.parametrize("joints", [1, 3, 7])
def test_accelerations_of_parameters_are_those_of_the_arm_they_belong_to(joints: int) -> None:
    robot = random_robot(joints, 2)
    heavy = robot.model_copy(
        update={
            "joint": tuple(
                joint.model_copy(
                    update={
                        "body": joint.solid.model_copy(
                            update={
                                "mass_kg": 1.5 * joint.mass_kg,
                                "inertia_kg_m2": tuple(1.5 * value for value in joint.solid.inertia_kg_m2),
                            }
                        )
                    }
                )
                for joint in robot.joint
            )
        }
    )
    nominal, true = ChainRegressor(SerialArm.from_robot(robot)), SerialArm.from_robot(heavy)
    parameters = ChainRegressor(true).nominal
    for q, qd, torque in states(joints, 3):
        state = q.tolist(), qd.tolist(), torque.tolist()
        expected = np.array(true.acceleration_rad_s2(*state))
        assert_close(nominal.acceleration(parameters, *state), expected, 1.0 + float(np.abs(expected).max()))


def test_parameters_that_no_arm_can_have_give_the_nominal_accelerations() -> None:
    arm = SerialArm.from_robot(random_robot(4, 2))
    regressor = ChainRegressor(arm)
    impossible = [-value for value in regressor.nominal]
    q, qd, torque = (part.tolist() for part in states(4, 3)[0])
    found = regressor.acceleration(impossible, q, qd, torque)
    np.testing.assert_allclose(found, arm.acceleration_rad_s2(q, qd, torque), rtol=1e-9)


def test_the_regressor_of_two_planar_joints_and_the_one_for_any_chain_are_one_model() -> None:
    pair, chain = arm_model(nominal_arm(KONKUK)), ChainRegressor(SerialArm.from_robot(KONKUK))
    assert isinstance(pair, Regressor)
    for q, qd, qd_r, qdd_r, sliding in states(2, 5):
        state = [part.tolist() for part in (q, qd, qd_r, qdd_r, sliding)]
        np.testing.assert_allclose(
            pair.at(*state).torque_nm(pair.nominal), chain.at(*state).torque_nm(chain.nominal), rtol=1e-10, atol=1e-10
        )
        np.testing.assert_allclose(
            pair.acceleration(pair.nominal, *state[:3]),
            chain.acceleration(chain.nominal, *state[:3]),
            rtol=1e-9,
            atol=1e-9,
        )


def test_the_closed_form_accelerates_as_the_general_one() -> None:
    closed, serial = NominalArm.from_robot(KONKUK), SerialArm.from_robot(KONKUK)
    for q, qd, torque in states(2, 3):
        state = q.tolist(), qd.tolist(), torque.tolist()
        np.testing.assert_allclose(closed.acceleration_rad_s2(*state), serial.acceleration_rad_s2(*state), rtol=1e-10)


def test_one_joint_is_a_pendulum() -> None:
    """τ = (m·l² + J_rotor)·q̈ + m·g·l·sin q for a point mass that hangs at l from a horizontal axis."""
    mass, length = 2.0, 0.5
    bob = Body(
        origin_m=(0.0, 0.0, 1.0),
        axis=(0.0, 1.0, 0.0),
        mass_kg=mass,
        centre_of_mass_m=(0.0, 0.0, -length),
        inertia_kg_m2=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )
    arm = SerialArm.from_robot(robot_of([bob], (0.0, 0.0, -9.8)))
    rotor = arm.rotor_inertia[0]
    (torque,) = arm.torque_nm((0.7,), (0.0,), (3.0,))
    assert torque == pytest.approx((mass * length**2 + rotor) * 3.0 + mass * 9.8 * length * sin(0.7), rel=1e-12)
    assert arm.effective_inertia == pytest.approx([mass * length**2 + rotor])
    assert arm.gravity((0.0,)) == pytest.approx([0.0])


def test_several_robots_are_one_arm_in_blocks() -> None:
    """Two robots, each in its own field of gravity: torques and accelerations one after the other, no coupling."""
    first, second = KONKUK, random_robot(3, 2)
    names = ("joint2", "joint3", "axis1", "axis2", "axis3")
    arm = cell_arm([first, second], names)
    assert isinstance(arm, SeveralArms)
    assert arm.joint_names == names
    assert arm.joint_count == 5
    parts = [nominal_arm(first), nominal_arm(second)]
    q, qd, qdd = (part.tolist() for part in states(5, 3)[0])
    expected = [*parts[0].torque_nm(q[:2], qd[:2], qdd[:2]), *parts[1].torque_nm(q[2:], qd[2:], qdd[2:])]
    assert arm.torque_nm(q, qd, qdd) == tuple(expected)
    np.testing.assert_allclose(arm.acceleration_rad_s2(q, qd, expected), qdd, rtol=1e-9)
    inertia = np.array(arm.inertia(q))
    assert not inertia[:2, 2:].any()
    assert not inertia[2:, :2].any()
    model = arm_model(arm)
    assert isinstance(model, SeveralModels)
    state = model.at(q, qd, qd, qdd, qd)
    np.testing.assert_allclose(state.torque_nm(model.nominal), expected, rtol=1e-9)
    np.testing.assert_allclose(model.acceleration(model.nominal, q, qd, expected), qdd, rtol=1e-9)
    power = float(np.dot(state.gradient(qd), model.nominal))
    assert power == pytest.approx(float(np.dot(qd, expected)), rel=1e-9)
    assert {name: len(values) for name, values in model.by_joint([1.0] * len(model.nominal)).items()} == {
        "inertia_factor": 5,
        "weight_factor": 5,
        "coulomb_factor": 5,
    }


@pytest.mark.parametrize("seed", range(6))
def test_the_regressor_of_many_states_is_pinocchio_s_dynamics_for_these_and_for_other_masses(seed: int) -> None:
    robot, rng = random_robot(seed + 1, seed), np.random.default_rng(seed)
    regressor = InertialRegressor(robot, smoothing_rad_s=1e-9)
    count = len(robot.joint)
    viscous, coulomb = rng.uniform(0.0, 0.5, count), rng.uniform(0.0, 0.5, count)
    heavier = [
        joint.solid.with_inertial(
            1.7 * joint.mass_kg, joint.solid.centre_of_mass_m, tuple(1.7 * each for each in joint.solid.tensor_kg_m2)
        )
        for joint in robot.joint
    ]
    q, qd, qdd = (rng.uniform(-2.0, 2.0, (POSES, count)) for _ in range(3))
    for other in (robot, robot_of(heavier)):
        torque_nm = regressor.rows(q, qd, qdd) @ regressor.values(other, viscous.tolist(), coulomb.tolist())
        model = pinocchio_model(other)
        rotors = np.array([joint.motor.reflected_inertia_kg_m2 for joint in other.joint])
        for pose in range(POSES):
            links_nm = pinocchio.rnea(model, model.createData(), q[pose], qd[pose], qdd[pose])
            drives_nm = rotors * qdd[pose] + viscous * qd[pose] + coulomb * np.sign(qd[pose])
            np.testing.assert_allclose(torque_nm[pose], links_nm + drives_nm, rtol=1e-9, atol=1e-9)
