"""Lagrange-Euler dynamics of the nominal two-joint planar arm in closed form.

Owns what the controller believes about the robot: inertia, Coriolis, gravity and drive friction, from the cell. The
true robot must not enter: no physics engine, no payload, no parameter that a cell does not hold.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, isclose, radians, sin, tanh
from typing import Self

import numpy as np

from canarm_protocol.cell.model import Joint, Robot

from ..errors import DynamicsError
from .chain import Floats, check_parameters
from .checks import check_samples, check_state

Pair = tuple[float, float]

COULOMB_SMOOTHING_RAD_S = 0.02
"""Coulomb friction is Fc·tanh(qd / this): one step of the 8-bit tachometer (5/255 rad/s), below which the sign of the
speed is unknown anyway."""


@dataclass(frozen=True, slots=True)
class NominalArm:
    """Two parallel revolute joints, planar, with their drives. Joint angles in rad, torques in N·m at the joint.

    τ = D(q)·q̈ + H(q, q̇) + G(q) + N²J_rotor·q̈ + Fv·q̇ + Fc·tanh(q̇/v_s). With rods of length L this is equation (2-13) of
    the KON-KUK I paper (with the printed signs put right) plus the drive, which the paper leaves out. The constants are
    the lumped ones of any planar two-link arm: with c_i the vector from joint axis i to the centre of mass of link i,

    - `inertia_constants` = I2 + m2|c2|² + I3 + m3(|c3|² + a2²), I3 + m3|c3|²;
    - `coupling_kg_m2` = m3·a2·|c3|, which acts through cos and sin of q3 + `coupling_phase_rad`;
    - `gravity_nm`, `gravity_phase_rad`: moment of the weights about each axis is gravity_nm·sin(angle + phase), where
      angle is q2 for what hangs on the first axis alone and q2 + q3 for the second link.

    `effective_inertia` is J_i = D_ii(home pose) + N²J_rotor, kg·m²: the constant by which the joint laws scale their
    gains. At home the arm of konkuk1 is stretched out and D22 is largest, so the loop is never slower than intended.
    """

    joint_names: tuple[str, str]
    inertia_constants_kg_m2: Pair
    coupling_kg_m2: float
    coupling_phase_rad: float
    gravity_nm: Pair
    gravity_phase_rad: Pair
    rotor_inertia: Pair
    viscous_nm_s: Pair
    coulomb_nm: Pair
    torque_per_ampere: Pair
    max_current_a: Pair
    effective_inertia: Pair

    @property
    def joint_count(self) -> int:
        """Number of joints: 2."""
        return 2

    @classmethod
    def from_robot(cls, robot: Robot) -> Self:
        """The arm of a cell's nominal parameters. Raises `DynamicsError` unless it is a planar pair of joints."""
        _check_planar_pair(robot)
        first, second = robot.joint
        reach = first.dh_link.a_m
        first_mass, second_mass = first.dh_link.mass_kg, second.dh_link.mass_kg
        (x1, y1), (x2, y2) = _centre_from_axis(first), _centre_from_axis(second)
        offset1, offset2 = (radians(joint.dh_link.theta_offset_deg) for joint in robot.joint)
        gravity = hypot(*robot.gravity_m_s2[:2])
        downward = atan2(robot.gravity_m_s2[1], robot.gravity_m_s2[0])
        moment1 = first_mass * x1 + second_mass * reach, first_mass * y1
        own2 = second.dh_link.inertia_kg_m2[2] + second_mass * (x2**2 + y2**2)
        own1 = first.dh_link.inertia_kg_m2[2] + first_mass * (x1**2 + y1**2) + second_mass * reach**2
        coupling = second_mass * reach * hypot(x2, y2)
        phase = atan2(y2, x2) + offset2
        rotor = first.motor.reflected_inertia_kg_m2, second.motor.reflected_inertia_kg_m2
        at_home = own1 + own2 + 2 * coupling * cos(radians(second.home_deg) + phase)
        return cls(
            joint_names=(first.name, second.name),
            inertia_constants_kg_m2=(own1 + own2, own2),
            coupling_kg_m2=coupling,
            coupling_phase_rad=phase,
            gravity_nm=(gravity * hypot(*moment1), gravity * second_mass * hypot(x2, y2)),
            gravity_phase_rad=(atan2(moment1[1], moment1[0]) + offset1 - downward, phase + offset1 - downward),
            rotor_inertia=rotor,
            viscous_nm_s=(first.motor.viscous_friction_nm_s, second.motor.viscous_friction_nm_s),
            coulomb_nm=(first.motor.coulomb_friction_nm, second.motor.coulomb_friction_nm),
            torque_per_ampere=(first.motor.torque_per_ampere, second.motor.torque_per_ampere),
            max_current_a=(first.drive.max_current_a, second.drive.max_current_a),
            effective_inertia=(at_home + rotor[0], own2 + rotor[1]),
        )

    def torque_nm(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float]) -> Pair:
        """Joint torques for one state (rad, rad/s, rad/s²): inverse dynamics with the drive, in plain floats.

        Raises `DynamicsError` for another number of joints, and for a value that is not finite.
        """
        try:
            q1, q2 = q
            v1, v2 = qd
            a1, a2 = qdd
            total = q1 + q2 + v1 + v2 + a1 + a2
            if total - total:  # NaN unless all are finite, or if their sum overflows
                check_state(self.joint_names, q=q, qd=qd, qdd=qdd)
        except (TypeError, ValueError):
            check_state(self.joint_names, q=q, qd=qd, qdd=qdd)
            raise
        own1, own2 = self.inertia_constants_kg_m2
        coupling = self.coupling_kg_m2
        angle = q2 + self.coupling_phase_rad
        along = coupling * cos(angle)
        across = coupling * sin(angle)
        shared = own2 + along
        weight1, weight2 = self.gravity_nm
        phase1, phase2 = self.gravity_phase_rad
        outer = weight2 * sin(q1 + q2 + phase2)
        rotor1, rotor2 = self.rotor_inertia
        viscous1, viscous2 = self.viscous_nm_s
        coulomb1, coulomb2 = self.coulomb_nm
        return (
            (own1 + 2.0 * along + rotor1) * a1
            + shared * a2
            - across * v2 * (2.0 * v1 + v2)
            + weight1 * sin(q1 + phase1)
            + outer
            + viscous1 * v1
            + coulomb1 * tanh(v1 / COULOMB_SMOOTHING_RAD_S),
            shared * a1
            + (own2 + rotor2) * a2
            + across * v1 * v1
            + outer
            + viscous2 * v2
            + coulomb2 * tanh(v2 / COULOMB_SMOOTHING_RAD_S),
        )

    def torque_batch_nm(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """`torque_nm` for many states at once: arrays (n, 2) in, torques (n, 2) out.

        Raises `DynamicsError` for another shape, and for a value that is not finite; names the sample and joint.
        """
        check_samples(self.joint_names, q=q.T, qd=qd.T, qdd=qdd.T)
        (q1, q2), (v1, v2), (a1, a2) = q.T, qd.T, qdd.T
        own1, own2 = self.inertia_constants_kg_m2
        angle = q2 + self.coupling_phase_rad
        along = self.coupling_kg_m2 * np.cos(angle)
        across = self.coupling_kg_m2 * np.sin(angle)
        outer = self.gravity_nm[1] * np.sin(q1 + q2 + self.gravity_phase_rad[1])
        torque = np.asarray(self.viscous_nm_s) * qd
        torque += np.asarray(self.coulomb_nm) * np.tanh(qd / COULOMB_SMOOTHING_RAD_S)
        torque += np.asarray(self.rotor_inertia) * qdd
        torque[:, 0] += (own1 + 2.0 * along) * a1 + (own2 + along) * a2 - across * v2 * (2.0 * v1 + v2)
        torque[:, 0] += self.gravity_nm[0] * np.sin(q1 + self.gravity_phase_rad[0]) + outer
        torque[:, 1] += (own2 + along) * a1 + own2 * a2 + across * v1 * v1 + outer
        return torque

    def acceleration_rad_s2(self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float]) -> Pair:
        """Forward dynamics: q̈ under the drives' torques, the inverse of `torque_nm`. Rotors keep D from singularity."""
        still1, still2 = self.torque_nm(q, qd, (0.0, 0.0))
        left1, left2 = torque_nm[0] - still1, torque_nm[1] - still2
        (d11, d12), (_, d22) = self.inertia(q)
        d11, d22 = d11 + self.rotor_inertia[0], d22 + self.rotor_inertia[1]
        determinant = d11 * d22 - d12 * d12
        return (d22 * left1 - d12 * left2) / determinant, (d11 * left2 - d12 * left1) / determinant

    def inertia(self, q: Sequence[float]) -> tuple[Pair, Pair]:
        """D(q) of the links alone, kg·m²; the rotors add `rotor_inertia` to its diagonal."""
        own1, own2 = self.inertia_constants_kg_m2
        along = self.coupling_kg_m2 * cos(q[1] + self.coupling_phase_rad)
        return (own1 + 2.0 * along, own2 + along), (own2 + along, own2)

    def coriolis(self, q: Sequence[float], qd: Sequence[float]) -> Pair:
        """H(q, q̇): Coriolis and centrifugal torques, N·m."""
        across = self.coupling_kg_m2 * sin(q[1] + self.coupling_phase_rad)
        return -across * qd[1] * (2.0 * qd[0] + qd[1]), across * qd[0] ** 2

    def gravity(self, q: Sequence[float]) -> Pair:
        """G(q): torques that hold the arm against its weight, N·m."""
        outer = self.gravity_nm[1] * sin(q[0] + q[1] + self.gravity_phase_rad[1])
        return self.gravity_nm[0] * sin(q[0] + self.gravity_phase_rad[0]) + outer, outer

    def friction(self, qd: Sequence[float]) -> Pair:
        """Viscous and smoothed Coulomb friction of the drives at joint speeds `qd` (rad/s), N·m."""
        return (
            self.viscous_nm_s[0] * qd[0] + self.coulomb_nm[0] * tanh(qd[0] / COULOMB_SMOOTHING_RAD_S),
            self.viscous_nm_s[1] * qd[1] + self.coulomb_nm[1] * tanh(qd[1] / COULOMB_SMOOTHING_RAD_S),
        )


