"""What a law is to see of two arms that hold one object, and what of its torques is to reach them.

Two position-controlled arms on one stiff object fight: the hands cannot move against each other, so what encoders say
of it is an error of homing, of a base or of a count, and a law that integrates it presses the object until something
slips. Owns that division; forces, laws and detectors must not enter.
"""

from collections.abc import Sequence
from operator import mul, sub

import numpy as np

from ..cycle import Cycle
from ..dynamics import ClosedChain

REFRESH = 8
"""Cycles for which the division is kept: the pose hardly changes."""


class SharedGrip:
    """Divides following errors e = q - q_d into motion (I - Π)·e, which the law sees, and Π·e, of which it has a share.

    Π = W·Cᵀ·(C·W·Cᵀ)⁻¹·C with C of `ClosedChain` and W the inverse of the joints' effective inertias, by which the
    joint laws scale their gains. As C·(I - Π) = 0, what they add up of it is a motion of both hands together.
    """

    def __init__(self, chain: ClosedChain, effective_inertia: Sequence[float], stiffness: float) -> None:
        """`stiffness` is the share of Π·e that the law sees."""
        self._chain, self._taken = chain, 1.0 - stiffness
        self._weights = 1.0 / np.array(effective_inertia)
        self._rows: Sequence[Sequence[float]] = ()
        self._answer: Sequence[Sequence[float]] = ()
        self._columns: Sequence[Sequence[float]] = ()
        self._refresh_in = 0

    def show(self, cycle: Cycle) -> None:
        """Replace positions and speeds of the law's cycle."""
        if not self._refresh_in:
            self._refresh_in = REFRESH
            plain, _ = self._chain.plain(cycle.reference_rad, cycle.reference_rad_s)
            rows = np.array(plain)
            across = self._weights[:, np.newaxis] * rows.T
            answer = np.linalg.solve(rows @ across, across.T).T
            self._rows, self._columns, self._answer = plain, list(zip(*plain, strict=True)), answer.tolist()
        self._refresh_in -= 1
        cycle.position_rad = self._seen(cycle.position_rad, cycle.reference_rad)
        cycle.velocity_rad_s = self._seen(cycle.velocity_rad_s, cycle.reference_rad_s)

    def eased(self, torque_nm: Sequence[float], planned_nm: Sequence[float]) -> list[float]:
        """`torque_nm` less what presses the hands against each other of its difference from `planned_nm`.

        Errors that the grips allow still lead to torques that press: the joints' gains and bias currents are not in
        proportion to their inertias. That part is Cᵀ·μ with μ = (C·W·Cᵀ)⁻¹·C·W·Δτ, a force at the grips, and moves
        nothing.
        """
        more = map(sub, torque_nm, planned_nm)
        a = b = c = 0.0
        for each, (x, y, z) in zip(more, self._answer, strict=True):
            a, b, c = a + x * each, b + y * each, c + z * each
        rows = zip(torque_nm, self._columns, strict=True)
        return [torque - x * a - y * b - z * c for torque, (x, y, z) in rows]

    def _seen(self, measured: Sequence[float], reference: Sequence[float]) -> tuple[float, ...]:
        error = list(map(sub, measured, reference))
        taken = self._taken
        a, b, c = [taken * sum(map(mul, row, error)) for row in self._rows]
        return tuple([each - x * a - y * b - z * c for each, (x, y, z) in zip(measured, self._answer, strict=True)])
