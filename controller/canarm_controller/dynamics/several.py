"""The arms of several robots as one: joints of one after those of the other, in the order of the cell.

Owns the bookkeeping of blocks. In the controller's model the arms do not touch each other; an object that two of them
carry must not enter.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from .arm import Arm
from .chain import Floats

Numbers = tuple[float, ...]
State = Sequence[float]


class SeveralArms:
    """Several `Arm`s side by side. Errors of one of them name the joint as in its robot."""

    __slots__ = (
        "_blocks", "effective_inertia", "joint_names", "max_current_a", "parts", "rotor_inertia", "torque_per_ampere",
    )  # fmt: skip

    def __init__(self, parts: tuple[Arm, ...], joint_names: tuple[str, ...]) -> None:
        """The arms, base to tip each, and the names of all their joints."""
        self.parts, self.joint_names = parts, joint_names
        self._blocks: list[tuple[Arm, slice]] = []
        for arm in parts:
            start = self._blocks[-1][1].stop if self._blocks else 0
            self._blocks.append((arm, slice(start, start + arm.joint_count)))
        self.rotor_inertia: Numbers = _joined(arm.rotor_inertia for arm in parts)
        self.torque_per_ampere: Numbers = _joined(arm.torque_per_ampere for arm in parts)
        self.max_current_a: Numbers = _joined(arm.max_current_a for arm in parts)
        self.effective_inertia: Numbers = _joined(arm.effective_inertia for arm in parts)

    @property
    def joint_count(self) -> int:
        """Number of all joints."""
        return len(self.joint_names)

    def torque_nm(self, q: State, qd: State, qdd: State) -> Numbers:
        """Inverse dynamics with the drives, N·m."""
        return _joined(arm.torque_nm(q[own], qd[own], qdd[own]) for arm, own in self._blocks)

    def torque_batch_nm(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """`torque_nm` of many states, (samples, joints)."""
        parts = [arm.torque_batch_nm(q[:, own], qd[:, own], qdd[:, own]) for arm, own in self._blocks]
        return np.concatenate(parts, axis=1)

    def inertia(self, q: State) -> tuple[Numbers, ...]:
        """D(q) of the links alone, kg·m²: the arms' on its diagonal."""
        rows: list[Numbers] = []
        for arm, own in self._blocks:
            before, after = (0.0,) * own.start, (0.0,) * (self.joint_count - own.stop)
            rows += [(*before, *row, *after) for row in arm.inertia(q[own])]
        return tuple(rows)

    def coriolis(self, q: State, qd: State) -> Numbers:
        """H(q, q̇), N·m."""
        return _joined(arm.coriolis(q[own], qd[own]) for arm, own in self._blocks)

    def gravity(self, q: State) -> Numbers:
        """G(q), N·m, each robot in its own field of gravity."""
        return _joined(arm.gravity(q[own]) for arm, own in self._blocks)

    def friction(self, qd: State) -> Numbers:
        """Friction of the drives, N·m."""
        return _joined(arm.friction(qd[own]) for arm, own in self._blocks)

    def acceleration_rad_s2(self, q: State, qd: State, torque_nm: State) -> Numbers:
        """Forward dynamics: q̈ under the drives' torques."""
        found: list[float] = []
        for arm, own in self._blocks:
            found += arm.acceleration_rad_s2(q[own], qd[own], torque_nm[own])
        return tuple(found)


def _joined(blocks: Iterable[Sequence[float]]) -> Numbers:
    return tuple([value for block in blocks for value in block])
