"""An elastic drive wire is learned from the angle's residual, and no sensor is blamed for its twist."""

import dataclasses
import math

import pytest

from canarm import Rig
from canarm_controller.dynamics import cell_arm
from canarm_controller.supervision.nominal import joint_nominals
from canarm_controller.supervision.thresholds import cell_thresholds, twist_rad, wire_rad_s
from canarm_controller.supervision.timing import Timing
from canarm_controller.supervision.uncertainty import PAYLOAD
from canarm_controller.supervision.wire_twist import WireTwist
from canarm_controller.supervision.witness import JointWitness
from canarm_protocol.cell.cell_file import load_cell

NOMINAL_NM_RAD = {"joint2": 200.0, "joint3": 80.0}
GRAVITY_M_S2, LENGTH_M, M2_KG, M3_KG = 9.8062, 0.18, 1.0, 0.6


def learned(rig: Rig) -> list[float]:
    """Compliance of each wire as a multiple of the nominal one's."""
    witnesses = rig.controller._watch.joints
    return [
        joint._wire.compliance * stiffness for joint, stiffness in zip(witnesses, NOMINAL_NM_RAD.values(), strict=True)
    ]


def after_three_seconds(factor: float | None) -> Rig:
    truth: dict[str, object] = {}
    if factor is not None:
        for name, stiffness in NOMINAL_NM_RAD.items():
            truth |= {f"{name}.wire": 1, f"{name}.wire_stiffness": factor * stiffness}
    with Rig("konkuk1", law="mras", truth=truth) as rig:
        rig.run(seconds=3.0)
        assert rig.detections == []
        return rig


def test_a_softer_wire_is_known_from_a_stiffer_one_and_that_from_a_rigid_one() -> None:
    """By 8 bits: joint 3's wire twists by 0.6 of a step where it is as stiff as the cell says."""
    rigid, usual, soft = (after_three_seconds(factor) for factor in (None, 1.0, 0.5))
    assert max(learned(rigid)) < 0.25
    for stiff, less, least in zip(learned(rigid), learned(usual), learned(soft), strict=True):
        assert stiff + 0.25 < less < least - 0.5
        assert 1.0 < least <= 2.0
    for rig, is_elastic in ((rigid, False), (usual, True), (soft, True)):
        assert [joint.is_elastic for joint in rig.controller._watch.joints] == [is_elastic] * 2


@pytest.mark.parametrize("stiffness", [None, 200.0, 100.0], ids=["rigid", "usual", "soft"])
@pytest.mark.parametrize("first_lsb", [-1.0, 1.0])
def test_a_first_reading_that_is_off_is_taken_for_no_wire(stiffness: float | None, first_lsb: float) -> None:
    """An arm that takes 2 N m at the start, and turns by 1 N m: a step of 1 LSB is 0.0185 rad, and so are 2 N m on
    108 N m/rad. What base and offset take up of either is the same filter.
    """
    cell = load_cell("konkuk1")
    nominal = joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),))[0]
    timing = Timing.of(cell.bus.cycle_s)
    limits, _ = cell_thresholds((nominal, nominal), cell.supervision, timing)
    wire = WireTwist(nominal, limits, timing.refresh, timing.period_s)
    base_rad = first_lsb * nominal.position.step
    offset_rad_s, base_gain, offset_gain = 0.0, 2.0 * 0.5 * timing.period_s, 0.5**2 * timing.period_s
    for cycle in range(0, 1600, timing.refresh):
        torque_nm = 2.0 + math.sin(math.tau * cycle * timing.period_s / 1.7)
        raw_rad = -(torque_nm / stiffness if stiffness else 0.0) - base_rad
        wire.take(torque_nm, 0.0, raw_rad, base_gain, offset_gain)
        for _ in range(timing.refresh):
            base_rad, offset_rad_s, raw_rad = (
                base_rad + timing.period_s * offset_rad_s + base_gain * raw_rad,
                offset_rad_s + offset_gain * raw_rad,
                raw_rad * (1.0 - base_gain),
            )
    expected = 200.0 / stiffness if stiffness else 0.0
    assert wire.compliance * 200.0 == pytest.approx(expected, abs=0.2)
    assert wire.is_elastic is bool(stiffness)


