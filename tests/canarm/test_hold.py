"""A safe stop that holds: the arm is at rest at once, where it then is, and stays there until its torque goes."""

import numpy as np
import pytest

from canarm import Rig

SOFT = {  # the softest of the box: half of the cell's 200 and 80 N m/rad
    "joint2.wire": 1, "joint2.wire_stiffness": 100.0, "joint3.wire": 1, "joint3.wire_stiffness": 40.0,
}  # fmt: skip
STANDING_RAD_S = 0.125  # 5 % of the tachometers' 2.5 rad/s
RAMP_S = 0.1  # what a dangerous fault has in all


def held(cell: str, onset_s: float, truth: dict[str, float]) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """When the controller began to stop; times, speeds (n, joints) and commands (n, joints) from then on."""
    with Rig(cell, seed=0, truth=truth) as rig:
        rig.inject("joint3.potentiometer", "short-to-supply", at=onset_s)
        rig.run(seconds=onset_s + 1.0)
        stop = next(each for each in rig.noticed if each.detection.reaction.value == "safe-stop-hold")
        spans = [joint.span("true_speed_rad_s") for joint in rig.joints.values()]
        commands = [joint.span("command_a") for joint in rig.joints.values()]
        since = spans[0].time_s >= stop.time_s
        columns = (np.column_stack([each.value[since] for each in found]) for found in (spans, commands))
        return (stop.time_s, spans[0].time_s[since], *columns)


@pytest.mark.parametrize("onset_s", [1.3, 2.05, 2.8, 3.4])
@pytest.mark.parametrize("truth", [{}, {"joint3.mass": 0.9}], ids=["nominal", "payload"])
def test_a_hold_brings_the_arm_to_rest_within_100_ms_and_keeps_it_there(
    onset_s: float, truth: dict[str, float]
) -> None:
    stop_s, time_s, speed_rad_s, command_a = held("konkuk1", onset_s, truth)
    assert np.abs(speed_rad_s[0]).max() > 0.5  # it moved
    off = np.flatnonzero((command_a == 0.0).all(axis=1))
    assert off.size  # in the end the torque goes
    fast = np.flatnonzero((np.abs(speed_rad_s[: off[0]]) >= STANDING_RAD_S).any(axis=1))
    assert time_s[fast[-1] + 1] - stop_s <= RAMP_S
    assert off[0] - fast[-1] > 4  # it is held for a while
    assert np.abs(command_a).max() <= 0.98 * 1.5 + 1.5 / 255  # of the amplifier's 1.5 A, to a step of its DAC


@pytest.mark.parametrize("onset_s", [1.3, 2.05, 2.8, 3.4])
def test_links_on_soft_wires_do_not_swing_on_once_their_motors_stand(onset_s: float) -> None:
    stop_s, time_s, speed_rad_s, command_a = held("konkuk1", onset_s, SOFT)
    off = np.flatnonzero((command_a == 0.0).all(axis=1))
    left_rad_s = np.abs(speed_rad_s[: off[0]][time_s[: off[0]] >= stop_s + RAMP_S]).max()
    # A ramp to rest in T leaves a link of I on a wire of k with sin(wT/2)/(wT/2) of its speed, w = sqrt(k/I): of
    # joint 2's 0.07 kg m2 on 100 N m/rad, and 50 ms, 86 %. It swings for seconds then.
    assert left_rad_s < max(STANDING_RAD_S, 0.25 * 0.86 * np.abs(speed_rad_s[0]).max())


@pytest.mark.parametrize("factor", [0.7, 1.0, 1.5])
def test_a_payload_that_rubs_little_does_not_swing_on_its_wires(factor: float) -> None:
    """1.5 times the link that the model knows, and a third of the friction: both joints turn at 0.5 rad/s."""
    soft = SOFT | {"joint2.wire_stiffness": factor * 200.0, "joint3.wire_stiffness": factor * 80.0}
    truth = soft | {"joint3.mass": 0.9, "joint2.coulomb": 0.05, "joint3.coulomb": 0.02}
    stop_s, time_s, speed_rad_s, command_a = held("konkuk1", 4.6, truth)
    off = np.flatnonzero((command_a == 0.0).all(axis=1))
    assert time_s[off[0]] - stop_s > RAMP_S
    fast = np.flatnonzero((np.abs(speed_rad_s[: off[0]]) >= STANDING_RAD_S).any(axis=1))
    assert time_s[fast[-1] + 1] - stop_s <= RAMP_S
