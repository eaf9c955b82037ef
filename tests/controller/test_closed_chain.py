"""Two arms with one object: constraint by differences of the paper's kinematics, and what a law is shown of errors."""

import numpy as np
import pytest

from canarm.cooperation import CarriedObject, circle, forward, pair_of, plan_cooperation
from canarm_controller.cycle import Cycle
from canarm_controller.dynamics import ClosedChain
from canarm_controller.estimation.shared_grip import SharedGrip
from canarm_protocol.cell import load_cell

CELL = load_cell("rhino-pair")
CHAIN = ClosedChain(CELL)
PAIR = pair_of(*CELL.robot, CarriedObject(length_m=0.6))
HOME = np.radians([joint.home_deg for joint in CELL.joints])


def hands_apart(q: np.ndarray) -> np.ndarray:
    master, slave = forward(PAIR.master, q[:5]), PAIR.base_transform @ forward(PAIR.slave, q[5:])
    return np.asarray(PAIR.carried.frame(master)[:3, 3] - slave[:3, 3])


def test_the_constraint_is_the_derivative_of_the_hands_distance() -> None:
    draw, step = np.random.default_rng(1), 1e-6
    for _ in range(5):
        q, speed = draw.uniform(-1.5, 1.5, 10), draw.uniform(-1.0, 1.0, 10)
        rows, drift = CHAIN.constraint(q.tolist(), speed.tolist())
        columns = [(hands_apart(q + step * each) - hands_apart(q - step * each)) / (2 * step) for each in np.eye(10)]
        np.testing.assert_allclose(rows, np.array(columns).T, atol=1e-8)
        wide = 1e-4 * speed
        second = (hands_apart(q + wide) - 2 * hands_apart(q) + hands_apart(q - wide)) / 1e-8
        np.testing.assert_allclose(drift, second, atol=1e-6)
        np.testing.assert_allclose(CHAIN.gap(q.tolist()), hands_apart(q), atol=1e-12)


def test_a_plan_leaves_the_object_in_both_hands() -> None:
    plan = plan_cooperation(PAIR, circle(), HOME[:5])
    assert max(np.abs(CHAIN.gap(row.tolist())).max() for row in plan.joint_rad[::40]) < 1e-12


def shown(error: np.ndarray, stiffness: float) -> np.ndarray:
    """What a law sees of following errors at home."""
    cycle = Cycle(10)
    cycle.reference_rad, cycle.position_rad = tuple(HOME), tuple(HOME + error)
    SharedGrip(CHAIN, (1.0,) * 10, stiffness).show(cycle)
    return np.array(cycle.position_rad) - HOME


def test_an_error_that_the_grips_do_not_allow_is_hidden_from_the_law() -> None:
    """A calibration error pulls at the object; a law that saw it would press for ever."""
    rows, _ = CHAIN.constraint(HOME.tolist(), [0.0] * 10)
    pulling = rows.T @ np.array([0.001, -0.002, 0.0005])
    np.testing.assert_allclose(shown(pulling, 0.0), 0.0, atol=1e-12)
    np.testing.assert_allclose(shown(pulling, 0.2), 0.2 * pulling, atol=1e-12)


def test_an_error_that_the_grips_allow_is_shown_whole() -> None:
    rows, _ = CHAIN.constraint(HOME.tolist(), [0.0] * 10)
    error = np.random.default_rng(2).normal(size=10) * 1e-3
    moving = error - np.linalg.pinv(rows) @ rows @ error
    np.testing.assert_allclose(shown(moving, 0.0), moving, atol=1e-12)
    np.testing.assert_allclose(rows @ shown(error, 0.0), 0.0, atol=1e-12)


def test_what_presses_the_hands_together_is_taken_out_of_a_laws_torques() -> None:
    """A force at the grips, Cᵀ·f, moves nothing; what is left moves both hands alike, C·W·τ = 0."""
    inertia = np.linspace(0.2, 0.8, 10)
    cycle = Cycle(10)
    cycle.reference_rad, cycle.position_rad = tuple(HOME), tuple(HOME)
    grip = SharedGrip(CHAIN, inertia.tolist(), 0.2)
    grip.show(cycle)
    rows, _ = CHAIN.constraint(HOME.tolist(), [0.0] * 10)
    planned = np.random.default_rng(3).normal(size=10)
    pressing = rows.T @ np.array([3.0, -2.0, 5.0])
    np.testing.assert_allclose(grip.eased((planned + pressing).tolist(), planned.tolist()), planned, atol=1e-12)
    asked = np.random.default_rng(4).normal(size=10)
    left = np.array(grip.eased((planned + asked).tolist(), planned.tolist())) - planned
    np.testing.assert_allclose(rows @ (left / inertia), 0.0, atol=1e-12)
    np.testing.assert_allclose(grip.eased((planned + left).tolist(), planned.tolist()), planned + left, atol=1e-12)


def test_a_cell_without_an_object_has_no_closed_chain() -> None:
    assert ClosedChain.of(load_cell("konkuk1")) is None
    with pytest.raises(ValueError, match="has no object"):
        ClosedChain(load_cell("konkuk1"))
