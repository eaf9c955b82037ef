"""Arms of one to seven joints, several robots, other cycles and sensors: no false alarms, and faults are detected."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import canarm_protocol
from canarm import Rig
from canarm_controller.dynamics import SerialArm, cell_arm
from canarm_controller.run.controller import State
from canarm_controller.supervision.derivation import detector_lines
from canarm_controller.supervision.expectation import ArmExpectation, expectation
from canarm_controller.supervision.nominal import joint_nominals
from canarm_controller.supervision.thresholds import cell_thresholds
from canarm_controller.supervision.timing import Timing
from canarm_protocol.cell.cell_file import load_cell, parse_cell
from canarm_protocol.cell.model import Cell

KONKUK1 = (Path(canarm_protocol.__file__).parent / "cells" / "konkuk1.toml").read_text(encoding="utf-8")
LENGTH_M, GRAVITY_M_S2 = 0.12, 9.81
NEWTON_METRES_PER_GEAR = 0.08 * 0.85 * 1.5
"""Torque constant, efficiency and greatest current, for each turn of the gear."""
SECONDS = 2.0


def joint_text(number: int, count: int, bits_of_noise: float) -> str:
    """A rod a little lighter than the one before, its drive sized for 60 % of its current at worst."""
    masses = [0.8 / 1.6**each for each in range(count)]
    hold_nm = sum(masses[k] * GRAVITY_M_S2 * LENGTH_M * (k - number + 0.5) for k in range(max(number, 0), count))
    gear = max(10.0, math.ceil(hold_nm / 0.6 / NEWTON_METRES_PER_GEAR))
    mass, share = masses[number], gear / 60.0
    turning = mass * LENGTH_M**2 / 12.0
    alpha_deg = 90.0 if number == 0 and count > 2 else 0.0
    return f"""
[[robot.joint]]
name = "axis{number + 1}"
home_deg = {20.0 if number % 2 else 10.0}
limits_deg = [-120.0, 120.0]
link = {{ a_m = {LENGTH_M}, alpha_deg = {alpha_deg}, d_m = 0.0, mass_kg = {mass}, \
centre_of_mass_m = [{-LENGTH_M / 2}, 0.0, 0.0], inertia_kg_m2 = [1e-5, {turning}, {turning}] }}

[robot.joint.motor]
torque_constant_nm_a = 0.08
gear_ratio = {gear}
gear_efficiency = 0.85
rotor_inertia_kg_m2 = 1.5e-5
winding_ohm = 2.5
winding_mh = 1.25
viscous_friction_nm_s = {0.05 * share}
coulomb_friction_nm = {0.15 * share}
wire_stiffness_nm_rad = 200.0

[robot.joint.drive]
kind = "d669"
max_current_a = 1.5
supply_v = 24.0
opamp_full_scale_v = 15.0

[robot.joint.sensors]
potentiometer = {{ range_deg = 270.0, zero_v = 2.5, full_scale_v = 5.0, noise_lsb = {bits_of_noise} }}
tachometer = {{ full_scale_rad_s = 2.5, zero_v = 2.5, full_scale_v = 5.0, noise_lsb = {bits_of_noise} }}
current_sense = {{ full_scale_a = 1.5, full_scale_v = 5.0, noise_lsb = {bits_of_noise} }}
"""


def card_text(model: str, first_slot: int, signals: list[str], channels: int, settings: str = "") -> str:
    text = ""
    for place, start in enumerate(range(0, len(signals), channels)):
        slot = first_slot + place
        wires = ", ".join(
            f'{{ number = {number}, signal = "{signal}" }}'
            for number, signal in enumerate(signals[start : start + channels], start=1)
        )
        text += f"""
