"""The object that two robots carry: weight, grips that slip, and MuJoCo's own answer to what the controller expects."""

import dataclasses

import mujoco
import numpy as np
import pytest

from canarm_controller.dynamics import ClosedChain, HeldMotion, cell_arm
from canarm_emulator.errors import TruthError
from canarm_emulator.robot.carried import BODY
from canarm_emulator.robot.model_xml import model_xml
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import DirectionBits, World
from canarm_protocol.cell import load_cell

CELL = load_cell("rhino-pair")
G = 9.8062
WEIGHT_N = 0.4 * G
MILLISECOND = 1_000_000


def stiff_world(**truth: str) -> World:
    """Arms whose friction holds them, off their supports."""
    settings = {f"{name}.coulomb": "100" for name in CELL.joint_names} | truth
    world = World(CELL, Truth.from_settings(CELL, settings), 0)
    world.set_direction(0, DirectionBits.COUNTER_CLOCKWISE)
    world.advance(200 * MILLISECOND)
    return world


def test_both_hands_together_carry_its_weight() -> None:
    state = stiff_world().object
    assert state is not None
    up = np.array(state.master_force_n) + np.array(state.slave_force_n)
    np.testing.assert_allclose(up, [0.0, 0.0, WEIGHT_N], atol=1e-4)
    assert state.lost == ()


def test_while_parked_no_hand_carries_anything() -> None:
    state = World(CELL, Truth.from_settings(CELL), 0).object
    assert state is not None
    assert state.master_force_n == state.slave_force_n == (0.0, 0.0, 0.0)


def test_it_begins_in_the_masters_hand_and_points_where_the_cell_says() -> None:
    """Its place by the arm's own figures; at [0, -80, 90, -10, 90] deg the tool's x axis is the world's -y."""
    state = World(CELL, Truth.from_settings(CELL), 0).object
    assert state is not None
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, np.array(state.quaternion))
    np.testing.assert_allclose(turn.reshape(3, 3)[:, 0], [0.0, -1.0, 0.0], atol=1e-9)
    # a2·cos 80 + a3·cos 10 + a4·cos 0, with the hand pointing straight down.
    reach = 0.2286 * np.cos(np.radians(80)) + 0.2286 * np.cos(np.radians(10)) + 0.0095
    assert state.position_m[0] == pytest.approx(reach, abs=1e-9)


def test_a_grip_slips_beyond_its_force_and_the_other_hand_goes_on() -> None:
    """With 4 N, the master loses all of 3.92 N and what the hands press; with the slave's opened, it has it alone."""
    world = stiff_world()
    state = world.object
    assert state is not None
    grips = world._plant.grips
    assert grips is not None
    grips._slip_n = 4.0
    world.advance(201 * MILLISECOND)
    state = world.object
    assert state is not None
    assert state.lost == ("master", "slave")
    assert state.master_force_n == state.slave_force_n == (0.0, 0.0, 0.0)
    figures = world.object_summary()
    assert figures is not None
    assert figures["lost_by"] == ["master", "slave"]


def test_a_robot_parked_too_far_off_cannot_hold_it() -> None:
    truth = Truth.from_settings(CELL, {"slave_waist.initial_deg": "15"})
    with pytest.raises(TruthError, match=r"the hand of 'slave' is .* mm from where it is to hold it"):
        World(CELL, truth, 0)


def test_a_hand_that_is_a_little_off_takes_it_as_it_is() -> None:
    world = stiff_world(**{"object.base_x": "0.0006", "slave_elbow.initial_deg": "64.8"})
    state = world.object
    assert state is not None
    assert abs(state.squeeze_n) < 0.1


def free_model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The plant without friction and dampers, at home."""
    settings = {f"{name}.{key}": "0" for name in CELL.joint_names for key in ("coulomb", "viscous")}
    model = mujoco.MjModel.from_xml_string(model_xml(CELL, Truth.from_settings(CELL, settings)))
    return model, mujoco.MjData(model)


def close_grip(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Both points where they are now."""
    mujoco.mj_kinematics(model, data)
    body, hand = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in (BODY, "slave.hand"))
    point = data.xpos[body] + data.xmat[body].reshape(3, 3)[:, 0] * 0.3
    model.eq_data[0, 3:6] = data.xmat[hand].reshape(3, 3).T @ (point - data.xpos[hand])


