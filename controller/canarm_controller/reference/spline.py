"""A cubic spline that starts and ends at rest: numerics only, several columns at once.

Nothing here knows about joints, files or control.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RestToRestSpline:
    """Clamped cubic spline through `value` (n, columns) at the increasing times `time_s` (n,), held after the last one.

    `slope` (n, columns) are the first derivatives at the knots, 0 at both ends.
    """

    time_s: Floats
    value: Floats
    slope: Floats

    @classmethod
    def through(cls, time_s: Floats, value: Floats) -> "RestToRestSpline":
        """The twice continuously differentiable spline with zero slope at both ends; needs n >= 2."""
        return cls(time_s, value, _knot_slopes(np.diff(time_s), np.diff(value, axis=0)))

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
