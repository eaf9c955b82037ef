"""Differences of currents that are small, and still move a joint before anybody would look."""

import numpy as np
import pytest

from canarm import Rig
from canarm_controller.dynamics import cell_arm
from canarm_controller.supervision.nominal import joint_nominals
from canarm_controller.supervision.thresholds import cell_thresholds
from canarm_controller.supervision.timing import Timing
from canarm_protocol.cell.cell_file import load_cell

STANDING_RAD_S = 0.125  # 5 % of the tachometers' 2.5 rad/s
DETECTION_S = 0.025


def test_a_current_that_moves_a_light_joint_is_looked_at_before_5_percent_of_full_scale() -> None:
    """Joint 3 as a rod on its rotor: 0.024 + m L²/3 = 0.0305 kg m2, and 40 · 0.08 · 0.85 = 2.72 N m/A."""
    cell = load_cell("konkuk1")
    limits = cell_thresholds(
        joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),)), cell.supervision, Timing.of(cell.bus.cycle_s)
    )
    alone_a = 0.5 * STANDING_RAD_S / DETECTION_S * (0.024 + 0.6 * 0.18**2 / 3.0) / 2.72
    assert limits[1].moving_current == pytest.approx(alone_a, rel=0.1)  # the other joint gives way a little
    for each in limits:
        assert each.moving_current < each.current == pytest.approx(0.05 * 1.5)


@pytest.mark.parametrize("fault", ["stuck", "delayed"])
def test_a_drive_that_stays_near_its_command_is_noticed_as_soon_as_the_joint_shows_it(fault: str) -> None:
    """At a joint that moves slowly the currents differ by less than 5 % of full scale."""
    truth = {"joint2.coulomb": 0.3266, "joint2.viscous": 0.037, "joint3.coulomb": 0.0724, "joint3.viscous": 0.0082}
    with Rig("konkuk1", trajectory="trapezoid", seed=50449405, truth=truth) as twin:
        twin.run(seconds=4.8)
    with Rig("konkuk1", trajectory="trapezoid", seed=50449405, truth=truth) as rig:
        rig.inject("joint3.amplifier.current", fault, at=4.3125)
        rig.run(seconds=4.8)
    first = rig.noticed[0]
    assert (first.detection.detector, first.detection.where) == ("current-mismatch", "joint3")
    its, mine = (each.joints["joint3"].span("true_speed_rad_s") for each in (twin, rig))
    before = mine.time_s < first.time_s - DETECTION_S
    astray_rad_s = mine.value[before] - np.interp(mine.time_s[before], its.time_s, its.value)
    assert np.abs(astray_rad_s).max() < STANDING_RAD_S
