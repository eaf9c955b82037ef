"""The cell of two RHINO robots: published figures, its bus, and the paper's circle by both arms, not yet coupled."""

import numpy as np
import pytest

from canarm import Rig, State
from canarm.cooperation import RHINO_XR, CarriedObject, circle, pair_of, plan_cooperation
from canarm_controller.dynamics import nominal_arm
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.schedulability import cell_messages, cell_verdict
from canarm_protocol.cell.sensing import position_steps_rad

CELL = load_cell("rhino-pair")
MASTER, SLAVE = CELL.robot
PAIR = pair_of(MASTER, SLAVE, CarriedObject(length_m=0.6))
START = np.radians([joint.home_deg for joint in MASTER.joint])
NAMES = [f"{robot.name}_{joint.name}" for robot in CELL.robot for joint in robot.joint]


def test_both_arms_are_rhinos_and_parked_where_the_papers_circle_begins() -> None:
    for arm in (PAIR.master, PAIR.slave):
        assert (arm.d_m, arm.a_m, arm.alpha_deg) == (RHINO_XR.d_m, RHINO_XR.a_m, RHINO_XR.alpha_deg)
    plan = plan_cooperation(PAIR, circle(), START)
    np.testing.assert_allclose(np.degrees(plan.slave_rad[0]), [joint.home_deg for joint in SLAVE.joint], atol=1e-3)


@pytest.mark.parametrize(
    ("decoding", "published"), [(1, (4.4, 8.7, 8.7, 8.7, 3.2)), (4, (17.5, 34.9, 34.9, 34.9, 12.8))]
)
def test_encoders_count_as_published(decoding: int, published: tuple[float, ...]) -> None:
    """Counts a degree of the Mark III, and of the Mark IV, which counts every edge."""
    cards = tuple(
        card.model_copy(update={"decoding": decoding} if "counter" in card.name else {}) for card in CELL.card
    )
    cell = CELL.model_copy(update={"card": cards})
    np.testing.assert_allclose(np.radians(1.0) / np.array(position_steps_rad(cell)), published * 2, rtol=0.01)


def test_no_drive_holds_more_than_half_of_its_current_along_the_circle() -> None:
    plan = plan_cooperation(PAIR, circle(), START)
    for robot, path in ((MASTER, plan.master_rad), (SLAVE, plan.slave_rad)):
        arm = nominal_arm(robot)
        held_a = np.array([arm.gravity(q.tolist()) for q in path[::50]]) / np.array(arm.torque_per_ampere)
        assert np.abs(held_a).max() < 0.5 * 1.5
    assert np.abs(held_a).max() > 0.4 * 1.5  # the slave's shoulder


def test_what_ten_joints_say_every_cycle_fits_the_bus() -> None:
    """SYNC with its counter; TPDOs of 2 + 2 + 1 counts, RPDOs of 4 + 1 currents and of 4 + 1 directions, each robot."""

    def frame(data_bytes: int) -> int:
        """Standard frame with worst-case stuffing and intermission."""
        return 8 * data_bytes + 44 + (34 + 8 * data_bytes - 1) // 4 + 3

    assert [frame(length) for length in (8, 4, 2, 1)] == [135, 95, 75, 65]
    every_cycle = frame(1) + 6 * frame(8) + 2 * frame(4) + 2 * frame(2) + 4 * frame(1)
    messages = [message for message in cell_messages(CELL) if message.period_ns == CELL.bus.cycle_ns]
    assert sum(message.bits for message in messages) == every_cycle == 1475
    verdict = cell_verdict(CELL)
    assert verdict.fits
    assert verdict.load < 0.65


def test_both_arms_follow_the_plan_on_the_bench() -> None:
    """Free arms: the object couples them later. One step is 0.23 deg at a waist, 0.11 at a shoulder."""
    plan = plan_cooperation(PAIR, circle(ease_s=1.0), START)
    with Rig(CELL, law="mras", trajectory=plan.columns(NAMES)) as rig:
        rig.run(seconds=4.0)
        assert rig.state is State.RUNNING
        assert max(joint.rms_error_lsb for joint in rig.joints.values()) < 1.5
        reached = np.array([rig.joints[name].true_angle_rad[-1] for name in NAMES])
        meant = np.array([rig.joints[name].reference_rad[-1] for name in NAMES])
    assert np.degrees(np.abs(meant - plan.joint_rad[0]).max()) > 1.0  # it has moved
    assert np.degrees(np.abs(reached - meant).max()) < 0.6
