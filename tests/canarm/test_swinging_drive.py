"""A drive that is late, or hears wrong codes, makes its joint swing: it is to blame, not its tachometer."""

import pytest

from canarm import Rig, State

TOLERATED_LSB = 3.0  # what a run may err by


@pytest.mark.parametrize(
    ("tap", "fault", "at_s", "seed", "joint"),
    [("joint3.dac.code", "delayed", 2.8, 1, "joint3"), ("can0.rx", "corrupted", 4.55, 0, "joint2")],
)
def test_a_joint_that_swings_under_a_drive_in_doubt_is_stopped_before_it_errs(
    tap: str, fault: str, at_s: float, seed: int, joint: str
) -> None:
    with Rig("konkuk1", seed=seed) as rig:
        rig.inject(tap, fault, at=at_s)
        rig.run(seconds=at_s + 2.0)
        assert rig.state is State.FAILED
        assert rig.detected("current-mismatch", joint)
        assert "current-mismatch" in str(rig.reason)
        error_lsb = abs(rig.joints[joint].error_lsb)
        assert error_lsb[rig.joints[joint].time_s > at_s].max() < TOLERATED_LSB
