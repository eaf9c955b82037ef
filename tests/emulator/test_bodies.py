"""Arms of bodies in MuJoCo against Pinocchio: any axis, full inertia tensors, tilted bases, one to seven joints."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from canarm_emulator.robot.model_xml import model_xml, own_gravity
from canarm_emulator.robot.plant import Plant
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import World
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Body, Cell, Joint, Robot

KONKUK = load_cell("konkuk1")
STATES = 20


def random_body(random: np.random.Generator) -> Body:
    """Of random place and axis, and the inertia of a random cloud of points, which no rule of moments can refuse."""
    cloud = random.normal(size=(6, 3)) * 0.05
    tensor = sum(0.2 * ((point @ point) * np.eye(3) - np.outer(point, point)) for point in cloud - cloud.mean(axis=0))
    tensor = np.asarray(tensor)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    x, y, z = axis.tolist()
    moments = tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]
    ixx, iyy, izz, ixy, ixz, iyz = map(float, moments)
    return Body(
        origin_m=vector(random.uniform(-0.3, 0.3, 3)),
        origin_rpy_deg=vector(random.uniform(-180, 180, 3)),
        axis=(x, y, z),
        mass_kg=float(random.uniform(0.2, 3.0)),
        centre_of_mass_m=vector(random.uniform(-0.2, 0.2, 3)),
        inertia_kg_m2=(ixx, iyy, izz, ixy, ixz, iyz),
    )


def vector(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def robot_of(name: str, count: int, random: np.random.Generator, is_tilted: bool = True) -> Robot:
    """An arm of `count` bodies whose gravity is that of the world, 9.81 m/s² down z, seen from its base."""
    rpy_deg = vector(random.uniform(-180, 180, 3)) if is_tilted else (0.0, 0.0, 0.0)
    down = pin.rpy.rpyToMatrix(*map(math.radians, rpy_deg)).T @ np.array([0.0, 0.0, -9.81])
    joints: list[Joint] = []
    for number in range(count):
        update = {"name": f"axis{number + 1}", "link": None, "body": random_body(random)}
        joints.append(KONKUK.joints[0].model_copy(update=update))
    update = {"name": name, "joint": tuple(joints), "base_rpy_deg": rpy_deg, "base_m": (1.0, -2.0, 0.5)}
    return KONKUK.robot[0].model_copy(update=update | {"gravity_m_s2": vector(down)})


def cell_of(*robots: Robot) -> Cell:
    return KONKUK.model_copy(update={"robot": robots})


def oracle_of(robot: Robot) -> pin.Model:
    """The arm in its base's frame, written down from the fields of its bodies as URDF defines them."""
    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity_m_s2)
    parent = 0
    for joint in robot.joint:
        body = joint.body
        assert body is not None
        turn = pin.rpy.rpyToMatrix(*map(math.radians, body.origin_rpy_deg))
        revolute = pin.JointModelRevoluteUnaligned(np.array(body.axis))
        parent = model.addJoint(parent, revolute, pin.SE3(turn, np.array(body.origin_m)), joint.name)
        xx, yy, zz, xy, xz, yz = body.inertia_kg_m2
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = pin.Inertia(body.mass_kg, np.array(body.centre_of_mass_m), tensor)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    return model


def ours(cell: Cell) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """MuJoCo's model without friction and rotors, with each robot's own gravity."""
    model = mujoco.MjModel.from_xml_string(model_xml(cell, Truth.from_settings(cell)))
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0
    model.jnt_limited[:] = 0
    data, forces = mujoco.MjData(model), own_gravity(cell, model)
    if forces is not None:
        data.xfrc_applied[:] = forces
    return model, data


