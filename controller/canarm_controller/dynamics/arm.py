"""What a nominal arm offers, however it is computed, and which way suits a robot."""

from collections.abc import Sequence
from typing import Protocol

from canarm_protocol.cell.model import Robot

from .chain import Floats
from .planar_pair import NominalArm, is_planar_pair
from .serial_arm import SerialArm


class Arm(Protocol):
    """What `NominalArm` and `SerialArm` share: rad, rad/s, rad/s² and N·m at the joint, one number a joint."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""

    @property
    def joint_count(self) -> int:
        """Number of joints."""

    @property
    def rotor_inertia(self) -> tuple[float, ...]:
        """N²·J_rotor, kg·m²."""

    @property
    def torque_per_ampere(self) -> tuple[float, ...]:
        """K_I, N·m/A."""

    @property
    def max_current_a(self) -> tuple[float, ...]:
        """What the amplifiers deliver, A."""

    @property
    def effective_inertia(self) -> tuple[float, ...]:
        """D_ii(home pose) + N²·J_rotor, kg·m²."""

    def torque_nm(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], /) -> tuple[float, ...]:
        """Inverse dynamics with the drives."""

    def torque_batch_nm(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """`torque_nm` of many states, (samples, joints)."""

    def inertia(self, q: Sequence[float]) -> tuple[tuple[float, ...], ...]:
        """D(q) of the links alone, kg·m²."""

    def coriolis(self, q: Sequence[float], qd: Sequence[float], /) -> tuple[float, ...]:
        """H(q, q̇), N·m."""

    def gravity(self, q: Sequence[float], /) -> tuple[float, ...]:
        """G(q), N·m."""

    def friction(self, qd: Sequence[float]) -> tuple[float, ...]:
        """Friction of the drives, N·m."""


def nominal_arm(robot: Robot) -> Arm:
    """The arm of a cell's nominal parameters: in closed form where there is one.

    Raises `DynamicsError` for more than 6 joints, or a parameter that is not finite.
    """
    return NominalArm.from_robot(robot) if is_planar_pair(robot) else SerialArm.from_robot(robot)
