"""The Newton-Euler recursion of a chain, written once and recorded on a tape for every quantity that is asked for.

Owns the recursion and the programs for torque, inertia, Coriolis and gravity. Like the Lagrange-Euler form it works on
the paper's pseudo-inertia J_i, so that both share the input and nothing else. Source text, numpy and checks of states
must not enter.

Link i is described in a frame on the axis of joint i that turns with the link: the joint axis is z there, its rotation
costs four products, and the rest (d, a, α) is constant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .chain import Chain, ChainLink, Floats
from .forward import solution_terms
from .tape import Program, Tape, Value, cos_sin, cos_sin_by_tangent, tanh

Triple = tuple[Value, Value, Value]
Turn = tuple[Value, Value]
Inertia = Sequence[Sequence[Value]]
Motion = tuple[tuple[Value, ...], tuple[Value, ...], tuple[Value, ...]]
ZERO: Triple = (0.0, 0.0, 0.0)
GROUND = ChainLink("ground", 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
"""The base of joint 1. It is accelerated against gravity, which gives every link its weight."""


@dataclass(frozen=True, slots=True)
class DriveTerms:
    """What the drives add to the torque, one entry per joint: J·q̈ + Fv·q̇ + Fc·tanh(q̇/v_s)."""

    rotor_inertia_kg_m2: Sequence[Value]
    viscous_nm_s: Sequence[Value]
    coulomb_nm: Sequence[Value]
    smoothing_rad_s: float

    def torque(self, joint: int, speed: Value, acceleration: Value, sliding: Value | None = None) -> Value:
        """Torque of one joint's drive, N·m; Coulomb friction by the sign of `sliding` where that is not `speed`."""
        slides = speed if sliding is None else sliding
        coulomb = self.coulomb_nm[joint] * tanh(slides * (1.0 / self.smoothing_rad_s))
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
    """D(q) in kg·m², row by row."""
    q = Tape().inputs(len(chain.links))
    turns = turns_of(chain, q)
    rows = inertia_terms(chain, turns, [inertia.tolist() for inertia in lumped_inertias(chain)])
    return Program({"q": q}, tuple(value for row in rows for value in row))


def acceleration_program(chain: Chain, drive: DriveTerms) -> Program:
    """q̈ in rad/s² under the drives' torques; then the diagonal of D, rotors included, and its pivots."""
    tape, count = Tape(), len(chain.links)
    q, qd, torque = tape.inputs(count), tape.inputs(count), tape.inputs(count)
    inertias = [inertia.tolist() for inertia in lumped_inertias(chain)]
    results = acceleration_terms(chain, q, qd, torque, inertias, drive)
    return Program({"q": q, "qd": qd, "torque_nm": torque}, results)


def acceleration_terms(
    chain: Chain,
    q: Sequence[Value],
    qd: Sequence[Value],
    torque_nm: Sequence[Value],
    inertias: Sequence[Inertia],
    drive: DriveTerms,
) -> tuple[Value, ...]:
    """The terms of `acceleration_program`, for any J_i of the links on their joints' axes."""
    count = len(chain.links)
    turns, rest = turns_of(chain, q), [0.0] * count
    still = torques_of(chain, turns, motions(chain, turns, qd, rest, chain.gravity_m_s2), inertias)
    rows = inertia_terms(chain, turns, inertias)
    for i, row in enumerate(rows):
        row[i] = row[i] + drive.rotor_inertia_kg_m2[i]
    left = [torque_nm[i] - (still[i] + drive.torque(i, qd[i], 0.0)) for i in range(count)]
    solution, pivots = solution_terms(rows, left)
    return (*solution, *(row[i] for i, row in enumerate(rows)), *pivots)


def joint_torques(
    chain: Chain,
    q: Sequence[Value],
    qd: Sequence[Value],
    qdd: Sequence[Value],
    gravity: Sequence[float],
    turn: Callable[[Value], Turn] = cos_sin,
) -> list[Value]:
    """Torques about the joint axes: outwards the motion of every link, inwards the forces that it takes."""
    turns = turns_of(chain, q, turn)
    inertias = [inertia.tolist() for inertia in lumped_inertias(chain)]
    return torques_of(chain, turns, motions(chain, turns, qd, qdd, gravity), inertias)


