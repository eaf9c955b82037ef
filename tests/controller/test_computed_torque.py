"""Computed torque by itself and in its closed loop."""

import pytest

from canarm import Rig
from canarm_controller.dynamics import NominalArm
from canarm_controller.laws import ComputedTorque, Cycle
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
ARM = NominalArm.from_robot(CELL.robot[0])
STILL = (0.0, 0.0)


def test_first_torque_carries_the_weight_and_no_more() -> None:
    law = ComputedTorque(ARM, CELL.control, CELL.bus.cycle_s)
    law.start((0.3, -0.2), STILL, (0.6, 0.5))
    cycle = Cycle(2)
    cycle.position_rad = cycle.reference_rad = (0.3, -0.2)
    assert law.update(cycle) == pytest.approx(ARM.gravity((0.3, -0.2)), abs=1e-12)


def test_torque_is_the_inverse_dynamics_at_the_wanted_error_dynamics() -> None:
    """ωn = 12, ζ = 1: both joints are to accelerate by q̈_d - 24·ė - 144·e."""
    control = load_cell("konkuk1", {"control.observer.enabled": "false"}).control
    law = ComputedTorque(ARM, control, 0.0025)
    law.start(STILL, STILL, (0.6, 0.5))
    cycle = Cycle(2)
    cycle.position_rad, cycle.velocity_rad_s = (0.52, -0.31), (1.1, -0.8)
    cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = (0.50, -0.30), (1.0, -1.0), (3.0, -5.0)
    wanted = 3.0 - 24 * 0.1 - 144 * 0.02, -5.0 - 24 * 0.2 - 144 * -0.01
    # Both speeds have the sign of their reference, at which Coulomb friction is saturated: it is the same from either.
    assert law.update(cycle) == pytest.approx(ARM.torque_nm(cycle.position_rad, cycle.velocity_rad_s, wanted), rel=1e-9)


def worst_lsb(law: str, mass3_kg: float, feedforward: str | None = None) -> float:
    truth = {"joint3.mass": mass3_kg}
    with Rig("konkuk1", law=law, trajectory="sine", seed=0, truth=truth, feedforward=feedforward) as rig:
        rig.run(seconds=10.24)
    return max(joint.rms_error_lsb for joint in rig.joints.values())


def test_it_is_as_right_as_its_model() -> None:
    """At a wrong payload it is hardly better than PD with the torque table."""
    assert worst_lsb("computed-torque", 0.6) < 0.15
    assert worst_lsb("computed-torque", 0.9) == pytest.approx(worst_lsb("pd", 0.9, "table"), rel=0.4)
