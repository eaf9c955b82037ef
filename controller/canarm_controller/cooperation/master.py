"""The master's path by the paper's (5): θ(n+1) = θ(n) + J⁺(n)·(x_d(n+1) − x_a(n)), one pose after the other.

Owns the iteration, which cannot be done for many poses at once, and so is written out in plain numbers. J is the 3 × 5
position Jacobian; J⁺ gives the smallest step ‖Δθ‖ that moves the tip as asked. That is no least energy, and the path is
not closed: after a lap of a closed path the joints are a little elsewhere. The roll, whose column of J is zero, rests.

In the frame that turns with the waist J falls apart: the waist alone moves the tip across, joints 2 to 4 alone move it
in the plane. So J⁺ is a division and a 2 × 3 pseudo-inverse.
"""

from collections.abc import Iterator
from math import cos, inf, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CooperationError
from .arms import FiveAxisArm
from .kinematics import Floats, checked_pose

NEWTON_STEPS = 3
"""Most steps after (5) itself; each squares the error of (5), some Δ²/m, so few are needed."""
CLOSE_ENOUGH_M = 1e-15
LARGEST_TURN_RAD = 1.0
"""A larger step is beyond the range in which J is valid."""

State = tuple[float, float, float, float]


def follow(
    arm: FiveAxisArm,
    start_rad: ArrayLike,
    points_m: ArrayLike,
    *,
    newton_steps: int = NEWTON_STEPS,
    damping_m: float = 0.0,
    damped_below_m: float = 0.03,
) -> Floats:
    """Joint angles (n, 5) in rad that lead the tip through points (n, 3) in m, in the frame of the arm's base.

    `start_rad` (5,) is the pose from which the first point is looked for, by the same steps. `newton_steps` = 0 is
    (5) as it is, which leaves an error of the order of a step's square. With `damping_m` = λ, a part of J of a σ below
    σ_0 = `damped_below_m` is inverted by J·Jᵀ + λ²(1 − (σ/σ_0)²), which limits the joints' speed and lets it lag.
    Where a step would turn a joint by more than `LARGEST_TURN_RAD`, the path ends: from there on all is NaN.

    Raises `CooperationError` for other shapes, and for points that are not finite.
    """
    start = checked_pose(arm, start_rad)
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise CooperationError(f"points have shape {points.shape}; must be (n, 3)")
    if not np.isfinite(points).all():
        raise CooperationError("a point of the path is not finite")
    path = np.full((len(points), arm.joint_count), np.nan)
    offsets = arm.offsets_rad
    first = tuple((start + np.array(offsets)).tolist()[:4])
    states = list(_steps(arm, first, points.tolist(), newton_steps, damping_m**2, damped_below_m))
    path[: len(states), :4] = np.array(states).reshape(-1, 4) - offsets[:4]
    path[: len(states), 4] = start[4]
    return path


def _steps(
    arm: FiveAxisArm, state: State, points: list[list[float]], newton_steps: int, damping: float, damped_below: float
) -> Iterator[State]:
    """θ₁ to θ₄ of every point, as long as there are any. Written out: this is all the time that a plan takes."""
    d1, a1, a2, a3, a4 = arm.d_m[0], *arm.a_m[:4]
    up, wrist = arm.waist_sign, arm.wrist_sign * arm.d_m[4]
    q1, q2, q3, q4 = state
    passes = range(1 + newton_steps)
    least, turn = CLOSE_ENOUGH_M, LARGEST_TURN_RAD
    has_moved = True
    for x, y, z in points:
        z = up * (z - d1)
        for done in passes:
            if has_moved:
                c1, s1, q23 = cos(q1), sin(q1), q2 + q3
                c234, s234 = cos(q23 + q4), sin(q23 + q4)
                # Joint 4's share of reach and height, then joint 3's and 2's with it: columns of J, 2 x 3, are (-h, r).
                r4, h4 = a4 * c234 + wrist * s234, a4 * s234 - wrist * c234
                r3, h3 = r4 + a3 * cos(q23), h4 + a3 * sin(q23)
                r2, h2 = r3 + a2 * cos(q2), h3 + a2 * sin(q2)
                distance = a1 + r2
            radial, across, height = c1 * x + s1 * y - distance, c1 * y - s1 * x, z - h2
            if done and -least < radial < least and -least < across < least and -least < height < least:
                has_moved = False
                break
            p, q, m = h2 * h2 + h3 * h3 + h4 * h4, r2 * r2 + r3 * r3 + r4 * r4, -(h2 * r2 + h3 * r3 + h4 * r4)
            square = distance * distance
            if damping:
                p_damped = _damping(damping, _least_root(p, q, m), damped_below)
                p, q = p + p_damped, q + p_damped
                square += _damping(damping, abs(distance), damped_below)
            determinant = p * q - m * m
            if determinant <= 0.0 or square <= 0.0:
                return
            u, v = (q * radial - m * height) / determinant, (p * height - m * radial) / determinant
            e1, e2, e3, e4 = across * distance / square, r2 * v - h2 * u, r3 * v - h3 * u, r4 * v - h4 * u
            if not (-turn < e1 < turn and -turn < e2 < turn and -turn < e3 < turn and -turn < e4 < turn):
                return
            q1, q2, q3, q4 = q1 + e1, q2 + e2, q3 + e3, q4 + e4
            has_moved = True
        yield q1, q2, q3, q4


def _least_root(p: float, q: float, m: float) -> float:
    """σ_min of a 2 × 3 matrix whose product with its transpose is ((p, m), (m, q))."""
    larger = (p + q) / 2 + sqrt(((p - q) / 2) ** 2 + m * m)
    return sqrt(max(p * q - m * m, 0.0) / larger) if larger else 0.0


def _damping(square: float, sigma: float, below: float) -> float:
    """What is added to J·Jᵀ; grows from 0, where σ is as large as `below`, to λ² where there is none."""
    share = sigma / below if below > 0.0 else inf
    return square * (1.0 - share * share) if share < 1.0 else 0.0