def test_the_controllers_closed_chain_moves_as_mujocos() -> None:
    """Any torques, at speeds that the grips allow; with MuJoCo's pin as hard as it can be, which gives way by 1e-4."""
    model, data = free_model()
    model.eq_solimp[0, :2] = 0.9999
    arm, chain = cell_arm(CELL.laden, CELL.joint_names), ClosedChain(CELL)
    unladen = cell_arm(CELL.robot, CELL.joint_names)
    held, draw = HeldMotion(chain), np.random.default_rng(0)
    q = np.radians([joint.home_deg for joint in CELL.joints])
    rows, _ = chain.constraint(q.tolist(), [0.0] * 10)
    speed = 0.3 * draw.normal(size=10)
    speed -= np.linalg.pinv(rows) @ rows @ speed
    data.qpos[:], data.qvel[:] = q, speed
    close_grip(model, data)
    inertia = np.array(arm.inertia(q.tolist())) + np.diag(arm.rotor_inertia)
    blocks = [np.linalg.inv(inertia[:5, :5]).tolist(), np.linalg.inv(inertia[5:, 5:]).tolist()]
    held.refresh(q.tolist(), speed.tolist(), blocks)
    for _ in range(5):
        torque = 5.0 * draw.normal(size=10)
        data.qfrc_applied[:] = torque
        mujoco.mj_forward(model, data)
        load = np.array(arm.coriolis(q.tolist(), speed.tolist())) + np.array(arm.gravity(q.tolist()))
        free = np.linalg.solve(inertia, torque - load).tolist()
        expected = np.array(held.accelerations(free))
        np.testing.assert_allclose(expected, data.qacc, atol=1e-4 * np.abs(free).max())
    assert np.abs(np.array(unladen.gravity(q.tolist())) - np.array(arm.gravity(q.tolist()))).max() > 0.3


def test_what_the_robots_carry_together_is_the_object() -> None:
    """The shares: mass, and first and second moment about the master's grip, as of a rod about its end, m·L²/3."""
    carried = CELL.object
    assert carried is not None
    loads = carried.loads()
    master, slave = loads["master"], loads["slave"]
    assert master.mass_kg + slave.mass_kg == pytest.approx(0.4)
    assert master.mass_kg * master.centre_m[0] + slave.mass_kg * 0.3 == pytest.approx(0.4 * 0.3)
    about_end = master.tensor_kg_m2[1][1] + master.mass_kg * master.centre_m[0] ** 2 + slave.mass_kg * 0.3**2
    assert about_end == pytest.approx(0.4 * 0.6**2 / 3 + 0.4 * 0.015**2 / 4)


def blow_n(max_step_us: int) -> float:
    """The greatest grip force when the slave's shoulder jams at 0.1 rad/s, and with it stops the other nine rotors."""
    cell = CELL.model_copy(update={"physics": CELL.physics.model_copy(update={"max_step_us": max_step_us})})
    truth = Truth.from_settings(cell)
    world = World(cell, truth, 0)
    world.set_direction(0, DirectionBits.COUNTER_CLOCKWISE)
    rows, _ = ClosedChain(cell).constraint(world._plant.angle, [0.0] * 10)
    wanted = np.zeros(10)
    wanted[6] = 0.1
    speed = wanted - np.linalg.pinv(rows) @ rows @ wanted
    world.advance(MILLISECOND)
    world._plant.set_state(world._plant.angle, speed.tolist())
    joints = list(truth.joints)
    joints[6] = dataclasses.replace(joints[6], is_jammed=True)
    world.change(dataclasses.replace(truth, joints=tuple(joints)))
    world.advance(6 * MILLISECOND)
    figures = world.object_summary()
    assert figures is not None
    return float(figures["grip_peak_n"])


def test_pads_take_up_a_blow_however_short_the_steps_are() -> None:
    """Rigid arms make any force for one step; their momentum over the 10 ms of the pads does not depend on it."""
    coarse, fine = blow_n(650), blow_n(160)
    assert coarse > 3.0
    assert fine == pytest.approx(coarse, rel=0.15)


@pytest.mark.parametrize(("hand", "lost"), [("slave", ("slave",)), ("master", ("master", "slave"))])
def test_a_hand_that_opens_leaves_the_object_to_the_other_or_to_nobody(hand: str, lost: tuple[str, ...]) -> None:
    world = stiff_world()
    world.open_grip(hand)
    world.advance(201 * MILLISECOND)
    state = world.object
    assert state is not None
    assert state.lost == lost
    up_n = 0.0 if hand == "master" else WEIGHT_N
    world.advance(400 * MILLISECOND)
    state = world.object
    assert state is not None
    assert state.master_force_n[2] == pytest.approx(up_n, abs=1e-3)


def test_a_fault_of_a_joint_leaves_the_object_in_the_hands() -> None:
    """Any fault of the mechanics makes another plant, with the same grips."""
    world = stiff_world()
    truth = world.truth
    joints = (dataclasses.replace(truth.joints[0], is_jammed=True), *truth.joints[1:])
    world.change(dataclasses.replace(truth, joints=joints))
    world.advance(210 * MILLISECOND)
    state = world.object
    assert state is not None
    assert state.lost == ()
