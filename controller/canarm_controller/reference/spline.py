"""Cubic curves through given points, several columns at once: numerics only.

Nothing here knows about joints, files or control.
"""

import math
from dataclasses import dataclass
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Bools: TypeAlias = NDArray[np.bool_]
STEEPEST = 3.0
"""A cubic between two points is monotone if the slopes at its ends have the secant's sign and are no more than this
much steeper: F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238.
"""


@dataclass(frozen=True, eq=False)
class CubicCurve:
    """Piecewise cubic through `value` (n, columns) at the increasing times `time_s` (n,), with `slope` (n, columns).

    Where `curvature` (n, columns) is given, the second derivative goes straight from one to the next, instead of being
    that of the cubics, except in the intervals that are `sparse` (n - 1,). Before the first time and after the last one
    the curve stands still.
    """

    time_s: Floats
    value: Floats
    slope: Floats
    curvature: Floats | None = None
    sparse: Bools | None = None

    @classmethod
    def clamped(cls, time_s: Floats, value: Floats) -> Self:
        """The twice continuously differentiable spline with zero slope at both ends; needs n >= 2."""
        return cls(time_s, value, _knot_slopes(np.diff(time_s), np.diff(value, axis=0)))

    @classmethod
    def monotone(cls, time_s: Floats, value: Floats) -> Self:
        """Between two points the curve never leaves their range; zero slope at both ends; needs n >= 2.

        Slopes by F. N. Fritsch and J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300, as in scipy's PCHIP: a weighted
        harmonic mean of the secants on both sides, 0 where these differ in sign.
        """
        width = np.diff(time_s)[:, None]
        secant = np.diff(value, axis=0) / width
        left, right = secant[:-1], secant[1:]
        first, second = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
        agree = left * right > 0.0
        denominator = np.where(agree, first * right + second * left, 1.0)
        slope = np.zeros_like(value)
        slope[1:-1] = np.where(agree, (first + second) * left * right / denominator, 0.0)
        return cls(time_s, value, slope)

    @classmethod
    def sampled(cls, time_s: Floats, value: Floats, dense_s: float = math.inf) -> Self:
        """A smooth motion of which `value` are samples: derivatives are differences across two intervals; n >= 3.

        Differences across an interval longer than `dense_s` say little about the slopes at its ends. They are limited
        so that the curve does not leave the range of the two points.
        """
        width = np.diff(time_s)
        slope = np.gradient(value, time_s, axis=0, edge_order=2)
        sparse = width > dense_s
        if sparse.any():
            steepest = np.where(sparse[:, None], STEEPEST * np.diff(value, axis=0) / width[:, None], math.inf)
            lowest = np.where(sparse[:, None], np.minimum(steepest, 0.0), -math.inf)
            highest = np.maximum(steepest, 0.0)
            slope[:-1] = np.clip(slope[:-1], lowest, highest)
            slope[1:] = np.clip(slope[1:], lowest, highest)
        return cls(time_s, value, slope, np.gradient(slope, time_s, axis=0, edge_order=2), sparse)

    def at(self, time_s: Floats) -> tuple[Floats, Floats, Floats]:
        """Value, first and second derivative at the times `time_s` (m,), each (m, columns)."""
        knots = self.time_s
        inside = np.clip(time_s, knots[0], knots[-1])
        left = np.clip(np.searchsorted(knots, inside, side="right") - 1, 0, len(knots) - 2)
        width = (knots[left + 1] - knots[left])[:, None]
        s = (inside - knots[left])[:, None] / width
        rise = self.value[left + 1] - self.value[left]
        start, end = self.slope[left] * width, self.slope[left + 1] * width
        quadratic = 3.0 * rise - 2.0 * start - end
        cubic = start + end - 2.0 * rise
        value = self.value[left] + s * (start + s * (quadratic + s * cubic))
        first = (start + s * (2.0 * quadratic + s * 3.0 * cubic)) / width
        second = (2.0 * quadratic + 6.0 * s * cubic) / width**2
        if self.curvature is not None:
            smooth = (1.0 - s) * self.curvature[left] + s * self.curvature[left + 1]
            second = smooth if self.sparse is None else np.where(self.sparse[left, None], second, smooth)
        moving = ((time_s >= knots[0]) & (time_s < knots[-1]))[:, None]
        return value, np.where(moving, first, 0.0), np.where(moving, second, 0.0)


def _knot_slopes(width: Floats, rise: Floats) -> Floats:
    """Slopes that make second derivatives equal on both sides of each inner knot (Thomas algorithm)."""
    count = len(width) + 1
    slope = np.zeros((count, rise.shape[1]))
    if count == 2:
        return slope
    secant = rise / width[:, None]
    inverse = 1.0 / width
    right = 3.0 * (secant[:-1] * inverse[:-1, None] + secant[1:] * inverse[1:, None])
    upper = np.zeros(count - 2)
    for row in range(count - 2):
        below = inverse[row] if row else 0.0
        pivot = 2.0 * (inverse[row] + inverse[row + 1]) - below * (upper[row - 1] if row else 0.0)
        upper[row] = inverse[row + 1] / pivot
        right[row] = (right[row] - below * (right[row - 1] if row else 0.0)) / pivot
    slope[count - 2] = right[-1]
    for row in range(count - 4, -1, -1):
        slope[row + 1] = right[row] - upper[row] * slope[row + 2]
    return slope
