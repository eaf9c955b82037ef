"""The regressor of one arm for many states at once, and its parameters for other masses, centres and friction.

For identification and for motions that are made for it. The equations are those of `base_parameters`.
"""

from collections.abc import Sequence

import numpy as np

from canarm_protocol.cell.model import Robot

from .base_parameters import BaseParameter, linear_form
from .batch import BatchProgram
from .chain import Floats, chain_of
from .newton_euler import DriveTerms
from .planar_pair import COULOMB_SMOOTHING_RAD_S


class InertialRegressor:
    """Y of τ = Y(q, q̇, q̈)·p, N·m at the joints, with rotors and friction. Raises `DynamicsError` as `chain_of` does.

    `parameters` says what each column stands for; viscous and Coulomb friction of every joint are among them, also
    where the cell has none. Coulomb friction is that of tanh(q̇ / `smoothing_rad_s`).
    """

    def __init__(self, robot: Robot, smoothing_rad_s: float = COULOMB_SMOOTHING_RAD_S) -> None:
        chain = chain_of(robot)
        rotors = [joint.motor.reflected_inertia_kg_m2 for joint in robot.joint]
        some = [1.0] * len(robot.joint)  # a column whose nominal value is 0 would be left out
        form = linear_form(chain, DriveTerms(rotors, some, some, smoothing_rad_s))
        self.joint_names = chain.joint_names
        self.parameters: tuple[BaseParameter, ...] = form.parameters
        self._gradient = BatchProgram(form.gradient, chain.joint_names)

    def rows(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Y for arrays (samples, joints) in rad, rad/s, rad/s²: (samples, joints, parameters)."""
        count = len(self.joint_names)
        states = [np.ascontiguousarray(values.T) for values in (q, qd, qd, qdd, qd)]
        found = np.empty((len(q), count, len(self.parameters)))
        for joint in range(count):
            only = np.zeros_like(states[0])
            only[joint] = 1.0
            found[:, joint] = self._gradient(*states, only).T
        return found

    def values(self, robot: Robot, viscous_nm_s: Sequence[float], coulomb_nm: Sequence[float]) -> Floats:
        """The parameters of `robot`, which differs from the regressor's own in masses, centres and rotors only.

        Friction is as given. Raises `ValueError` for a robot of another shape.
        """
        rotors = [joint.motor.reflected_inertia_kg_m2 for joint in robot.joint]
        some = [1.0] * len(robot.joint)
        form = linear_form(chain_of(robot), DriveTerms(rotors, some, some, COULOMB_SMOOTHING_RAD_S))
        kinds = [(each.joint, each.kind) for each in form.parameters]
        if kinds != [(each.joint, each.kind) for each in self.parameters]:
            raise ValueError(f"{robot.name}: has {len(kinds)} parameters, not those of this regressor")
        friction = {"viscous": viscous_nm_s, "coulomb": coulomb_nm}
        return np.array(
            [friction[each.kind][each.joint] if each.kind in friction else each.nominal for each in form.parameters]
        )
