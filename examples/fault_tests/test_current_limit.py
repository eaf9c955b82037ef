"""Whatever breaks, no motor gets more than 1.5 A."""

import pytest

DANGEROUS = [
    ("joint2.dac.code", "stuck", {"value": 255}),
    ("joint2.latch", "reversed-direction", {}),
    ("joint2.potentiometer", "drift", {}),
    ("joint2.tachometer", "gain", {}),
    ("joint3.wire", "wire-broken", {}),
    ("node.0x12", "hang", {}),
]


@pytest.mark.parametrize(("tap", "fault", "parameters"), DANGEROUS, ids=lambda value: str(value))
def test_current_never_passes_1_5_a(canarm_rig, tap, fault, parameters):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject(tap, fault, at=1.0, **parameters)
    rig.run(seconds=2.5)
    for joint in rig.joints.values():
        assert joint.stays_below("current_a", 1.5)
