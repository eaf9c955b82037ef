"""A tachometer that sticks, at moments which are not those of the matrix."""

import pytest

from canarm import Rig


@pytest.mark.parametrize("at_s", [1.0, 2.0, 4.1])
def test_a_tachometer_that_sticks_is_called_stuck_and_the_arm_goes_on(at_s: float) -> None:
    """At 1 s joint 2 has just turned, so its friction is not known: not even then is the drive to blame."""
    with Rig("konkuk1", law="mras") as rig:
        rig.inject("joint2.tachometer", "stuck", at=at_s)
        rig.run(at_s + 0.5)
        assert [each.detector for each in rig.detections] == ["tachometer-stuck"]
        assert rig.detected("tachometer-stuck", "joint2").within(0.060)
        assert rig.state.name == "RUNNING"
