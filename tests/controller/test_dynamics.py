"""The nominal arm against Lagrange's equations of two rods, done by sympy; see test_serial_arm for physics engines."""

from collections.abc import Callable

import numpy as np
import pytest
import sympy

from canarm_controller.dynamics import NominalArm
from canarm_controller.errors import ControllerError
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Robot

ROBOT = load_cell("konkuk1").robot[0]


def changed(robot: Robot, joint: int, **link: object) -> Robot:
    """`robot` with other values in the link of `joint` (0-based)."""
    joints = list(robot.joint)
    new_link = joints[joint].link.model_copy(update=link)
    joints[joint] = joints[joint].model_copy(update={"link": new_link})
    return robot.model_copy(update={"joint": tuple(joints)})


ODD_ROBOT = changed(
    changed(ROBOT, 0, centre_of_mass_m=(-0.05, 0.02, 0.0), inertia_kg_m2=(0.001, 0.002, 0.004), theta_offset_deg=25.0),
    1,
    a_m=0.25,
    centre_of_mass_m=(-0.11, -0.03, 0.05),
    inertia_kg_m2=(0.001, 0.003, 0.005),
    theta_offset_deg=-40.0,
).model_copy(update={"gravity_m_s2": (3.0, -7.0, 2.0)})
"""No rods: centres off the axis, offsets in the joint angles, gravity askew."""


def random_states(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    return (
        rng.uniform(-np.pi, np.pi, (count, 2)),
        rng.uniform(-2.5, 2.5, (count, 2)),
        rng.uniform(-20.0, 20.0, (count, 2)),
    )


def test_rods_give_the_closed_form_that_sympy_derives_from_the_lagrangian() -> None:
    arm = NominalArm.from_robot(ROBOT)
    lagrange = lagrange_torques(mass2=1.0, mass3=0.6, length=0.18, gravity=9.8062)
    for q, qd, qdd in zip(*random_states(200), strict=True):
        links = np.array(arm.torque_nm(q, qd, qdd)) - np.array(arm.rotor_inertia) * qdd - arm.friction(qd)
        np.testing.assert_allclose(links, lagrange(*q, *qd, *qdd), rtol=1e-9, atol=1e-12)


def lagrange_torques(mass2: float, mass3: float, length: float, gravity: float) -> Callable[..., list[float]]:
    """d/dt(∂L/∂θ̇) - ∂L/∂θ of two uniform rods, from velocities integrated along the rods."""
    t, along = sympy.symbols("t along")
    theta2, theta3 = sympy.Function("theta2")(t), sympy.Function("theta3")(t)

    def lagrangian(mass: float, start: sympy.Matrix, angle: sympy.Expr) -> sympy.Expr:
        point = start + along * sympy.Matrix([sympy.cos(angle), sympy.sin(angle)])
        velocity = point.diff(t)
        density = sympy.Rational(1, 2) * velocity.dot(velocity) - gravity * point[1]
        return sympy.integrate(sympy.expand(density), (along, 0, length)) * mass / length

    elbow = length * sympy.Matrix([sympy.cos(theta2), sympy.sin(theta2)])
    total = lagrangian(mass2, sympy.zeros(2, 1), theta2) + lagrangian(mass3, elbow, theta2 + theta3)
    torques = [total.diff(theta.diff(t)).diff(t) - total.diff(theta) for theta in (theta2, theta3)]
    plain = sympy.symbols("q2 q3 v2 v3 a2 a3")
    moving = [theta.diff(t, order) for order in (2, 1) for theta in (theta2, theta3)] + [theta2, theta3]
    swap = list(zip(moving, [*plain[4:], *plain[2:4], *plain[:2]], strict=True))
    return sympy.lambdify(plain, [torque.subs(swap) for torque in torques], "math")


def test_batch_gives_the_same_torques_as_single_states() -> None:
    arm = NominalArm.from_robot(ODD_ROBOT)
    q, qd, qdd = random_states(300)
    single = [arm.torque_nm(*state) for state in zip(q.tolist(), qd.tolist(), qdd.tolist(), strict=True)]
    np.testing.assert_allclose(arm.torque_batch_nm(q, qd, qdd), single, rtol=1e-12, atol=1e-13)


def test_worst_static_hold_needs_the_currents_of_the_stretched_horizontal_arm() -> None:
    """½m2gL + ½m3gL + m3gL and ½m3gL over K_I = 4.08 and 2.72 N·m/A."""
    arm = NominalArm.from_robot(ROBOT)
    currents = [torque / gain for torque, gain in zip(arm.gravity((0.0, 0.0)), arm.torque_per_ampere, strict=True)]
    assert currents == pytest.approx([0.606, 0.195], abs=5e-4)


def test_effective_inertia_is_that_of_the_home_pose_with_the_rotor() -> None:
    weight = 0.18**2
    expected = (1.0 / 3 + 4 / 3 * 0.6 + 0.6) * weight + 60**2 * 1.5e-5, 0.6 / 3 * weight + 40**2 * 1.5e-5
    assert NominalArm.from_robot(ROBOT).effective_inertia == pytest.approx(expected, rel=1e-12)


def test_friction_opposes_motion_and_reaches_coulomb_plus_viscous() -> None:
    arm = NominalArm.from_robot(ROBOT)
    assert arm.friction((1.0, -1.0)) == pytest.approx((0.20, -0.08), rel=1e-9)
    assert arm.friction((0.0, 0.0)) == (0.0, 0.0)


def test_a_chain_of_another_length_is_refused() -> None:
    with pytest.raises(ControllerError, match=r"'konkuk1' has 1 joints; .* 2 parallel revolute joints"):
        NominalArm.from_robot(ROBOT.model_copy(update={"joint": ROBOT.joint[:1]}))


def test_twisted_axes_are_refused_with_joint_and_key() -> None:
    with pytest.raises(ControllerError, match=r"joint2\.link\.alpha_deg = -90\.0: must be 0"):
        NominalArm.from_robot(changed(ROBOT, 0, alpha_deg=-90.0))
