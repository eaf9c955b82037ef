"""A robot with brakes, run with its controller: whatever breaks whenever, no joint is faster than 3 rad/s."""

from collections.abc import Iterator

import pytest

from canarm import Rig
from canarm.draws import SEED, Choice, Span, hypercube
from canarm.matrix.plan import MatrixCell, cells_of
from canarm.matrix.undetectable import BEYOND_CONTROL, declared
from canarm_protocol.cell.cell_file import load_cell

BRAKED = load_cell("konkuk1-brakes")
LIMIT_RAD_S = 3.0
ONSET = Span("onset", 0.8, 5.9, "s")  # after the blend; two periods of joint 2, three of joint 3
FAULTS = [
    each
    for each in cells_of(BRAKED)
    if not each.needs_wire and each.family != "clock" and declared(each, BEYOND_CONTROL) is None
]
WORST = [each for each in FAULTS if each.tap.startswith("joint") and (each.is_dangerous or "motor" in each.tap)]


def fastest_rad_s(fault: MatrixCell, onset_s: float, seed: int, law: str) -> float:
    """The highest speed of any joint from the fault on, and through the stop; of all, where a stop came before it."""
    with Rig(BRAKED, law=law, seed=seed) as rig:
        rig.inject(fault.tap, fault.fault, at=onset_s)
        rig.run(seconds=onset_s + 0.4)
        rig.finish()
        spans = [joint.span("true_speed_rad_s") for joint in rig.joints.values()]
        since_s = rig.begun[0].time_s if rig.begun else 0.0
        return max(float(abs(span.value[span.time_s >= since_s]).max()) for span in spans)


def drawn(faults: list[MatrixCell], count: int, seed: int) -> Iterator[tuple[MatrixCell, float, int, str]]:
    names = Choice("fault", tuple(range(len(faults))))
    for draw in hypercube([names, ONSET, SEED, Choice("law", ("mras", "slotine-li"))], count, seed):
        yield faults[int(draw["fault"])], float(draw["onset"]), int(draw["seed"]), str(draw["law"])


def passing(faults: list[MatrixCell], count: int, seed: int) -> list[str]:
    found = []
    for fault, onset_s, run_seed, law in drawn(faults, count, seed):
        speed_rad_s = fastest_rad_s(fault, onset_s, run_seed, law)
        if speed_rad_s > LIMIT_RAD_S:
            found.append(f"{fault.name} at {onset_s:.4f} s, seed {run_seed}, {law}: {speed_rad_s:.2f} rad/s")
    return found


def test_with_brakes_no_fault_of_a_drive_makes_a_joint_faster_than_3_rad_s_whenever_it_strikes() -> None:
    assert passing(WORST, 8, 0) == []


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_with_brakes_no_fault_at_all_makes_a_joint_faster_than_3_rad_s_whenever_it_strikes() -> None:
    assert passing(FAULTS, 200, 1) == []


def test_a_stop_lets_no_joint_of_a_robot_with_brakes_fall() -> None:
    fallen_rad_s = {}
    for name in ("konkuk1", "konkuk1-brakes"):
        with Rig(name, seed=0) as rig:
            rig.run(seconds=1.0)
            rig.controller.interrupt("a test")
            rig.run(seconds=1.0)
            fallen_rad_s[name] = max(abs(joint.span("true_speed_rad_s").value).max() for joint in rig.joints.values())
    assert fallen_rad_s["konkuk1"] > LIMIT_RAD_S > fallen_rad_s["konkuk1-brakes"]


def stopped_rad_s(fault: str) -> float:
    """The highest speed after a stop, while both brakes have a fault."""
    with Rig(BRAKED, seed=0) as rig:
        rig.inject("joint2.brake", fault)
        rig.inject("joint3.brake", fault)
        rig.run(seconds=1.0)
        rig.controller.interrupt("a test")
        rig.run(seconds=1.0)
        return float(max(abs(joint.span("true_speed_rad_s").value).max() for joint in rig.joints.values()))


def test_a_brake_that_does_not_engage_shows_when_the_torque_is_off() -> None:
    assert stopped_rad_s("does-not-engage") > LIMIT_RAD_S


def test_a_brake_that_drags_is_noticed_while_the_robot_follows() -> None:
    with Rig(BRAKED, seed=0) as rig:
        rig.inject("joint2.brake", "drags", at=1.0)
        rig.run(seconds=1.5)
        assert rig.detected()


def test_brakes_change_nothing_while_the_robot_follows() -> None:
    errors = []
    for name in ("konkuk1", "konkuk1-brakes"):
        with Rig(name, law="mras", seed=0) as rig:
            rig.run(seconds=4.0)
            assert rig.detections == []
            errors.append([joint.rms_error_lsb for joint in rig.joints.values()])
    assert errors[1] == pytest.approx(errors[0], abs=0.05)
