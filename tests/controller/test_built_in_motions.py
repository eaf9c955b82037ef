"""The built-in motions: the paper's for its two joints, and for any arm within what limits and sensors allow."""

import math

import numpy as np
import pytest

from canarm_controller.reference.built_in import swings
from canarm_controller.reference.trajectory import make_trajectory
from canarm_protocol.cell.cell_file import load_cell


def test_konkuk1_swings_as_the_paper_has_it() -> None:
    cell = load_cell("konkuk1")
    sine = make_trajectory("sine", cell).sample(0, 2048, cell.bus.cycle_s)
    # 35 degrees about 20 with a period of 2.56 s, 30 about 0 with 1.7 s.
    for joint, (centre, amplitude, period_s) in enumerate([(20.0, 35.0, 2.56), (0.0, 30.0, 1.7)]):
        time_s = np.arange(2048) * 0.0025
        expected = np.radians(centre + amplitude * np.sin(2 * np.pi * time_s / period_s))
        np.testing.assert_allclose(sine.position_rad[:, joint], expected, atol=1e-12)


@pytest.mark.parametrize("home_deg", [-170.0, -4.0, 0.0, 30.0, 109.0])
def test_a_swing_stays_a_tenth_of_the_travel_away_from_both_limits(home_deg: float) -> None:
    (swing,) = swings([home_deg], [-170.0], [110.0], [2.5])
    assert swing.centre_deg - swing.amplitude_deg >= -142.0 - 1e-9
    assert swing.centre_deg + swing.amplitude_deg <= 82.0 + 1e-9


def test_a_joint_of_little_travel_swings_less() -> None:
    (swing,) = swings([0.0], [-10.0], [10.0], [2.5])
    assert swing.amplitude_deg == 8.0


def test_a_slow_joint_takes_longer_over_it() -> None:
    (swing,) = swings([0.0], [-90.0], [90.0], [0.5])
    # 35 degrees at no more than 0.8 x 0.5 rad/s.
    assert math.radians(35.0) * 2 * math.pi / swing.period_s == pytest.approx(0.4)
