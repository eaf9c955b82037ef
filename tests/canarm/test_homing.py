"""Homing by the encoders' index: afterwards every angle is known to half a count, wherever the arm was parked."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from canarm import Rig, State
from canarm_controller.laws.loading import load_law
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad
from tests.resolutions import cell_of_encoders, homed

PAIR = load_cell("rhino-pair")
JOINTS = homed(cell_of_encoders())


def parked(cell: Cell, seed: int, within_deg: float) -> dict[str, object]:
    draw = np.random.default_rng(seed).uniform(-within_deg, within_deg, len(cell.joints))
    rows = zip(cell.joint_names, cell.joints, draw, strict=True)
    return {f"{name}.initial_deg": joint.home_deg + off for name, joint, off in rows}


def off_counts(rig: Rig, cycles: slice) -> np.ndarray:
    """The largest difference between measured and true angle of each joint, in counts."""
    steps = position_steps_rad(rig.cell)
    rows = zip(rig.joints.values(), steps, strict=True)
    return np.array([np.abs(joint.measured_rad - joint.true_angle_rad)[cycles].max() / step for joint, step in rows])


@pytest.mark.parametrize(
    ("law", "seed"), [("mras", 1), ("mras-lyapunov", 2), ("slotine-li", 3), ("computed-torque", 4)]
)
def test_encoders_on_the_joints_are_homed_with_any_law(law: str, seed: int) -> None:
    """2048 lines, four counts each: at 20 degrees the index is on one side, at 0 it may be on either."""
    with Rig(JOINTS, law=law, truth=parked(JOINTS, seed, 0.5)) as rig:
        rig.run(6.0)
        assert rig.state is State.RUNNING
        assert not rig.detections
        begins = round(rig.approach_s / 0.0025)
        assert off_counts(rig, slice(0, begins - 2)).max() > 1.5
        # A sample is referred to SYNC by the speed; that is worth a few hundredths of a count.
        assert off_counts(rig, slice(begins, None)).max() < 0.6


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.slow) for seed in (7, 8, 9)])
def test_two_robots_are_homed_with_the_object_in_their_hands(seed: int) -> None:
    """Parked up to 0.28 degrees off, 2.4 counts of a shoulder, which is up to 2.5 mm at a tip."""
    with Rig("rhino-pair", truth=parked(PAIR, seed, 0.28)) as rig:
        rig.run(5.0)
        assert rig.state is State.RUNNING
        assert not rig.detections
        begins = round(rig.approach_s / 0.0025)
        assert off_counts(rig, slice(0, 400)).max() > 1.5
        assert off_counts(rig, slice(begins, None)).max() < 0.6
        assert rig.object.is_held
        assert rig.object.grip_force_n.max() < rig.object.slip_force_n / 2


@pytest.mark.parametrize("law", ["mras", "mras-lyapunov", "slotine-li", "computed-torque", "pd"])
def test_a_law_does_not_notice_that_its_joints_have_been_homed(law: str) -> None:
    """The same errors, elsewhere: torques change by what the model makes of other angles, not by a step."""
    makes = load_law(law)
    with Rig(JOINTS, law=law, feedforward="none") as rig:
        rig.run(0.01)
        loop = rig.controller.loop
        run, moved = (makes(loop.arm, rig.cell.control, loop.period_s) for _ in range(2))
        cycle = loop.cycle
        cycle.reference_rad = (0.3, -0.2)
        for each in (run, moved):
            each.start((0.3, -0.2), (0.0, 0.0), (0.5, 0.5))
        for _ in range(200):
            cycle.position_rad = (0.303, -0.201)
            run.update(cycle)
            moved.update(cycle)
        moved.shift((1e-4, -2e-4))
        kept = run.update(cycle)
        cycle.position_rad, cycle.reference_rad = (0.3031, -0.2012), (0.3001, -0.2002)
        np.testing.assert_allclose(moved.update(cycle), kept, atol=2e-3)


def frames(**changes: Any) -> list[Frame]:
    with Rig(JOINTS, truth=parked(JOINTS, 1, 0.5), **changes) as rig:
        rig.run(2.0)
        return [each.frame for each in rig.frames]


def test_homing_is_the_same_to_the_byte_every_time() -> None:
    assert frames() == frames()


def test_a_joint_that_is_parked_further_off_ends_the_run_with_its_name() -> None:
    with Rig(JOINTS, truth={"joint2.initial_deg": 21.5}) as rig:
        rig.run(4.0)
        assert rig.state is State.FAILED
        assert str(rig.reason).startswith(
            "homing-failed: joint2: no pulse of its encoder's index on the way; was it parked within "
            "control.homing.parked_within_deg = 0.5 of home_deg"
        )
    with Rig(homed(PAIR, 0.1, 4.0), truth={"slave_elbow.initial_deg": 65.02}) as rig:
        rig.run(4.0)
        assert str(rig.reason).startswith("homing-failed: slave_elbow: by its index it was parked +0.2")


def test_a_card_that_does_not_answer_ends_the_homing() -> None:
    with Rig(JOINTS) as rig:
        rig.run(0.1)
        rig.inject("can0.tx", "lost", cob_id=0x580 + 0x15)
        rig.run(4.0)
        assert str(rig.reason).startswith("homing-failed: card 'counter' (node 0x15) stopped answering")


def test_ticks_are_counted_from_the_beginning_of_the_trajectory() -> None:
    with Rig(JOINTS) as rig:
        rig.run(3.0)
        approach_s, summary = rig.approach_s, rig.summary()
    assert dataclasses.asdict(summary)["approach_s"] == approach_s > 0.9
    assert f"the trajectory begins at {approach_s:g} s" in summary.as_text()


@pytest.mark.slow
def test_the_way_from_there_to_the_path_is_slow_as_well() -> None:
    with Rig("rhino-pair") as rig:
        rig.run(5.0)
        assert rig.cell.control.homing is not None
        begins = round(rig.approach_s / 0.0025)
        speed = [
            np.abs(np.diff(np.degrees(joint.reference_rad[:begins]))).max() / 0.0025 for joint in rig.joints.values()
        ]
        # Where joints are homed, references jump by what was found: here by nothing.
        assert 3.5 < max(speed) <= rig.cell.control.homing.speed_deg_s * 1.001
