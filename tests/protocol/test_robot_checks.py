"""A robot that cannot be is refused with what would be right; one that just can be is taken."""

import math

import pytest

from canarm_controller.dynamics import nominal_arm
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.inertia import own_inertia_kg_m2
from canarm_protocol.cell.model import Body, Joint
from canarm_protocol.cell.robot_checks import joint_problems, robot_problems

ROBOT = load_cell("konkuk1").robot[0]
JOINT = ROBOT.joint[0]


def with_motor(**motor: float) -> Joint:
    return JOINT.model_copy(update={"motor": JOINT.motor.model_copy(update=motor)})


def with_body(**changes: object) -> Joint:
    body = Body(
        origin_m=(0.0, 0.0, 0.1), mass_kg=1.0, centre_of_mass_m=(0.0, 0.0, 0.1), inertia_kg_m2=(1, 1, 1, 0, 0, 0)
    )
    return JOINT.model_copy(update={"link": None, "body": body.model_copy(update=changes)})


def test_what_nothing_resists_is_refused_with_the_arithmetic() -> None:
    # A rod of 1 mg and 1 mm about its end: m l^2 / 3 = 3.3e-13 kg m2, and a rotor of as much.
    rod = with_body(
        mass_kg=1e-6, centre_of_mass_m=(0.5e-3, 0.0, 0.0), inertia_kg_m2=(0.0, 8.333e-14, 8.333e-14, 0.0, 0.0, 0.0)
    )
    light = rod.model_copy(update={"motor": rod.motor.model_copy(update={"rotor_inertia_kg_m2": 1e-16})})
    (line,) = joint_problems("joint2", light)
    assert "rotor_inertia_kg_m2 = 1e-16: times gear_ratio = 60 squared" in line
    assert "own inertia about the axis, it is 6.93e-13 kg m2; at least 1e-09" in line


def test_own_inertia_is_that_of_the_whole_when_there_is_one_joint() -> None:
    # The inertia matrix of the last joint, as the arm's model has it, is its own inertia.
    cell = load_cell("konkuk1")
    last = cell.joints[-1]
    arm = nominal_arm(cell.robot[0])
    assert own_inertia_kg_m2(last.solid) == pytest.approx(arm.inertia([0.3, 0.7])[1][1], rel=1e-12)


def test_an_axis_is_a_unit_vector() -> None:
    assert not list(joint_problems("joint2", with_body(axis=(0.6, 0.0, 0.8))))
    (line,) = joint_problems("joint2", with_body(axis=(0.0, 1.0, 1.0)))
    assert line == f"joint 'joint2'.body.axis = [0.0, 1.0, 1.0]: must be a unit vector; its length is {math.sqrt(2):g}"


def test_gears_windings_and_gravity_that_are_slipped_units_are_refused_with_the_arithmetic() -> None:
    (line,) = joint_problems("joint2", with_motor(gear_ratio=1e308))
    assert line.endswith("rotor_inertia_kg_m2 = 1.5e-05 times its square is inf kg m2 at the joint; at most 1e+06")
    (line,) = joint_problems("joint2", with_motor(winding_mh=1.25e7))
    assert "over winding_ohm = 2.5 it makes a time constant of 5000 s; must be 1e-07 to 1 s" in line
    (line,) = robot_problems(ROBOT.model_copy(update={"gravity_m_s2": (0.0, 0.0, -9806.2)}))
    assert line == "robot 'konkuk1'.gravity_m_s2: is 9806.2 m/s2 strong; at most 100"
