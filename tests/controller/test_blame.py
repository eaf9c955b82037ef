"""Which joint's link or wire has failed: motions that are integrated here, with noise, are told apart."""

import math
import random
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from canarm import Rig
from canarm_controller.dynamics import Floats, cell_arm
from canarm_controller.supervision.blame import PAST_CYCLES, Blame, Finding, Moment, log_mean_likelihood
from canarm_controller.supervision.nominal import joint_nominals
from canarm_controller.supervision.thresholds import cell_thresholds
from canarm_controller.supervision.timing import Timing
from canarm_protocol.cell.cell_file import load_cell

CYCLE_S, SUBSTEPS, SINCE, POSE = 0.0025, 50, 8, (0.4, 0.5)
LSB_RAD_S = 5.0 / 255.0
"""konkuk1's tachometers show -2.5 to 2.5 rad/s in 8 bits, with 0.3 steps of noise and rounding: 0.42 steps."""
HELD_NM, SPEED = (2.0, 0.5), (0.8, -0.6)
"""What the drives give while nothing accelerates, and how fast the joints turn. Friction takes a part of it."""
CELL = load_cell("konkuk1")
ARM = cell_arm(CELL.robot, CELL.joint_names)
ROTORS = np.array(ARM.rotor_inertia)
INERTIA = np.array(ARM.inertia(POSE)) + np.diag(ROTORS)
RIGID = (0.0, 0.0)
Fault = Callable[[Floats, Floats, Floats], None]
"""Changes speeds (links, then motors), torques on them, and stiffness of the wires, when it begins."""


@pytest.fixture(scope="module")
def blame() -> Blame:
    timing, nominals = Timing.of(CYCLE_S), joint_nominals(CELL, (ARM,))
    return Blame(ARM, nominals, cell_thresholds(nominals, CELL.supervision, timing), CYCLE_S)


def speeds_after(fault: Fault, compliance: Sequence[float]) -> Floats:
    """What the motors' speeds come to differ by in `SINCE` cycles: two masses a joint, in small steps of time.

    A rigid wire is one of 20 000 N m/rad, whose swing is damped.
    """
    links = INERTIA - np.diag(ROTORS)
    stiffness = np.array([1.0 / each if each else 2e4 for each in compliance])
    speed, torque_nm, held = np.zeros(4), np.zeros(4), stiffness.copy()
    fault(speed, torque_nm, held)
    damping = np.where(held == 2e4, 5.0, 0.0)
    if speed.any():  # a rigid joint takes its motor along
        rigid = [joint for joint in (0, 1) if held[joint] == 2e4]
        whole = links + np.diag([ROTORS[joint] if joint in rigid else 0.0 for joint in (0, 1)])
        speed[:2] = np.linalg.solve(whole, speed[:2])
        speed[2:] = [speed[joint] if joint in rigid else 0.0 for joint in (0, 1)]
    inverse, step_s = np.linalg.inv(links), CYCLE_S / SUBSTEPS
    angle, rows = np.zeros(4), []
    for count in range(SINCE * SUBSTEPS):
        wire_nm = held * (angle[2:] - angle[:2]) + damping * (speed[2:] - speed[:2])
        rate = np.concatenate((inverse @ (torque_nm[:2] + wire_nm), (torque_nm[2:] - wire_nm) / ROTORS))
        speed = speed + step_s * rate
        angle = angle + step_s * speed
        if count % SUBSTEPS == SUBSTEPS - 1:
            rows.append(speed[2:])
    return np.array(rows)


def readings(off: Floats, seed: int) -> list[Moment]:
    """`off` (cycles, joints) at the end of a motion at constant speed, as the tachometers show it."""
    source, past = random.Random(seed), []
    held = tuple(nm + friction for nm, friction in zip(HELD_NM, ARM.friction(SPEED), strict=True))
    for count in range(PAST_CYCLES):
        place = count - PAST_CYCLES + len(off)
        extra = off[place] if place >= 0 else np.zeros(2)
        shown = [
            LSB_RAD_S * round((speed + more) / LSB_RAD_S + source.gauss(0.0, 0.3))
            for speed, more in zip(SPEED, extra, strict=True)
        ]
        past.append((tuple(shown), (0.0, 0.0), (0.0, 0.0), held))
    return past


def hit(joint: int, impulse: float) -> Fault:
    def change(speed: Floats, torque_nm: Floats, stiffness: Floats) -> None:
        speed[joint] = impulse

    return change


def rubbed(joint: int, torque: float) -> Fault:
    def change(speed: Floats, torque_nm: Floats, stiffness: Floats) -> None:
        torque_nm[joint] = torque

    return change


def broken(joint: int) -> Fault:
    """The motor gets back what the wire carried, and the link has lost it."""

    def change(speed: Floats, torque_nm: Floats, stiffness: Floats) -> None:
        stiffness[joint] = 0.0
        torque_nm[joint], torque_nm[2 + joint] = -HELD_NM[joint], HELD_NM[joint]

    return change


def reversed_bridge(joint: int) -> Fault:
    def change(speed: Floats, torque_nm: Floats, stiffness: Floats) -> None:
        torque_nm[2 + joint] = -2.0 * (HELD_NM[joint] + ARM.friction(SPEED)[joint])

    return change


def found(blame: Blame, off: Floats, compliance: Sequence[float] = RIGID, seed: int = 0) -> Finding:
    return blame.find(readings(off, seed), INERTIA.tolist(), compliance)


