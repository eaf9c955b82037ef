"""Every wiring fault in the catalogue for a joint's sensors is tolerated, or detected within 25 ms."""

import pytest

from canarm_emulator.faults import Family, catalogue_of
from canarm_protocol.cell import load_cell

TAPS = ("joint2.potentiometer", "joint2.tachometer")
WIRING = [
    (entry.tap.name, entry.fault.name)
    for entry in catalogue_of(load_cell("konkuk1"))
    if entry.fault.family is Family.WIRING and entry.tap.name in TAPS
]


@pytest.mark.parametrize(("tap", "fault"), WIRING)
def test_a_wiring_fault_is_tolerated_or_detected(canarm_rig, tap, fault):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject(tap, fault, at=3.0)
    rig.run(seconds=3.5)
    assert rig.detected().within(0.025) or rig.joints["joint2"].stays_below("error_lsb", 3.0, since=3.0)
