"""What a payload makes of an arm when it changes at once, by textbook formulas of two uniform rods."""

import numpy as np
import pytest

from canarm_controller.dynamics import cell_arm
from canarm_controller.supervision.nominal import joint_nominals
from canarm_controller.supervision.thresholds import payload_change_rad_s2, turned_nm
from canarm_protocol.cell.cell_file import load_cell

G, LENGTH_M, M2_KG, M3_KG = 9.8062, 0.18, 1.0, 0.6
LEAST, MOST = 0.5, 1.8
"""The box: the last link weighs so many times what the cell says."""
ROTORS = np.diag([0.054, 0.024])


def inertia(m3_kg: float) -> np.ndarray:
    """Stretched out, kg m²: rods of m L²/3 about their ends."""
    square = LENGTH_M**2
    own, coupling = m3_kg * square / 3.0, m3_kg * square * (1.0 / 3.0 + 0.5)
    return np.array([[M2_KG * square / 3.0 + m3_kg * square * 7.0 / 3.0, coupling], [coupling, own]]) + ROTORS


def weight_nm(m3_kg: float) -> np.ndarray:
    return m3_kg * G * LENGTH_M * np.array([1.5, 0.5])


def test_the_heaviest_payload_that_is_dropped_is_within_the_limit() -> None:
    """It is held with what carries the heaviest, and is then the lightest of the box: lighter to move as well."""
    cell = load_cell("konkuk1")
    nominals = joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),))
    lost_nm = weight_nm(MOST * M3_KG) - weight_nm(LEAST * M3_KG)
    stretched = np.abs(np.linalg.solve(inertia(LEAST * M3_KG), lost_nm))
    for nominal, one_pose in zip(nominals, stretched, strict=True):
        assert nominal.payload_change_rad_s2 >= 0.95 * one_pose
        assert payload_change_rad_s2(nominal) > nominal.payload_change_rad_s2 + turned_nm(nominal) * 5.0
    assert nominals[0].payload_change_rad_s2 == pytest.approx(stretched[0], rel=0.25)
