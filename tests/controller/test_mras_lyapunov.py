"""The Lyapunov law by itself and in its closed loop."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from canarm import Rig
from canarm_controller.dynamics import NominalArm
from canarm_controller.errors import LawError
from canarm_controller.laws import Cycle, MrasLyapunov
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
ARM = NominalArm.from_robot(CELL.robot[0])
STILL = (0.0, 0.0)


def fresh(**gains: str) -> MrasLyapunov:
    """The law on raw measurements."""
    settings = {f"control.mras_lyapunov.{key}": value for key, value in gains.items()}
    cell = load_cell("konkuk1", {"control.observer.enabled": "false", **settings})
    return MrasLyapunov(ARM, cell.control, cell.bus.cycle_s)


def cycle_at(position: tuple[float, float], reference: tuple[float, float]) -> Cycle:
    cycle = Cycle(2)
    cycle.position_rad, cycle.reference_rad = position, reference
    cycle.reference_rad_s = cycle.velocity_rad_s = (0.2, -0.3)
    return cycle


def test_starts_without_a_bump() -> None:
    law = MrasLyapunov(ARM, CELL.control, CELL.bus.cycle_s)
    law.start((0.3, -0.2), STILL, (0.6, 0.5))
    cycle = Cycle(2)
    cycle.position_rad = cycle.reference_rad = (0.3, -0.2)
    cycle.feedforward_nm = (1.25, -0.5)
    assert law.update(cycle) == pytest.approx([1.25, -0.5], abs=1e-12)


def test_without_adaptation_it_is_the_linear_law_of_its_model() -> None:
    law = fresh()
    law.start(STILL, STILL, (0.6, 0.5))
    cycle = cycle_at((0.01, 0.02), (0.03, -0.01))
    cycle.velocity_rad_s, cycle.reference_rad_s, cycle.reference_rad_s2 = (0.1, 0.2), (0.4, -0.3), (2.0, 1.0)
    inertia = ARM.effective_inertia
    expected = [inertia[0] * (2.0 + 24 * 0.3 + 144 * 0.02), inertia[1] * (1.0 - 24 * 0.5 - 144 * 0.03)]
    assert law.update(cycle) == pytest.approx(expected, rel=1e-9)


def test_adaptation_goes_along_the_solution_of_the_lyapunov_equation() -> None:
    """AᵀP + PA = -diag(2ωn², 1) for ωn = 12, ζ = 1; the bias moves by T·γ3·(p12·e + p22·ė)."""
    omega = 12.0
    a = np.array([[0.0, 1.0], [-(omega**2), -2 * omega]])
    p = solve_continuous_lyapunov(a.T, -np.diag([2 * omega**2, 1.0]))
    law = fresh(gamma_bias="20.0")
    for position, speed in ((-0.01, 0.0), (0.0, -0.1)):
        law.start(STILL, STILL, (0.6, 0.5))
        cycle = Cycle(2)
        cycle.position_rad, cycle.velocity_rad_s = (position, 0.0), (speed, 0.0)
        law.update(cycle)
        expected = 0.0025 * 20.0 * (p[0, 1] * -position + p[1, 1] * -speed)
        assert law.internals()["bias_a"][0] == pytest.approx(expected, rel=1e-9)


def test_gains_and_bias_stay_within_their_projection() -> None:
    law = fresh(gamma_position="1e5", gamma_velocity="1e5")
    law.start(STILL, STILL, (0.6, 0.5))
    kp0, kv0 = law.internals()["kp_a_rad"], law.internals()["kv_a_s_rad"]
    seen: dict[str, list[list[float]]] = {"kp_a_rad": [], "kv_a_s_rad": [], "bias_a": []}
    for tick in range(4096):
        wanted = float(0.6 * np.sin(tick * 0.01))
        cycle = cycle_at(STILL, (wanted, wanted))
        cycle.velocity_rad_s = (0.5, 0.5)
        law.update(cycle)
        for name, values in seen.items():
            values.append(list(law.internals()[name]))
    for name, nominal in (("kp_a_rad", kp0), ("kv_a_s_rad", kv0)):
        factors = np.array(seen[name]) / nominal
        assert (factors.min(), factors.max()) == pytest.approx((0.35, 3.0))
    assert np.abs(seen["bias_a"]).max() == pytest.approx(0.6)


def test_adaptation_stands_still_while_saturated() -> None:
    law = fresh()
    law.start((0.1, 0.1), STILL, (0.6, 0.5))
    cycle = cycle_at(STILL, (0.3, 0.3))
    law.update(cycle)
    before = {name: list(values) for name, values in law.internals().items()}
    cycle.saturated = (True, False)
    law.update(cycle)
    for name in ("kp_a_rad", "kv_a_s_rad", "bias_a"):
        assert law.internals()[name][0] == before[name][0]
        assert law.internals()[name][1] != before[name][1]


def test_a_cell_without_its_gains_is_refused() -> None:
    control = CELL.control.model_copy(update={"mras_lyapunov": None})
    with pytest.raises(LawError, match=r"no \[control.mras_lyapunov\]"):
        MrasLyapunov(ARM, control, CELL.bus.cycle_s)


def worst_lsb(trajectory: str, mass3_kg: float, **gains: float) -> float:
    settings = {f"control.mras_lyapunov.{key}": value for key, value in gains.items()}
    truth = {"joint3.mass": mass3_kg}
    with Rig("konkuk1", law="mras-lyapunov", trajectory=trajectory, seed=0, truth=truth, settings=settings) as rig:
        rig.run(seconds=10.24)
    return max(joint.rms_error_lsb for joint in rig.joints.values())


@pytest.mark.parametrize(("trajectory", "prototype_lsb"), [("sine", 0.50), ("trapezoid", 0.29)])
def test_a_wrong_payload_costs_half_of_what_it_cost_the_prototype(trajectory: str, prototype_lsb: float) -> None:
    assert worst_lsb(trajectory, 0.9) < 0.6 * prototype_lsb


@pytest.mark.slow
def test_the_gain_at_a_wrong_payload_is_the_bias_alone() -> None:
    """As the docstring says: a weight is what is wrong, and no gain can carry it."""
    all_of_it = worst_lsb("sine", 0.9)
    assert worst_lsb("sine", 0.9, gamma_position=0.0, gamma_velocity=0.0) == pytest.approx(all_of_it, rel=0.1)
    assert worst_lsb("sine", 0.9, gamma_bias=0.0) > 10 * all_of_it
