"""Who is named where the current measured is not the one commanded: the sense, or the drive. The arm tells."""

import pytest

from canarm import Rig
from canarm_controller.run.state import State


def named(tap: str, fault: str) -> tuple[str, bool]:
    """The first detection after the fault, and whether the run went on."""
    with Rig("konkuk1", seed=0, truth=HEAVY) as rig:
        rig.inject(tap, fault, at=2.8)
        rig.run(seconds=3.6)
        return rig.detections[0].detector, rig.state is State.RUNNING


HEAVY = {"joint3.mass": 0.9, "joint2.coulomb": 0.3}  # payload +50 %, friction x 2
OF_A_SENSE = ["stuck", "offset", "gain", "dropout", "intermittent"]
OF_A_DRIVE = ["stuck", "offset", "gain", "noise", "dropout", "intermittent", "spike", "delayed"]


@pytest.mark.parametrize("fault", OF_A_SENSE)
def test_a_wrong_current_sense_is_named_and_the_robot_goes_on(fault: str) -> None:
    detector, is_running = named("joint2.current_sense", fault)
    assert detector.startswith("current-sense-")
    assert is_running


@pytest.mark.parametrize("fault", OF_A_DRIVE)
def test_no_sense_is_blamed_for_a_drive_and_the_robot_stops(fault: str) -> None:
    detector, is_running = named("joint2.opamp", fault)
    assert detector == "current-mismatch"
    assert not is_running
