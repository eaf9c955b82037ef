"""A stuck tachometer is detected by name within 25 ms, and the run goes on without it."""

import pytest

from canarm import State

FLOOR_RAD_S = 0.125
"""5 % of the tachometer's full scale: a smaller change is indistinguishable from noise."""


@pytest.mark.parametrize("joint", ["joint2", "joint3"])
def test_a_stuck_tachometer_is_detected_within_25_ms(canarm_rig, joint):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject(f"{joint}.tachometer", "stuck", at=3.0)
    rig.run(seconds=4.0)
    shows_s = rig.joints[joint].departure("true_speed_rad_s", by=FLOOR_RAD_S, since=3.0)
    assert rig.detected("tachometer-stuck", joint).within(0.025, of=shows_s)
    assert rig.state is State.RUNNING
    assert rig.joints[joint].stays_below("error_lsb", 3.0, since=2.6)