def _centre_from_axis(joint: Joint) -> Pair:
    """Centre of mass from the joint's own axis: the link's frame sits `a_m` further along x (Denavit-Hartenberg)."""
    x, y, _ = joint.dh_link.centre_of_mass_m
    return joint.dh_link.a_m + x, y


def is_planar_pair(robot: Robot) -> bool:
    """Whether `NominalArm` can describe the robot: two joints by links whose axes are parallel.

    Then the motion is planar: what the centres of mass and gravity have along the axes, and moments about other axes,
    do no work. Where bodies stand for links, or a joint counts the other way, the general form is taken.
    """
    return len(robot.joint) == 2 and all(_is_untwisted(joint) for joint in robot.joint)


def _is_untwisted(joint: Joint) -> bool:
    link = joint.link
    return link is not None and link.sign > 0 and isclose(cos(radians(link.alpha_deg)), 1.0, abs_tol=1e-12)


def _check_planar_pair(robot: Robot) -> None:
    if len(robot.joint) != 2:
        raise DynamicsError(
            f"robot {robot.name!r} has {len(robot.joint)} joints; the closed form takes 2 parallel revolute joints"
        )
    for joint in robot.joint:
        if not _is_untwisted(joint):
            raise DynamicsError(
                f"robot {robot.name!r}, {joint.name}.link.alpha_deg = {joint.dh_link.alpha_deg}: must be 0; the closed "
                "form takes 2 parallel revolute joints (sign = 1) that move in one plane"
            )
    check_parameters(robot)
