"""The move past the encoders' indices: from wherever the joints are parked, each passes a pulse."""

import re

import numpy as np
import pytest

from canarm_controller.dynamics import ClosedChain
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.index_search import IndexSearch
from canarm_controller.reference.trajectory import make_trajectory, usual_motion
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.homing import IndexMark
from canarm_protocol.cell.model import Cell
from tests.resolutions import cell_of_encoders, homed

PAIR = load_cell("rhino-pair")
JOINTS = homed(cell_of_encoders())


def pulses(mark: IndexMark, angle_rad: np.ndarray) -> int:
    """Pulses on the way, which come at whole turns of the encoder."""
    return int(np.abs(np.diff(np.floor(angle_rad / mark.period_rad))).sum())


def moved(cell: Cell) -> tuple[IndexSearch, np.ndarray, float]:
    """The search, the way from home by cycles (n, joints), and its duration."""
    assert cell.control.homing is not None
    search = IndexSearch(cell, cell.control.homing)
    home = np.radians([joint.home_deg for joint in cell.joints])
    move, ticks = search.move(home.tolist(), make_trajectory(usual_motion(cell), cell))
    return search, move.sample(0, ticks, cell.bus.cycle_s).position_rad, ticks * cell.bus.cycle_s


@pytest.mark.parametrize("cell", [PAIR, JOINTS], ids=["pair", "joints' shafts"])
def test_every_joint_passes_a_pulse_wherever_it_is_parked(cell: Cell) -> None:
    search, way, _ = moved(cell)
    draw = np.random.default_rng(6)
    for _ in range(100):
        parked = way + draw.uniform(-1.0, 1.0, way.shape[1]) * search.within_rad
        assert all(pulses(mark, parked[:, mark.joint]) for mark in search.marks)


@pytest.mark.parametrize("cell", [PAIR, JOINTS], ids=["pair", "joints' shafts"])
def test_it_is_as_slow_as_asked_for_and_begins_and_ends_at_rest(cell: Cell) -> None:
    _, way, seconds = moved(cell)
    speed = np.degrees(np.diff(way, axis=0) / cell.bus.cycle_s)
    assert cell.control.homing is not None
    assert 0.95 < np.abs(speed).max() / cell.control.homing.speed_deg_s <= 1.001
    assert np.abs(speed[[0, -1]]).max() < 0.01
    assert seconds < 4.0


def test_the_object_stays_in_both_hands_meanwhile() -> None:
    """Joints go straight from end to end of the move: between them the hands are a seventh of a millimetre off."""
    chain, (_, way, _) = ClosedChain(PAIR), moved(PAIR)
    apart_mm = [float(np.linalg.norm(chain.gap(pose.tolist()))) * 1e3 for pose in way[::20]]
    assert max(apart_mm) < 0.15
    assert max(apart_mm[0], apart_mm[-1]) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_a_rounding_that_differs_chooses_no_other_move(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Many moves are alike; libraries of linear algebra round as the processor has it."""
    exact, draw = np.linalg.pinv, np.random.default_rng(seed)

    def rounded(rows: np.ndarray) -> np.ndarray:
        inverse = exact(rows)
        return inverse * (1.0 + draw.uniform(-4e-16, 4e-16, inverse.shape))

    before = IndexSearch(PAIR, PAIR.control.homing).legs_rad
    monkeypatch.setattr(np.linalg, "pinv", rounded)
    (now,) = IndexSearch(PAIR, PAIR.control.homing).legs_rad
    assert now == pytest.approx(before[0], abs=1e-9)


def test_the_same_cell_is_always_searched_in_the_same_way() -> None:
    assert (moved(PAIR)[1] == moved(PAIR)[1]).all()


def test_a_joint_without_a_pulse_within_its_limits_is_refused_before_anything_moves() -> None:
    joint = JOINTS.joints[0].model_copy(update={"limits_deg": (5.0, 130.0)})
    robot = JOINTS.robot[0].model_copy(update={"joint": (joint, JOINTS.joints[1])})
    cell = JOINTS.model_copy(update={"robot": (robot,)})
    with pytest.raises(
        TrajectoryError,
        match=re.escape("joint2 would have to turn by 340.6 or -20.59 deg from home_deg = 20 to pass a pulse of its"),
    ):
        moved(cell)
