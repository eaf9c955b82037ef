"""The MuJoCo arm against Pinocchio and against mechanics that can be done by hand."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from canarm_emulator.errors import EmulatorError
from canarm_emulator.plant import WIRE_LOSS_TIME_S, Plant, model_xml
from canarm_emulator.truth import JointTruth, Truth
from canarm_protocol.cell import Cell, Joint, Robot
from canarm_protocol.cell_file import load_cell

CELL = load_cell("konkuk1")
FRICTIONLESS = {f"{joint}.{kind}": "0" for joint in CELL.joint_names for kind in ("viscous", "coulomb")}
STEP_S = 650e-6  # the longest step of the shipped cell
G = 9.8062


def rhino_like_robot() -> Robot:
    """Five axes in space, with the RHINO's geometry and inertias that nothing simplifies; base z points up."""
    d = (0.2604, 0.0, 0.0, 0.0, 0.1683)
    a = (0.0, 0.2286, 0.2286, 0.0095, 0.0)
    alpha = (-90.0, 0.0, 0.0, -90.0, 0.0)
    joints = []
    for i in range(5):
        link = CELL.joints[0].link.model_copy(
            update={
                "a_m": a[i],
                "alpha_deg": alpha[i],
                "d_m": d[i],
                "theta_offset_deg": 11.0 * i,
                "mass_kg": 3.0 / (i + 1),
                "centre_of_mass_m": (0.01 * (i + 1), -0.03, 0.02 * i),
                "inertia_kg_m2": (4e-3, 5e-3 + i * 1e-4, 3e-3),
            }
        )
        joints.append(CELL.joints[0].model_copy(update={"name": f"axis{i + 1}", "link": link}))
    update = {"name": "rhino", "number": 2, "gravity_m_s2": (0.0, 0.0, -G), "joint": tuple(joints)}
    return CELL.robot[0].model_copy(update=update)


def cell_of(*robots: Robot) -> Cell:
    return CELL.model_copy(update={"robot": robots})


def one_joint_cell(gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> Cell:
    """Joint 2 alone, its rod turning about one end: J = 1/3·1 kg·0.18² m² and 0.054 kg·m² of the rotor."""
    robot = CELL.robot[0]
    return cell_of(robot.model_copy(update={"joint": robot.joint[:1], "gravity_m_s2": tuple(gravity)}))


LINK_INERTIA, ROTOR_INERTIA = 0.18**2 / 3, 0.054


def pinocchio_model(robot: Robot, truth: Sequence[JointTruth], rotors: bool) -> pin.Model:
    def turn(axis: Sequence[float], angle_deg: float) -> pin.SE3:
        return pin.SE3(pin.AngleAxis(math.radians(angle_deg), np.array(axis)).toRotationMatrix(), np.zeros(3))

    model = pin.Model()
    model.gravity.linear = np.array(robot.gravity_m_s2)
    parent, frame = 0, pin.SE3.Identity()
    for joint, true in zip(robot.joint, truth, strict=True):
        link: Joint = joint
        placement = frame * turn((0.0, 0.0, 1.0), link.link.theta_offset_deg)
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, joint.name)
        shift = pin.SE3(np.eye(3), np.array([joint.link.a_m, 0.0, joint.link.d_m]))
        frame = shift * turn((1.0, 0.0, 0.0), joint.link.alpha_deg)
        inertia = np.diag(joint.link.inertia_kg_m2) * true.mass_kg / joint.link.mass_kg
        body = pin.Inertia(true.mass_kg, np.array(joint.link.centre_of_mass_m), inertia)
        model.appendBodyToJoint(parent, body, frame)
    if rotors:
        model.armature = np.array([joint.motor.reflected_inertia_kg_m2 for joint in robot.joint])
    return model


def mujoco_model(cell: Cell, truth: Truth, rotors: bool) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(model_xml(cell, truth))
    model.dof_damping[:] = 0
    model.dof_frictionloss[:] = 0
    if not rotors:
        model.dof_armature[:] = 0
    return model