[[card]]
name = "{model}-{place}"
model = "{model}"
robot = "made-up"
slot = {slot}
node_id = {0x10 + slot}
{settings}
channel = [{wires}]
"""
    return text


def made_up(count: int, cycle_us: int = 2500, noise_lsb: float = 0.3, bits: int = 8) -> Cell:
    """A cell of `count` joints with nothing in its [supervision]: all limits are derived."""
    head = KONKUK1[: KONKUK1.index("[supervision]")].replace("cycle_us = 2500", f"cycle_us = {cycle_us}")
    head = head.replace("compute_delay_us = 500", "compute_delay_us = 200").replace('"konkuk1"', '"made-up"')
    names = [f"axis{number + 1}" for number in range(count)]
    measured = ("potentiometer", "tachometer", "current_sense")
    text = head + '[[robot]]\nname = "made-up"\nnumber = 1\ngravity_m_s2 = [0.0, -9.81, 0.0]\n'
    text += "".join(joint_text(number, count, noise_lsb) for number in range(count))
    text += card_text("dac0808", 1, [f"{name}.current_command" for name in names], 4)
    text += card_text("sc300", 3, [f"{name}.direction" for name in names], 4)
    inputs = [f"{name}.{quantity}" for quantity in measured for name in names]
    conversion_us = 25 if cycle_us < 2000 else 50
    if bits == 8:
        text += card_text("adc0809", 5, inputs, 8, f"conversion_us = {conversion_us}")
    else:
        text += card_text("adc", 5, inputs, 8, f"conversion_us = {conversion_us}\nbits = {bits}")
    return parse_cell(text, "made-up.toml")


def noticed(rig: Any) -> list[str]:
    return [str(each) for each in rig.controller.detections]


@pytest.mark.parametrize(
    ("count", "cycle_us", "bits", "law"),
    [
        (1, 2500, 8, "mras"),
        (1, 10_000, 16, "slotine-li"),
        (2, 1000, 8, "computed-torque"),
        (3, 10_000, 12, "mras"),
        (5, 5000, 8, "mras-lyapunov"),
        (7, 5000, 8, "slotine-li"),
    ],
)
def test_a_whole_robot_raises_no_alarm(count: int, cycle_us: int, bits: int, law: str) -> None:
    with Rig(made_up(count, cycle_us, bits=bits), law=law, seed=count) as rig:
        rig.run(seconds=SECONDS)
        assert noticed(rig) == []
        assert rig.controller.state is State.RUNNING


AT_S = 1.9
FAULTS = [("potentiometer", "potentiometer-stuck"), ("tachometer", "tachometer-stuck"), ("motor", "current-mismatch")]


@pytest.mark.parametrize("axis", [1, 2, 3])
@pytest.mark.parametrize(("tap", "name"), FAULTS)
def test_each_joint_of_three_has_its_faults_found_by_their_names(axis: int, tap: str, name: str) -> None:
    found = first_detections(made_up(3, cycle_us=5000), f"axis{axis}.{tap}", "open-load" if tap == "motor" else "stuck")
    assert found, "not detected"
    assert (found[0].detector, found[0].where) == (name, f"axis{axis}")


@pytest.mark.parametrize("axis", [1, 6])
def test_a_broken_motor_lead_of_six_joints_is_found_in_ten_cycles(axis: int) -> None:
    cell = made_up(6, cycle_us=5000)
    found = first_detections(cell, f"axis{axis}.motor", "open-load", seconds=0.1)
    assert found[0].where == f"axis{axis}"
    assert found[0].tick - round(AT_S / cell.bus.cycle_s) <= 10


def first_detections(cell: Cell, tap: str, kind: str, seconds: float = 0.4) -> list[Any]:
    with Rig(cell, law="slotine-li") as rig:
        rig.inject(tap, kind, at=AT_S)
        rig.run(seconds=AT_S + seconds)
        return list(rig.controller.detections)


def test_the_fast_path_of_two_joints_and_the_general_one_agree() -> None:
    robot = load_cell("konkuk1").robot[0]
    pose, speed, torque_nm = (0.3, -0.8), (1.1, -0.4), (2.0, -0.7)
    general, fast = ArmExpectation(SerialArm.from_robot(robot)), expectation(cell_arm([robot], ("joint2", "joint3")))
    assert type(fast) is not type(general)
    for each in (general, fast):
        each.refresh(pose, speed)
    assert fast.accelerations(torque_nm) == pytest.approx(general.accelerations(torque_nm), rel=1e-9)
    assert [x for row in fast.mobility for x in row] == pytest.approx([x for row in general.mobility for x in row])


def limits_of(cell: Cell) -> Any:
    timing = Timing.of(cell.bus.cycle_s)
    nominals = joint_nominals(cell, (cell_arm(cell.robot, cell.joint_names),))
    return nominals, cell_thresholds(nominals, cell.supervision, timing), timing


MEASURED = {
    "position_jump_lsb": "4.5",
    "position_drift_lsb": "0.65",
    "speed_jump_lsb": "5.0",
    "speed_drift_lsb": "2.2",
    "current_mismatch_a": "0.075",
    "acceleration_mismatch_rad_s2": "4.0",
}
"""Limits of the paper's robot from what its residuals showed, in 40 runs without a fault."""