def turns_of(chain: Chain, q: Sequence[Value], turn: Callable[[Value], Turn] = cos_sin) -> list[Turn]:
    """Cosine and sine of each joint's angle, its offset included."""
    return [turn(angle + link.theta_offset_rad) for link, angle in zip(chain.links, q, strict=True)]


def motions(
    chain: Chain,
    turns: Sequence[Turn],
    qd: Sequence[Value],
    qdd: Sequence[Value],
    gravity: Sequence[float],
    qd_r: Sequence[Value] | None = None,
) -> list[Motion]:
    """Acceleration of every link: that of the point r (homogeneous, on the joint's axis) is W·r, W 3 × 4.

    W = [ω̇× + ω×ω× | a]. With a reference speed `qd_r` every product of two speeds is halved between q̇·q̇_r and q̇_r·q̇:
    the Coriolis matrix of the Christoffel symbols, C(q, q̇)·q̇_r, for which Ḋ − 2C is skew-symmetric.
    """
    spin, spin_r, spin_rate = ZERO, ZERO, ZERO
    motion = _motion(ZERO, ZERO, ZERO, (-gravity[0], -gravity[1], -gravity[2]))
    found: list[Motion] = []
    for i, before in enumerate((GROUND, *chain.links[:-1])):
        origin = _apply(motion, (before.a_m, before.b_m, before.d_m, 1.0))
        spin, spin_rate, origin = (_unturn(turns[i], _untwist(before, vector)) for vector in (spin, spin_rate, origin))
        spin_r = spin if qd_r is None else _unturn(turns[i], _untwist(before, spin_r))
        across = _mixed(spin, spin_r, qd[i], qd[i] if qd_r is None else qd_r[i])
        spin_rate = (spin_rate[0] + across[0], spin_rate[1] - across[1], spin_rate[2] + qdd[i])
        spin = (spin[0], spin[1], spin[2] + qd[i])
        spin_r = spin if qd_r is None else (spin_r[0], spin_r[1], spin_r[2] + qd_r[i])
        motion = _motion(spin, spin_r, spin_rate, origin)
        found.append(motion)
    return found


def sweeps(chain: Chain, turns: Sequence[Turn], qd: Sequence[Value]) -> list[Motion]:
    """Velocity of every link at the joint speeds `qd`: that of the point r is S·r, S = [ω× | v], 3 × 4."""
    spin, speed = ZERO, ZERO
    found: list[Motion] = []
    for i, before in enumerate((GROUND, *chain.links[:-1])):
        reach = before.a_m, before.b_m, before.d_m
        speed = _plus(speed, _cross(spin, reach))
        spin, speed = (_unturn(turns[i], _untwist(before, vector)) for vector in (spin, speed))
        spin = (spin[0], spin[1], spin[2] + qd[i])
        found.append(
            (
                (0.0, -spin[2], spin[1], speed[0]),
                (spin[2], 0.0, -spin[0], speed[1]),
                (-spin[1], spin[0], 0.0, speed[2]),
            )
        )
    return found


def torques_of(
    chain: Chain, turns: Sequence[Turn], moved: Sequence[Motion], inertias: Sequence[Inertia]
) -> list[Value]:
    """Torques about the axes from the `motions` of links whose J_i, 4 × 4 and symmetric, are on their joints' axes.

    ∫ (W r) rᵀ dm = W·J_i holds both the force (last column) and, in its skew part, the moment about the frame's origin.
    """
    loads: list[tuple[Triple, Triple]] = []
    for motion, inertia in zip(moved, inertias, strict=True):
        x, y, z, force = (_apply(motion, column) for column in inertia)
        loads.append((force, (y[2] - z[1], z[0] - x[2], x[1] - y[0])))
    return _inwards(chain, turns, loads)


def inertia_terms(chain: Chain, turns: Sequence[Turn], inertias: Sequence[Inertia]) -> list[list[Value]]:
    """D(q) from the J_i of the links, on their joints' axes: composite bodies, tip to base (Walker and Orin 1982).

    If only joint i accelerates, its composite body turns about its axis; the torques at the axes before it are column
    i.
    """
    count = len(chain.links)
    result: list[list[Value]] = [[0.0] * count for _ in range(count)]
    composite: Inertia = [[0.0] * 4 for _ in range(4)]
    for i in reversed(range(count)):
        if i + 1 < count:
            composite = _carried(chain.links[i], turns[i + 1], composite)
        composite = [
            [own + out for own, out in zip(*rows, strict=True)] for rows in zip(inertias[i], composite, strict=True)
        ]
        xx, yy = composite[0][0], composite[1][1]
        force: Triple = (-composite[1][3], composite[0][3], 0.0)
        moment: Triple = (-composite[0][2], -composite[1][2], xx + yy)
        result[i][i] = moment[2]
        for k in reversed(range(i)):
            force, moment = _inward(chain.links[k], turns[k + 1], force, moment)
            result[i][k] = result[k][i] = moment[2]
    return result