def test_a_wire_that_softens_is_noticed_and_not_learned_away() -> None:
    with Rig("konkuk1", law="mras", truth={"joint2.wire": 1}) as rig:
        rig.run(seconds=2.5)
        before = learned(rig)[0]
        rig.inject("joint2.wire", "wire-soft")
        rig.run(seconds=0.5)
        assert rig.detected(joint="joint2")
        assert learned(rig)[0] == pytest.approx(before, abs=0.5)


def test_twist_and_swing_of_the_box_are_those_of_arithmetic() -> None:
    cell = load_cell("konkuk1")
    joint2, joint3 = joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),))
    held_nm = GRAVITY_M_S2 * LENGTH_M * (M2_KG / 2.0 + M3_KG * 1.5)
    payload_nm = GRAVITY_M_S2 * LENGTH_M * 1.5 * M3_KG * PAYLOAD[1]
    assert twist_rad(joint2) == pytest.approx((held_nm + payload_nm) / 100.0, rel=0.03)
    # A rotor of 0.024 kg m2 against a link of m L^2/3 = 0.00648 kg m2 on 80 N m/rad, stretched out: 125 rad/s.
    link = M3_KG * LENGTH_M**2 / 3.0
    free = dataclasses.replace(joint3, mobility_per_kg_m2=(1.0 / (0.024 + link),) * 2)
    assert wire_rad_s(free, 1.0) == pytest.approx((80.0 * (1.0 / 0.024 + 1.0 / link)) ** 0.5, rel=1e-6)


@pytest.mark.parametrize("bits", [12, 16])
def test_a_fine_potentiometer_that_sticks_is_called_stuck(bits: int) -> None:
    table = load_cell("konkuk1").model_dump(exclude_none=True)
    for card in table["card"]:
        if card["model"] == "adc0809":
            card |= {"model": "adc", "bits": bits}
    cell = type(load_cell("konkuk1")).model_validate(table)
    with Rig(cell, law="mras") as rig:
        rig.inject("joint2.potentiometer", "stuck", at=2.8)
        rig.run(seconds=3.0)
        assert rig.detections[0].detector == "potentiometer-stuck"
        assert rig.detections[0].where == "joint2"
        assert rig.detections[0].tick - 1120 <= 20  # 50 ms


def test_a_joint_faster_than_its_tachometer_is_followed_by_its_angle() -> None:
    """2.8 rad/s where the tachometer ends at 2.5, and a payload that makes up to 6 rad/s2 of what the model lacks."""
    cell = load_cell("konkuk1")
    nominal = joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),))[1]
    timing = Timing.of(cell.bus.cycle_s)
    (_, limits), accused = cell_thresholds((nominal, nominal), cell.supervision, timing), []
    witness = JointWitness(nominal, limits, timing, lambda *what: not accused.append(what[:2]))
    fastest, omega = 2.8, 2.0 * math.pi / 1.7
    assert nominal.speed is not None
    worst = 0.0
    for cycle in range(1600):
        time_s = cycle * cell.bus.cycle_s
        angle, speed = -fastest / omega * math.cos(omega * time_s), fastest * math.sin(omega * time_s)
        if cycle == 0:
            witness.start(angle)
        code = min(max(round(speed / nominal.speed.step + 127.5), 0), 255)
        x_code = round(angle / nominal.position.step + 127.5)
        expected = fastest * omega * math.cos(omega * time_s) - 6.0 * math.cos(angle)
        measured = (x_code - 127.5) * nominal.position.step, (code - 127.5) * nominal.speed.step
        if witness.step(*measured, expected, x_code, code) and cycle > 800:
            worst = max(worst, abs(witness.velocity_rad_s - speed))
    assert accused == []
    assert 0.0 < worst < 0.2