@pytest.mark.parametrize("count", range(1, 8))
def test_inertia_coriolis_and_gravity_of_any_chain_are_pinocchios(count: int) -> None:
    random = np.random.default_rng(count)
    robot = robot_of("arm", count, random)
    oracle = oracle_of(robot)
    pin_data = oracle.createData()
    model, data = ours(cell_of(robot))
    inertia = np.zeros((count, count))
    for _ in range(STATES):
        q, v = random.uniform(-3, 3, count), random.uniform(-4, 4, count)
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        np.testing.assert_allclose(inertia, pin.crba(oracle, pin_data, q), atol=1e-10)
        gravity = pin.computeGeneralizedGravity(oracle, pin_data, q)
        coriolis = pin.nonLinearEffects(oracle, pin_data, q, v) - gravity
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_bias, gravity, atol=1e-9)
        data.qvel[:] = v
        model.opt.gravity[:], standing = 0, model.opt.gravity.copy()
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_bias, coriolis, atol=1e-9)
        model.opt.gravity[:] = standing


def test_robots_on_bases_of_their_own_accelerate_each_as_its_own_pinocchio_model() -> None:
    """The second has the Moon's gravity, sideways: what a cell says of a robot holds for that robot alone."""
    random = np.random.default_rng(11)
    first, second, third = (robot_of(name, count, random) for name, count in (("a", 3), ("b", 2), ("c", 7)))
    second = second.model_copy(update={"gravity_m_s2": (1.62, 0.0, 0.0)})
    robots = (first, second, third)
    model, data = ours(cell_of(*robots))
    for _ in range(STATES):
        q, v, tau = random.uniform(-3, 3, 12), random.uniform(-3, 3, 12), random.uniform(-2, 2, 12)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(model, data)
        begin = 0
        for robot in robots:
            part = slice(begin, begin + len(robot.joint))
            oracle = oracle_of(robot)
            expected = pin.aba(oracle, oracle.createData(), q[part], v[part], tau[part])
            np.testing.assert_allclose(data.qacc[part], expected, rtol=1e-7, atol=1e-6)
            begin = part.stop


def test_a_payload_hangs_where_the_next_joint_sits_and_at_the_end_of_a_rod_on_the_last() -> None:
    random = np.random.default_rng(5)
    robot = robot_of("arm", 2, random)
    cell = cell_of(robot)
    truth = Truth.from_settings(cell)
    loaded = Plant(cell, _with_payload(truth, 0.5))
    oracle = oracle_of(robot)
    first, second = (joint.body for joint in robot.joint)
    assert first is not None
    assert second is not None
    tips = np.array(second.origin_m), 2.0 * np.array(second.centre_of_mass_m)
    for number, tip in enumerate(tips, start=1):
        oracle.appendBodyToJoint(number, pin.Inertia(0.5, tip, np.zeros((3, 3))), pin.SE3.Identity())
    oracle.armature = np.array([joint.motor.reflected_inertia_kg_m2 for joint in robot.joint])
    loaded.set_state([0.3, -0.4], [0.0, 0.0])
    loaded.strike([0.1, 0.0])
    inertia = pin.crba(oracle, oracle.createData(), np.array([0.3, -0.4]))
    np.testing.assert_allclose(loaded.speed, np.linalg.solve(inertia, [0.1, 0.0]), rtol=1e-8)


def _with_payload(truth: Truth, payload_kg: float) -> Truth:
    return replace(truth, joints=tuple(replace(joint, payload_kg=payload_kg) for joint in truth.joints))


def test_a_robot_rests_on_its_support_until_its_own_first_bridge_is_on() -> None:
    one = KONKUK.robot[0]
    cell = cell_of(one, one.model_copy(update={"name": "other", "number": 2}))
    world = World(cell, Truth.from_settings(cell), 0)
    home = [math.radians(20), 0.0]
    world.set_direction(2, DirectionBits.CLOCKWISE)
    world.advance(300_000_000)
    angles = [state.angle_rad for state in world.state()]
    assert angles[:2] == home
    assert angles[2] < home[0] - 0.5
    assert not world.parked
    world.strike(0, 0.1)
    world.set_direction(1, DirectionBits.CLOCKWISE)
    world.advance(600_000_000)
    assert world.state()[0].angle_rad < home[0] - 0.5