def test_what_was_measured_on_the_paper_s_robot_is_near_what_is_derived() -> None:
    """The derivation has to come to the measured limits from noise, friction, weight and current alone."""
    _, derived, _ = limits_of(load_cell("konkuk1"))
    _, measured, _ = limits_of(load_cell("konkuk1", {f"supervision.{key}": value for key, value in MEASURED.items()}))
    for ours, theirs in zip(derived, measured, strict=True):
        for key in ("jump", "drift", "step", "swing", "current", "acceleration"):
            assert getattr(ours, key) == pytest.approx(getattr(theirs, key), rel=0.08), key


def test_limits_go_with_the_noise_and_end_at_what_the_model_is_off_by() -> None:
    (usual,), (loud,) = (limits_of(made_up(1, noise_lsb=noise))[1] for noise in (0.3, 1.2))
    assert loud.jump / usual.jump == pytest.approx(math.hypot(1.2, 12**-0.5) / math.hypot(0.3, 12**-0.5))
    nominals, (derived,), timing = limits_of(made_up(1, noise_lsb=0.0))
    unmodelled = 0.5 * nominals[0].falling_rad_s2 * 0.5 * nominals[0].fastest_rad_s / 30.0**2
    assert derived.speed_grain >= unmodelled > 0.0
    assert timing.assessed == 4


def test_free_fall_and_mobility_are_those_of_a_rod() -> None:
    """One uniform rod of mass m and length l on a rotor J: J + m·l²/3 turns, m·g·l/2 pulls when it is level."""
    cell = made_up(1)
    joint = cell.joints[0]
    mass, rotor = joint.mass_kg, joint.motor.reflected_inertia_kg_m2
    inertia = rotor + mass * LENGTH_M**2 / 3.0
    (nominal,), _, _ = limits_of(cell)
    assert nominal.mobility_per_kg_m2 == pytest.approx((1.0 / inertia, 1.0 / inertia), rel=1e-6)
    assert nominal.weight_nm == pytest.approx(mass * GRAVITY_M_S2 * LENGTH_M / 2.0, rel=0.01)
    assert nominal.falling_rad_s2 == pytest.approx(nominal.weight_nm / inertia)


def rows_of(cell: Cell) -> dict[str, str]:
    """The line of each detector of the last joint."""
    return {line.split()[0]: line for line in detector_lines(cell) if line.startswith("  ")}


def test_a_limit_above_what_the_drive_can_give_is_said_to_be_one() -> None:
    heavy = made_up(1)
    joint = heavy.joints[0]
    motor = joint.motor.model_copy(update={"rotor_inertia_kg_m2": 1.5e-2})
    joint = joint.model_copy(update={"motor": motor, "drive": joint.drive.model_copy(update={"supply_v": 1.0})})
    robot = heavy.robot[0].model_copy(update={"joint": (joint,)})
    rows = rows_of(heavy.model_copy(update={"robot": (robot,)}))
    inertia = motor.rotor_inertia_kg_m2 * motor.gear_ratio**2 + joint.mass_kg * LENGTH_M**2 / 3.0
    turned_round = 2.0 * NEWTON_METRES_PER_GEAR * motor.gear_ratio / inertia
    assert f"make {turned_round:.3g} rad/s2 at most: only a blow shows" in rows["acceleration-mismatch"]
    assert "never speaks here: the amplifier gives 1.5 A at most" in rows["wrong-direction"]
    assert f"to {1.0 / (0.08 * motor.gear_ratio):.3g} rad/s at most" in rows["overspeed"]
    assert "at most" not in rows["tachometer-jump"]


