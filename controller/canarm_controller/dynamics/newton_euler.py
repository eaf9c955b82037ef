"""The Newton-Euler recursion of a chain, written once and recorded on a tape for every quantity that is asked for.

Owns the recursion and the programs for torque, inertia, Coriolis and gravity. Like the Lagrange-Euler form it works on
the paper's pseudo-inertia J_i, so that both share the input and nothing else. Source text, numpy and checks of states
must not enter.

Everything about link i is written in a frame that sits on the axis of joint i and turns with the link: there the joint
axis is z, its rotation costs four products, and what comes after it (d, a, α) is constant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .chain import Chain, ChainLink, Floats
from .tape import Program, Tape, Value, cos_sin, cos_sin_by_tangent, tanh

Triple = tuple[Value, Value, Value]
Turn = tuple[Value, Value]
ZERO: Triple = (0.0, 0.0, 0.0)
GROUND = ChainLink("ground", 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""What joint 1 sits on. It is accelerated against gravity, which gives every link its weight."""


@dataclass(frozen=True, slots=True)
class DriveTerms:
    """What the drives add to the torque, one entry a joint: J·q̈ + Fv·q̇ + Fc·tanh(q̇/v_s)."""

    rotor_inertia_kg_m2: Sequence[float]
    viscous_nm_s: Sequence[float]
    coulomb_nm: Sequence[float]
    smoothing_rad_s: float

    def torque(self, joint: int, speed: Value, acceleration: Value) -> Value:
        """Torque of one joint's drive, N·m."""
        coulomb = self.coulomb_nm[joint] * tanh(speed * (1.0 / self.smoothing_rad_s))
        return self.rotor_inertia_kg_m2[joint] * acceleration + self.viscous_nm_s[joint] * speed + coulomb


def torque_program(chain: Chain, drive: DriveTerms | None = None, for_batch: bool = False) -> Program:
    """τ(q, q̇, q̈) in N·m, with the drives if given; `for_batch` takes cosine and sine the way that suits numpy."""
    tape, count = Tape(), len(chain.links)
    q, qd, qdd = tape.inputs(count), tape.inputs(count), tape.inputs(count)
    turn = cos_sin_by_tangent if for_batch else cos_sin
    torques = joint_torques(chain, q, qd, qdd, chain.gravity_m_s2, turn)
    if drive:
        torques = [t + drive.torque(i, qd[i], qdd[i]) for i, t in enumerate(torques)]
    return Program({"q": q, "qd": qd, "qdd": qdd}, tuple(torques))


def gravity_program(chain: Chain) -> Program:
    """G(q) in N·m: the recursion at rest."""
    q, rest = Tape().inputs(len(chain.links)), [0.0] * len(chain.links)
    return Program({"q": q}, tuple(joint_torques(chain, q, rest, rest, chain.gravity_m_s2)))


def coriolis_program(chain: Chain) -> Program:
    """H(q, q̇) in N·m: the recursion without weight and acceleration."""
    tape, count = Tape(), len(chain.links)
    q, qd = tape.inputs(count), tape.inputs(count)
    return Program({"q": q, "qd": qd}, tuple(joint_torques(chain, q, qd, [0.0] * count, (0.0, 0.0, 0.0))))


def inertia_program(chain: Chain) -> Program:
    """D(q) in kg·m², row by row: column k is the torque of q̈_k = 1 alone, from the diagonal down."""
    count = len(chain.links)
    q, rest = Tape().inputs(count), [0.0] * count
    columns = [
        joint_torques(chain, q, rest, [float(i == k) for i in range(count)], (0.0, 0.0, 0.0)) for k in range(count)
    ]
    return Program({"q": q}, tuple(columns[min(i, k)][max(i, k)] for i in range(count) for k in range(count)))