@pytest.mark.parametrize("rotors", [False, True])
@pytest.mark.parametrize("settings", [{}, {"joint3.mass": "0.9"}])
def test_two_links_accelerate_and_load_as_pinocchio_says(rotors: bool, settings: dict[str, str]) -> None:
    truth = Truth.from_settings(CELL, settings)
    ours, theirs = mujoco_model(CELL, truth, rotors), pinocchio_model(CELL.robot[0], truth.joints, rotors)
    data, pin_data = mujoco.MjData(ours), theirs.createData()
    random = np.random.default_rng(1)
    for _ in range(300):
        q, v, tau = random.uniform(-2.2, 2.2, 2), random.uniform(-3, 3, 2), random.uniform(-5, 5, 2)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(ours, data)
        expected = pin.aba(theirs, pin_data, q, v, tau)
        np.testing.assert_allclose(data.qacc, expected, rtol=1e-9, atol=1e-9)
        acceleration = random.uniform(-50, 50, 2)
        data.qacc[:] = acceleration
        mujoco.mj_inverse(ours, data)
        np.testing.assert_allclose(data.qfrc_inverse, pin.rnea(theirs, pin_data, q, v, acceleration), atol=1e-9)


def test_two_robots_with_bases_of_their_own_move_as_two_pinocchio_models() -> None:
    robots = (CELL.robot[0], rhino_like_robot())
    cell = cell_of(*robots)
    truth = Truth.from_settings(cell)
    ours = mujoco_model(cell, truth, rotors=False)
    parts = [(slice(0, 2), robots[0]), (slice(2, 7), robots[1])]
    oracles = [(part, pinocchio_model(robot, truth.joints[part], rotors=False)) for part, robot in parts]
    data = mujoco.MjData(ours)
    random = np.random.default_rng(2)
    for _ in range(100):
        q, v, a = random.uniform(-2.2, 2.2, 7), random.uniform(-3, 3, 7), random.uniform(-20, 20, 7)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(ours, data)
        for part, oracle in oracles:
            expected = pin.rnea(oracle, oracle.createData(), q[part], v[part], a[part])
            np.testing.assert_allclose(data.qfrc_inverse[part], expected, atol=1e-9)


def test_robots_that_disagree_on_the_strength_of_gravity_are_refused() -> None:
    moon = rhino_like_robot().model_copy(update={"gravity_m_s2": (0.0, 0.0, -1.62)})
    cell = cell_of(CELL.robot[0], moon)
    with pytest.raises(EmulatorError, match=r"'rhino': gravity_m_s2 of strength 1\.62 must be .* 9\.8062"):
        model_xml(cell, Truth.from_settings(cell))


def test_a_robot_on_the_ceiling_moves_as_its_own_pinocchio_model() -> None:
    ceiling = CELL.robot[0].model_copy(update={"name": "ceiling", "gravity_m_s2": (0.0, G, 0.0)})
    cell = cell_of(rhino_like_robot().model_copy(update={"gravity_m_s2": (0.0, -G, 0.0)}), ceiling)
    truth = Truth.from_settings(cell)
    ours, theirs = mujoco_model(cell, truth, rotors=False), pinocchio_model(ceiling, truth.joints[5:], rotors=False)
    data = mujoco.MjData(ours)
    data.qpos[5:] = [0.3, 0.7]
    mujoco.mj_inverse(ours, data)
    expected = pin.computeGeneralizedGravity(theirs, theirs.createData(), np.array([0.3, 0.7]))
    np.testing.assert_allclose(data.qfrc_inverse[5:], expected, atol=1e-9)


def test_a_held_joint_creeps_less_than_a_millirad_in_10_s_at_80_percent_of_its_friction() -> None:
    robot = CELL.robot[0].model_copy(update={"gravity_m_s2": (0.0, 0.0, 0.0)})
    cell = cell_of(robot)
    plant = Plant(cell, Truth.from_settings(cell))
    start = list(plant.angle)
    for _ in range(round(10 / STEP_S)):
        plant.step([0.8 * 0.15, -0.8 * 0.06], STEP_S)
    assert plant.angle == pytest.approx(start, abs=1e-5)


def test_beyond_its_friction_a_joint_accelerates_with_what_is_left() -> None:
    cell = one_joint_cell()
    plant = Plant(cell, Truth.from_settings(cell, {"joint2.viscous": "0", "joint2.initial_deg": "0"}))
    for _ in range(400):
        plant.step([0.25], 500e-6)
    acceleration = (0.25 - 0.15) / (LINK_INERTIA + ROTOR_INERTIA)
    assert plant.speed[0] == pytest.approx(acceleration * 0.2, rel=2e-3)
    assert plant.angle[0] == pytest.approx(acceleration * 0.2**2 / 2, rel=2e-3)


