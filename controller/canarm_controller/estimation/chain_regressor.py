"""Any chain of joints written linearly in its base parameters: τ = Y(q, q̇, q̇_r, q̈_r)·a, as `Regressor` is for two.

Decides how to display the parameters, and when they are impossible. Equations are in `dynamics.base_parameters`; a law
finds the true parameters.
"""

from collections.abc import Sequence

from ..dynamics import COULOMB_SMOOTHING_RAD_S, SerialArm
from ..dynamics.base_parameters import ENTRIES, BaseParameter, linear_form
from ..dynamics.forward import is_singular
from ..dynamics.newton_euler import DriveTerms
from ..dynamics.scalar import ScalarFunction, compile_scalar

Numbers = Sequence[float]

LEAST_OF_ROTOR = 0.25
"""Least inertia of a joint, as a share of its rotor's, whatever the other joints do. A law keeps parameters at 0.3 of
nominal at least; an inertia below this is impossible for an arm."""


class ChainRegressor:
    """Y and what belongs to it for one arm; angles in rad, torques in N·m, one number per joint.

    `parameters` says what the numbers of `nominal` are.
    """

    __slots__ = ("_acceleration", "_gradient", "_joints", "_least", "_torque", "nominal", "parameters")

    def __init__(self, arm: SerialArm) -> None:
        drive = DriveTerms(arm.rotor_inertia, arm.viscous_nm_s, arm.coulomb_nm, COULOMB_SMOOTHING_RAD_S)
        form = linear_form(arm.chain, drive)
        names = arm.joint_names
        self.parameters: tuple[BaseParameter, ...] = form.parameters
        self.nominal: tuple[float, ...] = tuple(parameter.nominal for parameter in form.parameters)
        groups = {"p": [f"{names[each.joint]}.{each.kind}" for each in form.parameters]}
        self._torque = compile_scalar(form.torque, names, groups)
        self._gradient = compile_scalar(form.gradient, names)
        self._acceleration = compile_scalar(form.acceleration, names, groups)
        self._joints = arm.joint_count
        self._least = [LEAST_OF_ROTOR * rotor for rotor in arm.rotor_inertia]

    def at(self, q: Numbers, qd: Numbers, qd_r: Numbers, qdd_r: Numbers, sliding: Numbers) -> "ChainState":
        """Y at one state.

        `qd_r` and `qdd_r` are the reference speed and acceleration of Slotine and Li, as for `Regressor.rows`; Coulomb
        friction takes its sign from the speeds `sliding`.
        """
        return ChainState((q, qd, qd_r, qdd_r, sliding), self._torque, self._gradient)

    def acceleration(self, parameters: Numbers, q: Numbers, qd: Numbers, torque_nm: Numbers) -> Sequence[float]:
        """q̈ in rad/s² under `torque_nm`: D⁻¹(τ - H - G - friction); the nominal arm's if theirs is near singular."""
        count, least = self._joints, self._least
        try:
            found = self._acceleration(q, qd, torque_nm, parameters)
        except ZeroDivisionError:
            return self._acceleration(q, qd, torque_nm, self.nominal)[:count]
        for joint in range(count):
            pivot = found[2 * count + joint]
            if pivot < least[joint] or is_singular(found[count + joint], pivot):
                return self._acceleration(q, qd, torque_nm, self.nominal)[:count]
        return found[:count]

    def by_joint(self, factors: Numbers) -> dict[str, list[float]]:
        """Parameters as multiples of nominal: of each joint the largest second moment, the largest first moment (the
        link's weight, as seen at its joint) and Coulomb friction; 1 where a joint has none of its own.
        """
        return {
            "inertia_factor": self._largest(factors, [kind for kind in ENTRIES.values() if not kind.startswith("m")]),
            "weight_factor": self._largest(factors, ["mx", "my"]),
            "coulomb_factor": self._largest(factors, ["coulomb"]),
        }

    def _largest(self, factors: Numbers, kinds: Sequence[str]) -> list[float]:
        found = [(0.0, 1.0)] * self._joints
        for parameter, factor in zip(self.parameters, factors, strict=True):
            if parameter.kind in kinds and abs(parameter.nominal) > found[parameter.joint][0]:
                found[parameter.joint] = abs(parameter.nominal), factor
        return [factor for _, factor in found]


class ChainState:
    """Y of one state, through its two products; each is computed when it is needed."""

    __slots__ = ("_gradient", "_state", "_torque")

    def __init__(self, state: tuple[Numbers, ...], torque: ScalarFunction, gradient: ScalarFunction) -> None:
        self._state, self._torque, self._gradient = state, torque, gradient

    def torque_nm(self, parameters: Numbers) -> Sequence[float]:
        """Y·a, N·m."""
        return self._torque(*self._state, parameters)

    def gradient(self, s: Numbers) -> Sequence[float]:
        """Yᵀs, one number per parameter."""
        return self._gradient(*self._state, s)
