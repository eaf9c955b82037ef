"""Forward dynamics: what the joints do under given torques. Owns the solution of D(q)·q̈ = τ and its refusal."""

from collections.abc import Sequence

from ..errors import DynamicsError

SINGULAR = 1e-12
"""A joint of which less than this part of its inertia is left, when the joints before it move freely, cannot be solved
for: rounding in D, 1e-16 of it, would be one ten-thousandth of the acceleration, or all of it."""


def accelerations(
    joint_names: Sequence[str], inertia: Sequence[Sequence[float]], torque_nm: Sequence[float]
) -> tuple[float, ...]:
    """q̈ in rad/s², from the symmetric inertia matrix (kg·m², n × n) by D = L·diag(p)·Lᵀ.

    Raises `DynamicsError` where D is not positive definite to rounding, and names the joint.
    """
    count = len(joint_names)
    lower = [[0.0] * count for _ in range(count)]
    pivots: list[float] = []
    solution = list(torque_nm)
    for i, row in enumerate(inertia):
        for k in range(i):
            known = sum(lower[i][m] * lower[k][m] * pivots[m] for m in range(k))
            lower[i][k] = (row[k] - known) / pivots[k]
        pivot = row[i] - sum(lower[i][m] ** 2 * pivots[m] for m in range(i))
        if not pivot > SINGULAR * row[i]:
            raise DynamicsError(
                f"{joint_names[i]}: inertia matrix is singular here (pivot {pivot:.3g} of {row[i]:.3g} kg m2); "
                "must be positive: give the link or its rotor inertia about this axis"
            )
        pivots.append(pivot)
        solution[i] -= sum(lower[i][m] * solution[m] for m in range(i))
    for i in reversed(range(count)):
        solution[i] /= pivots[i]
        solution[i] -= sum(lower[m][i] * solution[m] for m in range(i + 1, count))
    return tuple(solution)
