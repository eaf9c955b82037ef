"""The nominal arm of any robot in a cell: links from the Newton-Euler programs, and drives.

Owns what the controller believes about an arm of 1 to 7 joints, with the same names as `NominalArm` has for two. The
true robot must not enter: no physics engine, no payload, no parameter that a cell does not hold.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import radians, tanh
from typing import Self

import numpy as np

from canarm_protocol.cell.model import Robot

from .batch import BatchProgram
from .chain import Chain, Floats, chain_of
from .checks import check_state
from .forward import pivots_of, refuse_singular
from .newton_euler import (
    DriveTerms,
    acceleration_program,
    coriolis_program,
    gravity_program,
    inertia_program,
    torque_program,
)
from .planar_pair import COULOMB_SMOOTHING_RAD_S
from .scalar import ScalarFunction, compile_scalar

Numbers = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SerialArm:
    """A serial arm of revolute joints with its drives. Joint angles in rad, torques in N·m at the joint.

    τ = D(q)·q̈ + H(q, q̇) + G(q) + N²J_rotor·q̈ + Fv·q̇ + Fc·tanh(q̇/v_s), with v_s = `COULOMB_SMOOTHING_RAD_S`. The rotors
    turn about their own joints only: their gyroscopic torques are left out, as the gears of these arms allow.

    Functions of one state take a sequence of floats for each of q, q̇ (rad/s) and q̈ (rad/s²), one number per joint:

    - `torque_nm(q, qd, qdd)`: inverse dynamics with the drives; made for the control cycle;
    - `coriolis(q, qd)`, `gravity(q)`: H and G of the links;
    - `batch(q, qd, qdd, out=None)`: `torque_nm` for arrays (joints, samples), the fastest way to fill a table.

    All raise `DynamicsError` for a wrong length and for a value that is not finite. `effective_inertia` is
    J_i = D_ii(home pose) + N²J_rotor, kg·m²: the constant by which the joint laws scale their gains.
    """

    chain: Chain
    joint_names: tuple[str, ...]
    rotor_inertia: Numbers
    viscous_nm_s: Numbers
    coulomb_nm: Numbers
    torque_per_ampere: Numbers
    max_current_a: Numbers
    effective_inertia: Numbers
    torque_nm: ScalarFunction = field(repr=False, compare=False)
    coriolis: ScalarFunction = field(repr=False, compare=False)
    gravity: ScalarFunction = field(repr=False, compare=False)
    batch: BatchProgram = field(repr=False, compare=False)
    _inertia: ScalarFunction = field(repr=False, compare=False)
    _acceleration: ScalarFunction = field(repr=False, compare=False)

    @property
    def joint_count(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @classmethod
    def from_robot(cls, robot: Robot) -> Self:
        """The arm of a cell's nominal parameters.

        Raises `DynamicsError` for more than 7 joints, or a parameter that is not finite.
        """
        chain = chain_of(robot)
        names = chain.joint_names
        motors = [joint.motor for joint in robot.joint]
        rotor = tuple(motor.reflected_inertia_kg_m2 for motor in motors)
        viscous = tuple(motor.viscous_friction_nm_s for motor in motors)
        coulomb = tuple(motor.coulomb_friction_nm for motor in motors)
        drive = DriveTerms(rotor, viscous, coulomb, COULOMB_SMOOTHING_RAD_S)
        inertia = compile_scalar(inertia_program(chain), names)
        at_home = inertia([radians(joint.home_deg) for joint in robot.joint])
        diagonal = at_home[:: len(names) + 1]
        return cls(
            chain=chain,
            joint_names=names,
            rotor_inertia=rotor,
            viscous_nm_s=viscous,
            coulomb_nm=coulomb,
            torque_per_ampere=tuple(motor.torque_per_ampere for motor in motors),
            max_current_a=tuple(joint.drive.max_current_a for joint in robot.joint),
            effective_inertia=tuple(map(sum, zip(diagonal, rotor, strict=True))),
            torque_nm=compile_scalar(torque_program(chain, drive), names),
            coriolis=compile_scalar(coriolis_program(chain), names),
            gravity=compile_scalar(gravity_program(chain), names),
            batch=BatchProgram(torque_program(chain, drive, for_batch=True), names),
            _inertia=inertia,
            _acceleration=compile_scalar(acceleration_program(chain, drive), names),
        )

    def torque_batch_nm(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """`torque_nm` for many states at once: arrays (samples, joints) in, torques (samples, joints) out."""
        return self.batch(np.transpose(q), np.transpose(qd), np.transpose(qdd)).T

    def inertia(self, q: Sequence[float]) -> tuple[Numbers, ...]:
        """D(q) of the links alone, kg·m², row by row; the rotors add `rotor_inertia` to its diagonal."""
        flat, count = self._inertia(q), self.joint_count
        return tuple(flat[start : start + count] for start in range(0, count * count, count))

    def friction(self, qd: Sequence[float]) -> Numbers:
        """Viscous and smoothed Coulomb friction of the drives at joint speeds `qd` (rad/s), N·m."""
        check_state(self.joint_names, qd=qd)
        return tuple(
            viscous * speed + coulomb * tanh(speed / COULOMB_SMOOTHING_RAD_S)
            for viscous, coulomb, speed in zip(self.viscous_nm_s, self.coulomb_nm, qd, strict=True)
        )

    def acceleration_rad_s2(self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float]) -> Numbers:
        """Forward dynamics: q̈ under the drives' torques, the inverse of `torque_nm`.

        Raises `DynamicsError` where the inertia matrix, rotors included, is singular.
        """
        count = self.joint_count
        try:
            found = self._acceleration(q, qd, torque_nm)
        except ZeroDivisionError:
            rows = [
                [value + self.rotor_inertia[i] * (i == k) for k, value in enumerate(row)]
                for i, row in enumerate(self.inertia(q))
            ]
            refuse_singular(self.joint_names, [row[i] for i, row in enumerate(rows)], pivots_of(rows))
            raise
        refuse_singular(self.joint_names, found[count : 2 * count], found[2 * count :])
        return found[:count]
