"""The model that laws use, for any arm of a cell: linear in parameters whose nominal values are the cell's.

Chooses between the regressor of two planar joints and the one for any chain, and combines several arms. A law finds the
true parameters.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from ..dynamics import Arm, NominalArm, SerialArm, SeveralArms
from ..errors import DynamicsError
from .chain_regressor import ChainRegressor
from .regressor import Regressor

Numbers = Sequence[float]


class ModelState(Protocol):
    """Y(q, q̇, q̇_r, q̈_r) at one state."""

    def torque_nm(self, parameters: Numbers, /) -> Sequence[float]:
        """Y·a: N·m, one number per joint."""

    def gradient(self, s: Numbers, /) -> Sequence[float]:
        """Yᵀs: one number per parameter, from one per joint."""


class ArmModel(Protocol):
    """What `Regressor`, `ChainRegressor` and `SeveralModels` share; rad, rad/s, rad/s², N·m, one number per joint."""

    nominal: tuple[float, ...]
    """The parameters of the cell."""

    def at(self, q: Numbers, qd: Numbers, qd_r: Numbers, qdd_r: Numbers, sliding: Numbers, /) -> ModelState:
        """Y; with q̇ and q̈ in place of `qd_r` and `qdd_r` Y·a is the inverse dynamics, friction by `sliding`."""

    def acceleration(self, parameters: Numbers, q: Numbers, qd: Numbers, torque_nm: Numbers, /) -> Sequence[float]:
        """q̈ under the drives' torques."""

    def by_joint(self, factors: Numbers, /) -> Mapping[str, list[float]]:
        """For display: `factors` (parameters as multiples of nominal) per joint."""


def arm_model(arm: Arm) -> ArmModel:
    """The model of an arm of a cell. Raises `DynamicsError` for an arm of a foreign kind."""
    match arm:
        case NominalArm():
            return Regressor(arm)
        case SerialArm():
            return ChainRegressor(arm)
        case SeveralArms():
            return SeveralModels([(arm_model(part), part.joint_count) for part in arm.parts])
    raise DynamicsError(f"{type(arm).__name__} has no model; must be what `cell_arm` or `nominal_arm` gives")


class SeveralModels:
    """Arms side by side: joints and parameters of one after those of the other."""

    __slots__ = ("_parts", "nominal")

    def __init__(self, parts: Sequence[tuple[ArmModel, int]]) -> None:
        """The models with the number of their joints."""
        self._parts: list[tuple[ArmModel, slice, slice]] = []
        joint = parameter = 0
        for model, joints in parts:
            count = len(model.nominal)
            self._parts.append((model, slice(joint, joint + joints), slice(parameter, parameter + count)))
            joint, parameter = joint + joints, parameter + count
        self.nominal: tuple[float, ...] = tuple(value for model, _ in parts for value in model.nominal)

    def at(self, q: Numbers, qd: Numbers, qd_r: Numbers, qdd_r: Numbers, sliding: Numbers) -> "SeveralStates":
        """Y of all, block by block."""
        return SeveralStates(
            [
                (model.at(q[own], qd[own], qd_r[own], qdd_r[own], sliding[own]), own, of)
                for model, own, of in self._parts
            ]
        )

    def acceleration(self, parameters: Numbers, q: Numbers, qd: Numbers, torque_nm: Numbers) -> Sequence[float]:
        """q̈ of all joints."""
        found: list[float] = []
        for model, own, of in self._parts:
            found += model.acceleration(parameters[of], q[own], qd[own], torque_nm[own])
        return found

    def by_joint(self, factors: Numbers) -> Mapping[str, list[float]]:
        """What each model shows, joints in order."""
        shown: dict[str, list[float]] = {}
        for model, _, of in self._parts:
            for name, values in model.by_joint(factors[of]).items():
                shown.setdefault(name, []).extend(values)
        return shown


class SeveralStates:
    """Y of arms beside each other, at one state of each."""

    __slots__ = ("_parts",)

    def __init__(self, parts: Sequence[tuple[ModelState, slice, slice]]) -> None:
        self._parts = parts

    def torque_nm(self, parameters: Numbers) -> Sequence[float]:
        """Y·a, N·m."""
        return [torque for state, _, of in self._parts for torque in state.torque_nm(parameters[of])]

    def gradient(self, s: Numbers) -> Sequence[float]:
        """Yᵀs, one number per parameter."""
        return [value for state, own, _ in self._parts for value in state.gradient(s[own])]
