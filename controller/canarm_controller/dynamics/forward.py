"""Forward dynamics: solves D(q)·q̈ = τ, or refuses a singular D."""

from collections.abc import Sequence

from ..errors import DynamicsError
from .tape import Term, Value

SINGULAR = 1e-12
"""Smallest pivot as a share of the joint's inertia: below it, rounding in D (1e-16) would be one ten-thousandth of the
acceleration or more."""


def solution_terms(inertia: Sequence[Sequence[Value]], torque_nm: Sequence[Value]) -> tuple[list[Value], list[Value]]:
    """q̈ in rad/s² from the symmetric D (kg·m², n × n) by D = L·diag(p)·Lᵀ, and the pivots p; as numbers or terms."""
    count = len(inertia)
    lower: list[list[Value]] = [[0.0] * count for _ in range(count)]
    scaled: list[list[Value]] = [[0.0] * count for _ in range(count)]
    pivots: list[Value] = []
    inverses: list[Value] = []
    solution = list(torque_nm)
    for i, row in enumerate(inertia):
        pivot = row[i]
        for k in range(i):
            known: Value = row[k]
            for m in range(k):
                known = known - lower[i][m] * scaled[k][m]
            scaled[i][k], lower[i][k] = known, known * inverses[k]
        for k in range(i):
            pivot = pivot - lower[i][k] * scaled[i][k]
            solution[i] = solution[i] - lower[i][k] * solution[k]
        pivots.append(pivot)
        inverses.append(0.0 if pivot == 0.0 else 1.0 / pivot)
    for i in reversed(range(count)):
        solution[i] = solution[i] * inverses[i]
        for m in range(i + 1, count):
            solution[i] = solution[i] - lower[m][i] * solution[m]
    return solution, pivots


def pivots_of(inertia: Sequence[Sequence[float]]) -> list[float]:
    """The pivots p of `solution_terms` as numbers; those after a zero are meaningless."""
    _, pivots = solution_terms(inertia, [0.0] * len(inertia))
    return [pivot for pivot in pivots if not isinstance(pivot, Term)]


def is_singular(inertia: float, pivot: float) -> bool:
    """Whether `pivot` of a joint's `inertia` cannot be distinguished from rounding."""
    return not pivot > SINGULAR * inertia


def refuse_singular(joint_names: Sequence[str], inertias: Sequence[float], pivots: Sequence[float]) -> None:
    """Raise `DynamicsError` where D, of the diagonal `inertias`, is not positive definite to rounding: names the joint.

    `pivots` may end at the first that is none.
    """
    for name, inertia, pivot in zip(joint_names, inertias, pivots, strict=False):
        if not pivot > SINGULAR * inertia:  # as `is_singular`: a call for every joint is a tenth of forward dynamics
            raise DynamicsError(
                f"{name}: inertia matrix is singular here (pivot {pivot:.3g} of {inertia:.3g} kg m2); "
                "must be positive: give the link or its rotor inertia about this axis"
            )
