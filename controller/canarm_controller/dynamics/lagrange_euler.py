"""The Lagrange-Euler equations of the KON-KUK I paper, corrected: the reference for every faster form.

Has U_ij, U_ijk and the traces of (2-8), (2-10) and (2-12) for any chain, one line of code per formula, in plain numpy.
It is not optimised: 5 joints take milliseconds. docs/dynamics-errata.md lists the misprints.
"""

from collections.abc import Sequence

import numpy as np

from .chain import Chain, ChainLink, Floats
from .checks import check_state

Q = np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], dtype=np.float64)
"""Q of a revolute joint (2-5): ∂A/∂θ = Q·A, because Rz(θ) comes first in A."""


def link_transform(link: ChainLink, angle_rad: float) -> Floats:
    """A_{i-1}^i of (2-1): link frame i seen from frame i-1, 4 × 4, lengths in m."""
    angle = angle_rad + link.theta_offset_rad
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return np.asarray(turn @ link.twist())


class Pose:
    """The matrices of (2-8) and (2-10) for one set of joint angles (rad). Joints count from 0, unlike in the paper."""

    def __init__(self, chain: Chain, q: Sequence[float]) -> None:
        self._hops = [link_transform(link, angle) for link, angle in zip(chain.links, q, strict=True)]

    def transform(self, start: int, end: int) -> Floats:
        """The link frame that joint `end` - 1 moves, seen from the frame before joint `start`."""
        result = np.eye(4)
        for hop in self._hops[start:end]:
            result = result @ hop
        return result

    def u(self, i: int, j: int) -> Floats:
        """U_ij = ∂A_0^i/∂q_j = A_0^{j-1}·Q·A_{j-1}^i, zero for j > i."""
        if j > i:
            return np.zeros((4, 4))
        return self.transform(0, j) @ Q @ self.transform(j, i + 1)

    def u2(self, i: int, j: int, k: int) -> Floats:
        """U_ijk = ∂U_ij/∂q_k = A_0^{l-1}·Q·A_{l-1}^{h-1}·Q·A_{h-1}^i with l, h the lower and higher of j and k."""
        low, high = min(j, k), max(j, k)
        if high > i:
            return np.zeros((4, 4))
        return self.transform(0, low) @ Q @ self.transform(low, high) @ Q @ self.transform(high, i + 1)


def inertia(chain: Chain, q: Sequence[float]) -> Floats:
    """D(q) in kg·m², (n, n): D_ik = Σ_{j ≥ max(i,k)} Tr(U_jk·J_j·U_jiᵀ).

    This and the functions below take joint angles in rad, (n,), speeds in rad/s and accelerations in rad/s², and raise
    `DynamicsError` for another length or a value that is not finite.
    """
    check_state(chain.joint_names, q=q)
    pose, count = Pose(chain, q), len(chain.links)
    result = np.zeros((count, count))
    for i, k, j in np.ndindex(count, count, count):
        result[i, k] += np.trace(pose.u(j, k) @ chain.links[j].pseudo_inertia() @ pose.u(j, i).T)
    return result


def coriolis(chain: Chain, q: Sequence[float], qd: Sequence[float]) -> Floats:
    """H(q, q̇) in N·m, (n,): H_i = Σ_j Σ_k Σ_m Tr(U_jkm·J_j·U_jiᵀ)·q̇_k·q̇_m."""
    check_state(chain.joint_names, q=q, qd=qd)
    pose, count = Pose(chain, q), len(chain.links)
    result = np.zeros(count)
    for j in range(count):
        rate = np.zeros((4, 4))
        for k, m in np.ndindex(j + 1, j + 1):
            rate += pose.u2(j, k, m) * (qd[k] * qd[m])
        for i in range(j + 1):
            result[i] += np.trace(rate @ chain.links[j].pseudo_inertia() @ pose.u(j, i).T)
    return result


def gravity(chain: Chain, q: Sequence[float]) -> Floats:
    """G(q) in N·m, (n,): G_i = −Σ_j m_j·g·U_ji·r̄_j with the row vector g = (gx, gy, gz, 0)."""
    check_state(chain.joint_names, q=q)
    pose, count = Pose(chain, q), len(chain.links)
    downward = np.array([*chain.gravity_m_s2, 0.0])
    result = np.zeros(count)
    for i, j in np.ndindex(count, count):
        link = chain.links[j]
        result[i] -= link.mass_kg * downward @ pose.u(j, i) @ np.array([*link.centre_m, 1.0])
    return result


def joint_torques(chain: Chain, q: Sequence[float], qd: Sequence[float], qdd: Sequence[float]) -> Floats:
    """τ = D(q)·q̈ + H(q, q̇) + G(q) in N·m, (n,): (2-12) and (2-13) of the links alone, without drives."""
    check_state(chain.joint_names, q=q, qd=qd, qdd=qdd)
    return inertia(chain, q) @ np.asarray(qdd, dtype=np.float64) + coriolis(chain, q, qd) + gravity(chain, q)
