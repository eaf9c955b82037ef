"""The MuJoCo arm against Pinocchio and against mechanics that can be done by hand."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from canarm_emulator.robot.model_xml import BEARING_SHARE, WIRE_LOSS_TIME_S, model_xml, own_gravity
from canarm_emulator.robot.plant import Plant
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell, Joint, Robot

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
        shift = pin.SE3(np.eye(3), np.array([joint.dh_link.a_m, 0.0, joint.dh_link.d_m]))
        frame = shift * turn((1.0, 0.0, 0.0), joint.dh_link.alpha_deg)
        inertia = np.diag(joint.dh_link.inertia_kg_m2) * true.mass_kg / joint.dh_link.mass_kg
        body = pin.Inertia(true.mass_kg, np.array(joint.dh_link.centre_of_mass_m), inertia)
        model.appendBodyToJoint(parent, body, frame)
        payload = pin.Inertia(true.payload_kg, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(parent, payload, frame)
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
    forces = own_gravity(cell, ours)
    assert forces is not None
    data.xfrc_applied[:] = forces
    random = np.random.default_rng(2)
    for _ in range(100):
        q, v, a = random.uniform(-2.2, 2.2, 7), random.uniform(-3, 3, 7), random.uniform(-20, 20, 7)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, a
        mujoco.mj_forward(ours, data)
        for part, oracle in oracles:
            expected = pin.aba(oracle, oracle.createData(), q[part], v[part], a[part])
            np.testing.assert_allclose(data.qacc[part], expected, rtol=1e-8, atol=1e-6)


def test_a_robot_on_the_ceiling_moves_as_its_own_pinocchio_model() -> None:
    ceiling = CELL.robot[0].model_copy(update={"name": "ceiling", "gravity_m_s2": (0.0, G, 0.0)})
    cell = cell_of(rhino_like_robot().model_copy(update={"gravity_m_s2": (0.0, -G, 0.0)}), ceiling)
    truth = Truth.from_settings(cell)
    ours, theirs = mujoco_model(cell, truth, rotors=False), pinocchio_model(ceiling, truth.joints[5:], rotors=False)
    data = mujoco.MjData(ours)
    forces = own_gravity(cell, ours)
    assert forces is not None
    data.xfrc_applied[:] = forces
    data.qpos[5:] = [0.3, 0.7]
    mujoco.mj_forward(ours, data)
    expected = pin.aba(theirs, theirs.createData(), np.array([0.3, 0.7]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(data.qacc[5:], expected, rtol=1e-9)


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


def truth_with(settings: dict[str, str] | None = None, cell: Cell = CELL, **fields: Any) -> Truth:
    """The truth of `settings`, with `fields` of every joint replaced."""
    truth = Truth.from_settings(cell, settings)
    return replace(truth, joints=tuple(replace(joint, **fields) for joint in truth.joints))


ELASTIC: dict[str, Any] = {"has_elastic_wire": True}
SLACK = ELASTIC | {"wire_dead_band_rad": math.radians(5)}
BROKEN = ELASTIC | {"wire_is_broken": True}


def run(plant: Plant, seconds: float, *torque_nm: float) -> None:
    for _ in range(round(seconds / STEP_S)):
        plant.step(torque_nm, STEP_S)


def test_payloads_are_point_masses_at_the_ends_of_the_links() -> None:
    cell = cell_of(rhino_like_robot())
    truth = truth_with(cell=cell, payload_kg=0.7)
    ours, theirs = mujoco_model(cell, truth, rotors=False), pinocchio_model(cell.robot[0], truth.joints, rotors=False)
    data = mujoco.MjData(ours)
    random = np.random.default_rng(3)
    for _ in range(100):
        q, v, a = random.uniform(-2.2, 2.2, 5), random.uniform(-3, 3, 5), random.uniform(-20, 20, 5)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(ours, data)
        np.testing.assert_allclose(
            data.qfrc_inverse, pin.rnea(theirs, theirs.createData(), q, v, a), rtol=1e-9, atol=1e-9
        )


@pytest.mark.parametrize("fields", [{}, ELASTIC, SLACK, BROKEN], ids=["rigid", "elastic", "slack", "broken"])
def test_an_arm_rebuilt_as_it_was_moves_on_bit_for_bit(fields: dict[str, Any]) -> None:
    truth, other = truth_with(**fields), truth_with(payload_kg=0.1, **fields)
    plants = [Plant(CELL, truth), Plant(CELL, truth)]
    for plant in plants:
        run(plant, 0.2, 2.4, 0.5)
    plants[1] = plants[1].changed(other).changed(truth)
    for _ in range(300):
        for plant in plants:
            plant.step([2.4, 0.5], STEP_S)
        assert plants[0].angle == plants[1].angle
        assert plants[0].speed == plants[1].speed


def test_an_arm_whose_mechanics_stay_is_not_rebuilt() -> None:
    plant = Plant(CELL, truth_with())
    assert plant.changed(truth_with(supply_v=12.0, winding_ohm=3.0)) is plant
    assert plant.changed(truth_with(mass_kg=0.7)) is not plant


@pytest.mark.parametrize("fields", [{}, ELASTIC], ids=["rigid", "elastic"])
def test_an_impulse_changes_the_speeds_by_the_inverse_inertia_that_pinocchio_has(fields: dict[str, Any]) -> None:
    truth = truth_with(**fields)
    plant = Plant(CELL, truth)
    motors = [0.3, -0.2] if fields else []
    plant.set_state([0.4, 0.9, *([0.4, 0.9] if fields else [])], [0.3, -0.2, *motors])
    plant.strike([0.05, -0.02])
    oracle = pinocchio_model(CELL.robot[0], truth.joints, rotors=not fields)
    inertia = pin.crba(oracle, oracle.createData(), np.array([0.4, 0.9]))
    arm = np.array([0.3, -0.2]) + np.linalg.solve(inertia, [0.05, -0.02])
    np.testing.assert_allclose(plant.speed, [*arm, *motors], rtol=1e-9)


def test_an_impulse_turns_a_rod_by_impulse_over_inertia() -> None:
    cell = one_joint_cell()
    plant = Plant(cell, Truth.from_settings(cell))
    plant.strike([-0.03])
    assert plant.speed == pytest.approx([-0.03 / (LINK_INERTIA + ROTOR_INERTIA)], rel=1e-9)


def test_wires_that_turn_rigid_conserve_the_momentum_of_arm_and_motors() -> None:
    plant = Plant(CELL, truth_with(**BROKEN))
    q, v, w = np.array([0.4, 0.9]), np.array([1.0, -2.0]), np.array([3.0, 4.0])
    plant.set_state([*q, 17.0, -40.0], [*v, *w])
    sound = plant.changed(truth_with())
    arm = pinocchio_model(CELL.robot[0], truth_with().joints, rotors=False)
    rotors = np.diag([0.054, 0.024])  # 60² and 40² times 1.5e-5 kg·m²
    inertia = pin.crba(arm, arm.createData(), q)
    np.testing.assert_allclose((inertia + rotors) @ sound.speed, inertia @ v + rotors @ w, rtol=1e-9)
    assert sound.angle == list(q)
    before = v @ inertia @ v + w @ rotors @ w
    assert np.array(sound.speed) @ (inertia + rotors) @ sound.speed < before  # as in any plastic impact


def test_a_wire_that_turns_elastic_keeps_joint_and_motor_together() -> None:
    plant = Plant(CELL, truth_with())
    plant.set_state([0.4, 0.9], [1.0, -2.0])
    elastic = plant.changed(truth_with(**ELASTIC))
    assert elastic.angle == [0.4, 0.9, 0.4, 0.9]
    assert elastic.speed == [1.0, -2.0, 1.0, -2.0]


@pytest.mark.parametrize(
    ("before", "after", "twist_deg", "kept_deg"),
    [
        (BROKEN, ELASTIC, 400.0, 0.0),  # tied again
        (BROKEN, SLACK, -400.0, -5.0),
        (SLACK, ELASTIC, 3.0, 0.0),  # the slack is wound up
        (SLACK, ELASTIC, 5.5, 0.5),  # and the tension stays
        (ELASTIC, SLACK, -0.5, -0.5),  # falls slack
        (ELASTIC | {"wire_stiffness_nm_rad": 50.0}, ELASTIC | {"wire_stiffness_nm_rad": 200.0}, 4.0, 1.0),
        (ELASTIC | {"wire_stiffness_nm_rad": 200.0}, ELASTIC | {"wire_stiffness_nm_rad": 50.0}, 1.0, 1.0),
        (ELASTIC, BROKEN, 1.0, 1.0),
    ],
)
def test_no_wire_gains_tension_when_it_is_mended(
    before: dict[str, Any], after: dict[str, Any], twist_deg: float, kept_deg: float
) -> None:
    cell = one_joint_cell()
    plant = Plant(cell, truth_with(cell=cell, **before))
    plant.set_state([0.1, 0.1 + math.radians(twist_deg)], [1.0, 2.0])
    changed = plant.changed(truth_with(cell=cell, **after))
    assert changed.angle[0] == 0.1
    assert math.degrees(changed.angle[1] - 0.1) == pytest.approx(kept_deg, abs=1e-9)
    assert changed.speed == [1.0, 2.0]


@pytest.mark.parametrize("jammed", [0, 1])
@pytest.mark.parametrize("wire", [{}, ELASTIC], ids=["rigid", "elastic"])
def test_a_jammed_joint_stops_at_once_and_holds_against_full_torque_from_both_motors(
    jammed: int, wire: dict[str, Any]
) -> None:
    sound = truth_with(**wire)
    joints = list(sound.joints)
    joints[jammed] = replace(joints[jammed], is_jammed=True)
    plant = Plant(CELL, sound)
    plant.set_state([0.3, 0.0] * (2 if wire else 1), [2.0, -2.0] * (2 if wire else 1))
    at_rad = plant.angle[jammed]
    plant = plant.changed(replace(sound, joints=tuple(joints)))
    plant.step([1.5 * 4.08, 1.5 * 2.72], STEP_S)
    assert plant.speed[jammed] == pytest.approx(0.0, abs=2e-3)
    run(plant, 1.0, 1.5 * 4.08, 1.5 * 2.72)
    assert plant.angle[jammed] == pytest.approx(at_rad, abs=2.0 * STEP_S)
    assert plant.angle[1 - jammed] > 1.0
    if wire:  # the motor pulls at the wire with all its torque, 200 and 80 N·m/rad
        stretch_rad = (1.5 * 4.08 / 200, 1.5 * 2.72 / 80)[jammed]
        assert plant.angle[2 + jammed] - plant.angle[jammed] == pytest.approx(stretch_rad, abs=0.1 * stretch_rad)
    free = plant.changed(sound)
    run(free, 0.1, 1.5 * 4.08, 1.5 * 2.72)
    assert free.angle[jammed] > at_rad + 1e-3


def half_period(plant: Plant, dof: int, centre_rad: float) -> float:
    """Time between two passages through `centre_rad`, interpolated."""
    passages: list[float] = []
    old = plant.angle[dof] - centre_rad
    for step in range(1, 5000):
        plant.step([0.0] * len(plant.motor_dof), STEP_S)
        new = plant.angle[dof] - centre_rad
        if old * new < 0:
            passages.append((step - 1 + old / (old - new)) * STEP_S)
            if len(passages) == 2:
                return passages[1] - passages[0]
        old = new
    raise AssertionError("no oscillation")


def test_with_joint_2_jammed_joint_3_swings_as_a_pendulum_with_its_rotor() -> None:
    truth = Truth.from_settings(CELL, FRICTIONLESS)
    plant = Plant(CELL, replace(truth, joints=(replace(truth.joints[0], is_jammed=True), truth.joints[1])))
    plant.set_state([0.0, -math.pi / 2 + 0.02], [0.0, 0.0])
    natural = math.sqrt(0.6 * G * 0.09 / (0.6 * 0.18**2 / 3 + 0.024))
    assert half_period(plant, 1, -math.pi / 2) == pytest.approx(math.pi / natural, rel=2e-3)


def test_on_a_broken_wire_the_link_swings_as_a_rod_and_the_motor_turns_with_its_rotor_alone() -> None:
    cell = one_joint_cell((0.0, -G, 0.0))
    frictionless = {"joint2.viscous": "0", "joint2.coulomb": "0"}
    plant = Plant(cell, truth_with(frictionless, cell, **BROKEN))
    plant.set_state([-math.pi / 2 + 0.02, 0.0], [0.0, 0.0])
    assert half_period(plant, 0, -math.pi / 2) == pytest.approx(math.pi / math.sqrt(3 * G / (2 * 0.18)), rel=1e-3)
    before = plant.speed[1]
    run(plant, 0.13, 0.2)
    assert plant.speed[1] - before == pytest.approx(0.2 * 0.13 / ROTOR_INERTIA, rel=1e-6)
    assert abs(plant.angle[0] + math.pi / 2) < 0.0201


def test_the_bearing_of_a_link_on_a_broken_wire_keeps_its_share_of_the_friction_and_the_motor_the_rest() -> None:
    cell = one_joint_cell()
    plant = Plant(cell, truth_with({"joint2.viscous": "0.5", "joint2.coulomb": "0"}, cell, **BROKEN))
    plant.set_state([0.0, 0.0], [1.0, 1.0])
    run(plant, 0.13, 0.0)
    left = [math.exp(-0.5 * share * 0.13 / inertia) for share, inertia in
            ((BEARING_SHARE, LINK_INERTIA), (1 - BEARING_SHARE, ROTOR_INERTIA))]  # fmt: skip
    assert plant.speed == pytest.approx(left, rel=5e-3)


def test_a_slack_wire_carries_nothing_inside_its_dead_band() -> None:
    cell = one_joint_cell()
    frictionless = {"joint2.viscous": "0", "joint2.coulomb": "0"}
    plant = Plant(cell, truth_with(frictionless, cell, **SLACK))
    plant.set_state([0.0, 0.0], [0.0, 0.0])
    run(plant, 0.15, 0.3)
    assert plant.angle[1] == pytest.approx(0.3 * (231 * STEP_S) ** 2 / 2 / ROTOR_INERTIA, rel=1e-6)  # 3.6°
    assert plant.angle[0] == 0.0
    run(plant, 0.15, 0.3)
    assert plant.angle[0] > 0.01  # taken along


def test_under_load_a_slack_wire_gives_way_by_its_dead_band_and_stretches() -> None:
    cell = one_joint_cell((0.0, -G, 0.0))
    plant = Plant(cell, truth_with({"joint2.coulomb": "100", "joint2.initial_deg": "0"}, cell, **SLACK))
    run(plant, 3.0, 0.0)
    load_nm = 1.0 * G * 0.09 * math.cos(math.radians(5.25))
    assert plant.angle[0] == pytest.approx(-math.radians(5) - load_nm / 200, abs=1e-4)
    assert plant.speed[0] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("dead_band_deg", [0.1, 5.0, 45.0])
def test_slack_wires_never_make_energy(dead_band_deg: float) -> None:
    truth = truth_with(FRICTIONLESS, **ELASTIC, wire_dead_band_rad=math.radians(dead_band_deg))
    plant = Plant(CELL, truth)
    plant.set_state([-1.4, 0.3, -1.4, 0.3], [0.0, 0.0, 2.0, -3.0])
    arm = pinocchio_model(CELL.robot[0], truth.joints, rotors=False)
    data = arm.createData()

    def energy() -> float:
        q, v, w = np.array(plant.angle[:2]), np.array(plant.speed[:2]), np.array(plant.speed[2:])
        stretch = np.maximum(np.abs(np.array(plant.angle[2:]) - q) - math.radians(dead_band_deg), 0.0)
        kinetic = v @ pin.crba(arm, data, q) @ v / 2 + [0.054, 0.024] @ w**2 / 2
        return float(kinetic + [200.0, 80.0] @ stretch**2 / 2 + pin.computePotentialEnergy(arm, data, q))

    least = energy()
    for _ in range(round(3.0 / STEP_S)):
        plant.step([0.0, 0.0], STEP_S)
        now = energy()
        assert now < least + 1e-3  # J, of 4.9 J between the arm's highest and lowest pose
        least = min(least, now)
        assert max(map(abs, plant.angle[:2])) < 2.0  # the stops have no part in it


def test_the_shipped_step_is_short_enough_for_a_slack_wire() -> None:
    angles = []
    for divisor in (1, 13):
        plant = Plant(CELL, truth_with(**SLACK))
        for _ in range(400 * divisor):
            plant.step([2.6, 0.6], STEP_S / divisor)
        angles.append(plant.angle)
    assert angles[0] == pytest.approx(angles[1], abs=0.5 * math.radians(270 / 255))  # ½ LSB after 0.26 s
    assert max(abs(angles[0][2 + joint] - angles[0][joint]) for joint in (0, 1)) > math.radians(4)
