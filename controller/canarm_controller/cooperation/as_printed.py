"""STEPs 1 to 3 as the paper prints them, for comparison. Nothing else uses them.

They lead to a_s = ±o_o whatever the slave's base is, because turning about o_o (STEP 1) cannot take a_o × n_1 (STEP 2)
away from it. So the slave can take the pose only where o_o happens to lie in its plane; elsewhere it misses by a yaw.
"""

from typing import NamedTuple

import numpy as np

from .kinematics import Floats


class PrintedSteps(NamedTuple):
    """T_s1, T_s2 and T_s3 (..., 4, 4) seen from the slave's base, θ1s (...) of STEP 1 in rad, and the yaw (...) in rad
    by which a_s stands out of the plane in which the slave can point.
    """

    first: Floats
    second: Floats
    third: Floats
    theta_1s_rad: Floats
    yaw_rad: Floats


def printed_steps(seen: Floats, normal: int = 1) -> PrintedSteps:
    """The three steps for object frames (..., 4, 4) seen from the slave's base, with +a_o or −a_o in (12).

    Of the two turns of STEP 1, the one after which the hand points away from the slave's base. a_2 of (8) is brought to
    length 1, which the paper leaves out. NaN where STEP 1 has no turn: a_o and n_o lie in the slave's plane both, or B
    on its axis.
    """
    n_o, o_o, a_o, p = (seen[..., :3, column] for column in range(4))
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.hypot(p[..., 0], p[..., 1])
        out = np.stack([p[..., 0] / rho, p[..., 1] / rho, np.zeros_like(rho)], axis=-1)
    h = np.stack([-out[..., 1], out[..., 0], np.zeros_like(rho)], axis=-1)
    # T_s1 = o*·Rot(y, θ1s) has a_1 = n_o·sin + a_o·cos, and a_1·h = 0.
    theta = np.arctan2(-_dot(a_o, h), _dot(n_o, h))
    undefined = np.hypot(_dot(a_o, h), _dot(n_o, h)) < 1e-12
    points_in = np.cos(theta) * _dot(o_o, out) < 0.0  # a_2 of (8) will be o_o·cos θ
    theta = np.where(undefined, np.nan, np.where(points_in, theta + np.pi, theta))
    first = seen @ _rotation("y", theta)
    # (8): a_2 = a_o × n_1 is to be the third axis of T_s2 = T_s1·Rot(x, θk2).
    crossed = np.cross(a_o, first[..., :3, 0])
    a_2 = crossed / np.linalg.norm(crossed, axis=-1, keepdims=True)
    second = first @ _rotation("x", np.arctan2(-_dot(a_2, first[..., :3, 1]), _dot(a_2, first[..., :3, 2])))
    # (11), (12): the first axis of T_s3 = T_s2·Rot(z, θk3) is ±a_o.
    aim = normal * a_o
    third = second @ _rotation("z", np.arctan2(_dot(aim, second[..., :3, 1]), _dot(aim, second[..., :3, 0])))
    return PrintedSteps(first, second, third, theta, np.arcsin(np.clip(np.abs(_dot(third[..., :3, 2], h)), 0.0, 1.0)))


def _rotation(axis: str, angle: Floats) -> Floats:
    """Rot(axis, angle) of the paper, (..., 4, 4)."""
    turn = np.zeros((*angle.shape, 4, 4))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    turn[...] = np.eye(4)
    turn[..., i, i] = turn[..., j, j] = np.cos(angle)
    turn[..., j, i] = np.sin(angle)
    turn[..., i, j] = -np.sin(angle)
    return turn


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=-1))