@pytest.mark.parametrize("compliance", [RIGID, (0.01, 0.0), (0.0, 0.01), (0.01, 0.01)])
@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("kind", [lambda joint: hit(joint, 0.02), broken], ids=["hit", "broken"])
def test_the_joint_where_it_happened_is_found(
    blame: Blame, kind: Callable[[int], Fault], joint: int, compliance: Sequence[float]
) -> None:
    off = speeds_after(kind(joint), compliance)
    for seed in range(8):
        finding = found(blame, off, compliance, seed)
        assert finding.rather_than(1 - joint) == joint, seed
        assert finding.rather_than(joint) is None, seed


@pytest.mark.parametrize(("joint", "torque"), [(0, -2.0), (1, 0.6)])
def test_friction_is_found(blame: Blame, joint: int, torque: float) -> None:
    assert found(blame, speeds_after(rubbed(joint, torque), RIGID)).rather_than(1 - joint) == joint


def test_a_wire_gives_back_no_more_than_it_carried(blame: Blame) -> None:
    """Joint 2's motor and joint 3 gain speed by more than joint 3's wire can make, which carried 0.5 N m."""
    link2_off = speeds_after(broken(0), RIGID)
    assert float(link2_off[0, 1]) / CYCLE_S > 0.9 * HELD_NM[1] / ROTORS[1], "what joint 3's own motor would gain"
    assert found(blame, link2_off).arm[0] > found(blame, link2_off).arm[1] + 10.0


def test_a_hit_moves_the_other_joint_and_a_failed_tachometer_does_not(blame: Blame) -> None:
    off = speeds_after(hit(0, 0.04), RIGID)
    assert all(found(blame, off).is_arm(joint) for joint in (0, 1))
    alone = off * np.array([1.0, 0.0])
    for seed in range(8):
        assert not found(blame, alone, seed=seed).is_arm(0), seed


@pytest.mark.parametrize("joint", [0, 1])
def test_a_reversed_bridge_is_not_the_arm(blame: Blame, joint: int) -> None:
    off = speeds_after(reversed_bridge(joint), RIGID)
    for seed in range(8):
        assert not found(blame, off, seed=seed).is_not_reversed(joint), seed


def test_a_jam_is_not_a_reversed_bridge(blame: Blame) -> None:
    """A rigid joint 2 that stops at once: joint 3 goes on, by what the inertias make of it."""
    other = -SPEED[0] * -INERTIA[1, 0] / INERTIA[1, 1]
    assert found(blame, np.full((SINCE, 2), (-SPEED[0], other))).is_not_reversed(0)


def test_nothing_but_noise_is_nobody(blame: Blame) -> None:
    for seed in range(20):
        finding = found(blame, np.zeros((SINCE, 2)), seed=seed)
        assert not any(finding.is_arm(joint) for joint in (0, 1))


@pytest.mark.parametrize(
    ("squares", "product", "low", "high"),
    [
        (4.0, 3.0, -2.0, 2.0),
        (50.0, -20.0, 0.0, 1.0),
        (900.0, 40.0, -0.5, 3.0),
        (5e4, -2e4, 0.0, 1.2),
        (1e-3, 1.0, 0, 5),
    ],
)
def test_sizes_that_are_equally_likely_are_averaged(squares: float, product: float, low: float, high: float) -> None:
    sizes = np.linspace(low, high, 400_001)
    logarithms = product * sizes - 0.5 * squares * sizes**2
    most = logarithms.max()
    mean = most + math.log(np.trapezoid(np.exp(logarithms - most), sizes) / (high - low))
    assert log_mean_likelihood(squares, product, low, high) == pytest.approx(mean, abs=0.02)


@pytest.mark.parametrize(
    ("tap", "fault"),
    [("joint2.wire", "wire-broken"), ("joint3.wire", "wire-broken"), ("joint2.link", "collision")],
)
def test_the_failed_joint_is_named_first(tap: str, fault: str) -> None:
    """Whatever falls or was hit moves the other joint too; at this moment that one was more astray."""
    truth = {"joint2.coulomb": "0.1", "joint3.coulomb": "0.05", "joint3.mass": "0.45"}
    with Rig("konkuk1", "mras", seed=5, truth=truth) as rig:
        rig.run(seconds=3.2575)
        rig.inject(tap, fault)
        rig.run(seconds=0.05)
        first = rig.detections[0]
    assert (first.detector, first.where) == ("acceleration-mismatch", tap.partition(".")[0])


def test_a_pin_that_falls_to_ground_is_no_blow() -> None:
    """An arm with an elastic wire, friction and a payload that are far from nominal: a blow may look like this."""
    truth = {"joint2.coulomb": "0.346", "joint2.viscous": "0.0975", "joint3.coulomb": "0.0688", "joint3.mass": "0.421"}
    truth |= {"joint3.wire": "1", "joint3.wire_stiffness": "44.9", "joint3.viscous": "0.00883"}
    with Rig("konkuk1", "computed-torque", "trapezoid", seed=983420443, truth=truth) as rig:
        rig.run(seconds=4.96)
        rig.inject("joint2.tachometer", "open-load")
        rig.run(seconds=0.05)
        first = rig.detections[0]
    assert (first.detector, first.where) == ("tachometer-jump", "joint2")
