"""A broken drive wire leads to torque off within the fault-tolerant time interval of 100 ms."""

from canarm import State

FTTI_S = 0.1


def test_a_broken_wire_ends_in_torque_off(canarm_rig):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject("joint2.wire", "wire-broken", at=1.0)
    rig.run(seconds=3.0)
    assert rig.detected().within(0.025)
    assert rig.state is State.FAILED
    assert rig.torque_is_off
    for joint in rig.joints.values():
        assert joint.stays_below("command_a", 0.0, since=1.0 + FTTI_S)
