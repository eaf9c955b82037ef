"""How fast the arms of a model can oscillate and react, which bounds the step of a stable integration."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

STEP_SHARE = 0.5
"""Step as a share of 1/ω: position Verlet is stable up to 2/ω; at 0.5/ω a wire's frequency is 1 % off, (ωh)²/24."""
SHORTEST_STEP_S = 10e-6
"""Shortest step; an integration that diverges all the same is reported."""


def inverse_inertia(model: mujoco.MjModel, angle: Sequence[float]) -> NDArray[np.float64]:
    """M⁻¹ of joints and motors at a pose, shape (dofs, dofs)."""
    data = mujoco.MjData(model)
    data.qpos[:] = angle
    mujoco.mj_fwdPosition(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return np.asarray(np.linalg.inv(inertia))


def fastest_wire_rad_s(inverse: NDArray[np.float64], wires: Sequence[tuple[int, int, float]]) -> float:
    """The highest natural frequency that wires (motor, joint, N·m/rad) give the arms, rad/s; 0 without a wire."""
    if not wires:
        return 0.0
    stiffness = np.zeros_like(inverse)
    for motor, joint, stiffness_nm_rad in wires:
        stiffness[np.ix_((motor, joint), (motor, joint))] += stiffness_nm_rad * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return math.sqrt(max(float(np.linalg.eigvals(inverse @ stiffness).real.max()), 0.0))