def _carried(link: ChainLink, turn: Turn, inertia: Inertia) -> Inertia:
    """J of what comes after `link`, its axis turned by `turn`, on the axis of `link`: A·J·Aᵀ with A = T·Rx(α)·Rz(θ)."""
    c, s = turn
    rotation = (
        (c, -s, 0.0),
        (link.cos_alpha * s, link.cos_alpha * c, -link.sin_alpha),
        (link.sin_alpha * s, link.sin_alpha * c, link.cos_alpha),
    )
    reach = (link.a_m, link.b_m, link.d_m)
    half = [[*(_dot(row, column[:3]) for column in zip(*inertia[:3], strict=True))] for row in rotation]
    for row, by in zip(half, reach, strict=True):
        for k in range(4):
            row[k] = row[k] + by * inertia[3][k]
    half.append(list(inertia[3]))
    whole: list[list[Value]] = [[0.0] * 4 for _ in range(4)]
    for i in range(4):
        for k in range(i, 4):
            value = _dot(rotation[k], half[i][:3]) + half[i][3] * reach[k] if k < 3 else half[i][3]
            whole[i][k] = whole[k][i] = value
    return whole


def lumped_inertias(chain: Chain) -> list[Floats]:
    """J_i of every link in the frame on its own joint's axis, 4 × 4, with as many zeros as the arm allows.

    Mass on a joint's own axis is not affected by that joint's motion, so it may be moved to the link before. Done link
    by link, tip to base, this makes m, m·c_z and ∫z² dm zero, and removes their products from the program.
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
            force, moment = _inward(chain.links[i], turns[i + 1], force, moment)
        force, moment = _plus(own_force, force), _plus(own_moment, moment)
        torques.append(moment[2])
    return torques[::-1]


def _inward(link: ChainLink, turn: Turn, force: Triple, moment: Triple) -> tuple[Triple, Triple]:
    """A force and moment on the axis after `link`, turned by `turn`, on the axis of `link`."""
    force, moment = _twist(link, _turn_back(turn, force)), _twist(link, _turn_back(turn, moment))
    return force, _plus(moment, _cross((link.a_m, link.b_m, link.d_m), force))


def _motion(w: Triple, w_r: Triple, dw: Triple, a: Triple) -> Motion:
    """[ω̇× + ½(ω×ω_r× + ω_r×ω×) | a], 3 × 4."""
    xx, yy, zz = w[0] * w_r[0], w[1] * w_r[1], w[2] * w_r[2]
    xy, xz, yz = (_half_sum(w[i], w_r[i], w[k], w_r[k]) for i, k in ((0, 1), (0, 2), (1, 2)))
    return (
        (-(yy + zz), xy - dw[2], xz + dw[1], a[0]),
        (xy + dw[2], -(xx + zz), yz - dw[0], a[1]),
        (xz - dw[1], yz + dw[0], -(xx + yy), a[2]),
    )


def _mixed(w: Triple, w_r: Triple, qd: Value, qd_r: Value) -> tuple[Value, Value]:
    """The components of ω × z·q̇ along x and against y, halved as in `motions`."""
    return _half_sum(w[1], w_r[1], qd, qd_r), _half_sum(w[0], w_r[0], qd, qd_r)


def _half_sum(first: Value, first_r: Value, second: Value, second_r: Value) -> Value:
    """½(first·second_r + first_r·second); the plain product where both are one."""
    if first is first_r and second is second_r:
        return first * second
    return 0.5 * (first * second_r + first_r * second)


def _apply(matrix: Motion, vector: Sequence[Value]) -> Triple:
    x, y, z = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] + row[3] * vector[3] for row in matrix)
    return x, y, z


def _dot(a: Sequence[Value], b: Sequence[Value]) -> Value:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


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