@pytest.mark.parametrize("cell", ["konkuk1", "rhino-pair"])
def test_no_limit_of_a_shipped_cell_is_out_of_reach(cell: str) -> None:
    text = "\n".join(detector_lines(load_cell(cell)))
    assert "never speaks" not in text
    assert "only a blow" not in text


@pytest.mark.parametrize(("cycle_us", "calm", "step"), [(1000, 250, 22), (2500, 100, 9), (10_000, 25, 4)])
def test_times_are_times_whatever_the_cycle(cycle_us: int, calm: int, step: int) -> None:
    timing = Timing.of(cycle_us * 1e-6)
    assert (timing.calm, timing.step) == (calm, step)


def without(cell: Cell, sensor: str) -> Cell:
    """The same arm with a sensor less at its last joint, and the channel with it."""
    table = cell.model_dump(exclude_none=True)
    table["robot"][0]["joint"][-1]["sensors"].pop(sensor)
    signal = f"{cell.joint_names[-1]}.{sensor}"
    for card in table["card"]:
        card["channel"] = tuple(each for each in card["channel"] if each["signal"] != signal)
    return Cell.model_validate(table)


def lines_of(cell: Cell, joint: str) -> list[str]:
    lines = list(detector_lines(cell))
    start = lines.index(f"{joint}:")
    return lines[start : lines.index("", start)]


@pytest.mark.parametrize(
    ("sensor", "detectors"),
    [
        ("tachometer", ["tachometer-stuck", "tachometer-jump", "potentiometer-mismatch", "wrong-direction"]),
        ("current_sense", ["current-mismatch", "current-sense-range"]),
    ],
)
def test_what_cannot_be_watched_is_said(sensor: str, detectors: Iterable[str]) -> None:
    cell = without(made_up(2), sensor)
    missing = f"no {sensor.replace('_', ' ')}"
    for detector in detectors:
        (line,) = [each for each in lines_of(cell, "axis2") if each.split()[:1] == [detector]]
        assert "does not apply" in line
        assert missing in line
        (line,) = [each for each in lines_of(cell, "axis1") if each.split()[:1] == [detector]]
        assert "does not apply" not in line


@pytest.mark.parametrize("sensor", ["tachometer", "current_sense"])
def test_a_joint_with_a_sensor_less_raises_no_alarm(sensor: str) -> None:
    with Rig(without(made_up(2), sensor), law="mras") as rig:
        rig.run(seconds=SECONDS)
        assert noticed(rig) == []


def test_a_potentiometer_that_sticks_is_found_without_a_tachometer() -> None:
    found = first_detections(without(made_up(2), "tachometer"), "axis2.potentiometer", "stuck")
    assert (found[0].detector, found[0].where) == ("potentiometer-stuck", "axis2")


def test_a_limit_that_the_cell_names_counts() -> None:
    cell = load_cell("konkuk1", {"supervision.position_jump_lsb": "6"})
    (line,) = [each for each in lines_of(cell, "joint2") if "position_jump_lsb" in each]
    assert "6.35 deg" in line  # 6 x 270/255


@pytest.mark.parametrize("seed", range(10))
def test_a_start_on_the_stop_is_a_start_whatever_the_noise(seed: int) -> None:
    """A reading of 0.42 LSB of noise is beyond the stop in half of all starts: the margin holds there too."""
    text = KONKUK1.replace("home_deg = 20.0", "home_deg = 130.0", 1)
    with Rig(parse_cell(text, "konkuk1 on its stop"), law="mras", seed=seed) as rig:
        rig.run(seconds=0.05)
        assert rig.controller.state is State.RUNNING
        assert rig.joints["joint2"].reference_rad[0] <= math.radians(130.0)


@pytest.mark.parametrize("law", ["mras", "slotine-li"])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_drive_wire_as_elastic_as_declared_or_half_as_stiff_is_no_alarm(law: str, share: float) -> None:
    stiffness = {"joint2.wire_stiffness": 200.0 * share, "joint3.wire_stiffness": 80.0 * share}
    with Rig("konkuk1", law=law, truth={"joint2.wire": 1, "joint3.wire": 1, **stiffness}) as rig:
        rig.run(seconds=1.0)
        assert noticed(rig) == []