def test_viscous_friction_lets_the_speed_decay_with_inertia_over_damping() -> None:
    cell = one_joint_cell()
    plant = Plant(cell, Truth.from_settings(cell, {"joint2.viscous": "0.5", "joint2.coulomb": "0"}))
    plant.set_state(plant.angle, [1.0])
    for _ in range(400):
        plant.step([0.0], 500e-6)
    assert plant.speed[0] == pytest.approx(math.exp(-0.5 * 0.2 / (LINK_INERTIA + ROTOR_INERTIA)), rel=5e-3)


def test_a_frictionless_fall_keeps_its_energy() -> None:
    cell = cell_of(CELL.robot[0])
    plant = Plant(cell, Truth.from_settings(cell, FRICTIONLESS | {"joint2.initial_deg": "0"}))
    oracle = pinocchio_model(CELL.robot[0], Truth.from_settings(CELL).joints, rotors=True)

    def energy() -> float:
        q, v = np.array(plant.angle), np.array(plant.speed)
        data = oracle.createData()
        kinetic = 0.5 * v @ (pin.crba(oracle, data, q) @ v)
        return float(kinetic + pin.computePotentialEnergy(oracle, data, q))

    before, largest = energy(), 0.0
    for _ in range(round(0.35 / STEP_S)):
        plant.step([0.0, 0.0], STEP_S)
        largest = max(largest, abs(energy() - before))
    assert plant.angle[0] < -1.0
    assert largest < 3e-3  # of 4.9 J between the arm's highest and lowest pose


@pytest.mark.parametrize("wire", ["0", "1"])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_stops_hold_at_full_speed_and_full_torque(sign: int, wire: str) -> None:
    plant = Plant(CELL, Truth.from_settings(CELL, {"joint2.wire": wire, "joint3.wire": wire}))
    copies = 2 if wire == "1" else 1
    speed = [sign * 6.0, sign * 8.0]  # twice the no-load speed
    plant.set_state([sign * 2.0, sign * 2.0] * copies, speed * copies)
    largest = [0.0, 0.0]
    for _ in range(round(2 / STEP_S)):
        plant.step([sign * 1.5 * 4.08, sign * 1.5 * 2.72], STEP_S)
        largest = [max(old, abs(angle)) for old, angle in zip(largest, plant.angle, strict=False)]
    stop = math.radians(130)
    assert max(largest) < stop + math.radians(2)
    assert [sign * angle for angle in plant.angle[:2]] == pytest.approx([stop, stop], abs=math.radians(0.2))
    assert plant.speed[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_the_elastic_wire_rings_at_its_analytic_frequency_and_damping() -> None:
    cell = one_joint_cell()
    plant = Plant(cell, Truth.from_settings(cell, {"joint2.viscous": "0", "joint2.coulomb": "0", "joint2.wire": "1"}))
    plant.set_state([0.0, 0.01], [0.0, 0.0])
    crossings, peaks, old = [], [], 0.01
    for step in range(1, round(0.4 / STEP_S)):
        plant.step([0.0], STEP_S)
        twist = plant.angle[1] - plant.angle[0]
        if old > 0 >= twist:
            crossings.append((step - 1 + old / (old - twist)) * STEP_S)
            peaks.append(0.0)
        if peaks:
            peaks[-1] = max(peaks[-1], abs(twist))
        old = twist
    stiffness = 200.0
    natural = math.sqrt(stiffness * (1 / LINK_INERTIA + 1 / ROTOR_INERTIA))
    damping = natural * WIRE_LOSS_TIME_S / 2
    measured = 2 * math.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    assert measured == pytest.approx(natural * math.sqrt(1 - damping**2), rel=3e-3)
    decrement = math.log(peaks[0] / peaks[5]) / (5 * 2 * math.pi)
    assert decrement == pytest.approx(damping / math.sqrt(1 - damping**2), rel=0.05)


def test_a_wire_under_load_stretches_by_torque_over_stiffness() -> None:
    plant = Plant(CELL, Truth.from_settings(CELL, {"joint2.wire": "1", "joint2.coulomb": "100"}))
    stretch_rad = (0.5 + 0.6 + 0.3) * G * 0.18 / 200  # the whole arm, horizontal, on 200 N·m/rad
    plant.set_state([-stretch_rad, stretch_rad, 0.0], [0.0] * 3)
    for _ in range(round(0.5 / STEP_S)):
        plant.step([0.0, 0.3 * G * 0.18], STEP_S)  # joint 3 carries its own link
    assert plant.angle == pytest.approx([-stretch_rad, stretch_rad, 0.0], abs=0.01 * stretch_rad)
