"""Lost TPDOs: a few are bridged, losing all leads to a safe stop."""

from canarm import State

ADC_TPDO2 = 0x294


def test_now_and_then_a_lost_tpdo_is_tolerated(canarm_rig):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject("can0.tx", "lost", cob_id=ADC_TPDO2, probability=0.1, at=3.0)
    rig.run(seconds=5.0)
    assert rig.state is State.RUNNING
    assert rig.joints["joint2"].stays_below("error_lsb", 3.0, since=3.0)


def test_tpdos_that_stay_away_are_a_safe_stop(canarm_rig):
    rig = canarm_rig("konkuk1", law="mras")
    rig.inject("can0.tx", "lost", cob_id=ADC_TPDO2, at=3.0)
    rig.run(seconds=5.0)
    assert rig.detected("inputs-missing").within(0.025)
    assert rig.state is State.FAILED
    assert rig.torque_is_off