def joint_torques(
    chain: Chain,
    q: Sequence[Value],
    qd: Sequence[Value],
    qdd: Sequence[Value],
    gravity: Sequence[float],
    turn: Callable[[Value], Turn] = cos_sin,
) -> list[Value]:
    """Torques about the joint axes: outwards the motion of every link, inwards the forces that it takes.

    With r a homogeneous point of link i, its acceleration is W·r, W = [ω̇× + ω×ω× | a] (3 × 4). So ∫ (W r) rᵀ dm = W·J_i
    holds both the force (last column) and, in its skew part, the moment about the frame's origin.
    """
    turns = [turn(angle + link.theta_offset_rad) for link, angle in zip(chain.links, q, strict=True)]
    spin, spin_rate = ZERO, ZERO
    motion = _motion(ZERO, ZERO, (-gravity[0], -gravity[1], -gravity[2]))
    loads: list[tuple[Triple, Triple]] = []
    befores = (GROUND, *chain.links[:-1])
    for i, (before, inertia) in enumerate(zip(befores, lumped_inertias(chain), strict=True)):
        origin = _apply(motion, (before.a_m, 0.0, before.d_m, 1.0))
        spin, spin_rate, origin = (_unturn(turns[i], _untwist(before, vector)) for vector in (spin, spin_rate, origin))
        spin_rate = (spin_rate[0] + spin[1] * qd[i], spin_rate[1] - spin[0] * qd[i], spin_rate[2] + qdd[i])
        spin = (spin[0], spin[1], spin[2] + qd[i])
        motion = _motion(spin, spin_rate, origin)
        x, y, z, force = (_apply(motion, column) for column in inertia.T.tolist())
        loads.append((force, (y[2] - z[1], z[0] - x[2], x[1] - y[0])))
    return _inwards(chain, turns, loads)


def lumped_inertias(chain: Chain) -> list[Floats]:
    """J_i of every link in the frame on its own joint's axis, 4 × 4, with as many zeros as the arm allows.

    Mass on a joint's own axis does not notice that joint's motion, so it may as well be part of the link before. Moved
    there link by link, tip to base, it leaves m, m·c_z and ∫z² dm at zero, and their products out of the program.
    """
    lumped: list[Floats] = []
    from_tip = np.zeros((4, 4))
    for link in reversed(chain.links):
        twist = link.twist()
        own = twist @ (link.pseudo_inertia() + from_tip) @ twist.T
        from_tip = np.zeros((4, 4))
        from_tip[2:, 2:] = own[2:, 2:]
        lumped.append(own - from_tip)
    return lumped[::-1]


def _inwards(chain: Chain, turns: Sequence[Turn], loads: Sequence[tuple[Triple, Triple]]) -> list[Value]:
    torques: list[Value] = []
    force, moment = ZERO, ZERO
    for i in reversed(range(len(loads))):
        own_force, own_moment = loads[i]
        if i + 1 < len(loads):
            link = chain.links[i]
            force, moment = (
                _twist(link, _turn_back(turns[i + 1], force)),
                _twist(link, _turn_back(turns[i + 1], moment)),
            )
            lever = (-link.d_m * force[1], link.d_m * force[0] - link.a_m * force[2], link.a_m * force[1])
            moment = _plus(moment, lever)
        force, moment = _plus(own_force, force), _plus(own_moment, moment)
        torques.append(moment[2])
    return torques[::-1]


def _motion(w: Triple, dw: Triple, a: Triple) -> tuple[tuple[Value, ...], ...]:
    """[ω̇× + ω×ω× | a], 3 × 4."""
    xx, yy, zz = w[0] * w[0], w[1] * w[1], w[2] * w[2]
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    return (
        (-(yy + zz), xy - dw[2], xz + dw[1], a[0]),
        (xy + dw[2], -(xx + zz), yz - dw[0], a[1]),
        (xz - dw[1], yz + dw[0], -(xx + yy), a[2]),
    )


def _apply(matrix: Sequence[Sequence[Value]], vector: Sequence[float]) -> Triple:
    x, y, z = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] + row[3] * vector[3] for row in matrix)
    return x, y, z


def _plus(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _unturn(turn: Turn, v: Triple) -> Triple:
    """Rz(θ)ᵀ·v: into the frame that the joint has turned."""
    c, s = turn
    return c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]


def _turn_back(turn: Turn, v: Triple) -> Triple:
    c, s = turn
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


def _untwist(link: ChainLink, v: Triple) -> Triple:
    """Rx(α)ᵀ·v: into the link's far frame."""
    c, s = link.cos_alpha, link.sin_alpha
    return v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]


def _twist(link: ChainLink, v: Triple) -> Triple:
    c, s = link.cos_alpha, link.sin_alpha
    return v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]
