"""The interface of a nominal arm, however it is computed; `nominal` chooses the implementation."""

from collections.abc import Sequence
from typing import Protocol

from .chain import Floats


class Arm(Protocol):
    """What `NominalArm`, `SerialArm` and `SeveralArms` share: rad, rad/s, rad/s² and N·m, one number per joint."""

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
        """Highest current of the amplifiers, A."""

    @property
    def effective_inertia(self) -> tuple[float, ...]:
        """D_ii(home pose) + N²·J_rotor, kg·m²."""

    def torque_nm(self, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float], /) -> Sequence[float]:
        """Inverse dynamics with the drives."""

    def torque_batch_nm(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """`torque_nm` of many states, (samples, joints)."""

    def inertia(self, q: Sequence[float]) -> tuple[tuple[float, ...], ...]:
        """D(q) of the links alone, kg·m²."""

    def coriolis(self, q: Sequence[float], qd: Sequence[float], /) -> Sequence[float]:
        """H(q, q̇), N·m."""

    def gravity(self, q: Sequence[float], /) -> Sequence[float]:
        """G(q), N·m."""

    def friction(self, qd: Sequence[float]) -> tuple[float, ...]:
        """Friction of the drives, N·m."""

    def acceleration_rad_s2(
        self, q: Sequence[float], qd: Sequence[float], torque_nm: Sequence[float], /
    ) -> Sequence[float]:
        """Forward dynamics: q̈ under the drives' torques."""
