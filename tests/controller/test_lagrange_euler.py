"""The closed form of two joints, derived by sympy from the paper's trace form (2-8) to (2-12)."""

from collections.abc import Callable

import numpy as np
import pytest
import sympy

from canarm_controller.dynamics import NominalArm, chain_of, lagrange_euler
from canarm_controller.errors import DynamicsError
from canarm_protocol.cell.cell_file import load_cell

KONKUK = load_cell("konkuk1").robot[0]
Q = sympy.Matrix([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
ANGLES = sympy.symbols("theta2 theta3")
SPEEDS = sympy.symbols("v2 v3")
MASSES = m2, m3 = sympy.symbols("m2 m3", positive=True)
LENGTHS = l2, l3 = sympy.symbols("l2 l3", positive=True)
CENTRES = sympy.symbols("x2 y2 x3 y3")
MOMENTS = sympy.symbols("i2 i3", positive=True)
PULL = sympy.symbols("gx gy")
Derived = tuple[sympy.Matrix, sympy.Matrix, sympy.Matrix]


def trace_form(inertias: list[sympy.Matrix], centres: list[sympy.Matrix], pull: sympy.Matrix) -> Derived:
    """D, H and G of two planar joints by the sums of (2-12), indices as they should be."""
    hops = [
        sympy.Matrix(
            [
                [sympy.cos(angle), -sympy.sin(angle), 0, length * sympy.cos(angle)],
                [sympy.sin(angle), sympy.cos(angle), 0, length * sympy.sin(angle)],
                [0, 0, 1, 0],
                [0, 0, 0, 1],
            ]
        )
        for angle, length in zip(ANGLES, LENGTHS, strict=True)
    ]

    def path(start: int, end: int) -> sympy.Matrix:
        return sympy.prod(hops[start:end], start=sympy.eye(4))

    def u(i: int, j: int) -> sympy.Matrix:
        return path(0, j) * Q * path(j, i + 1) if j <= i else sympy.zeros(4)

    def u2(i: int, j: int, k: int) -> sympy.Matrix:
        low, high = min(j, k), max(j, k)
        return path(0, low) * Q * path(low, high) * Q * path(high, i + 1) if high <= i else sympy.zeros(4)

    both = range(2)
    inertia = sympy.Matrix(2, 2, lambda i, k: sum((u(j, k) * inertias[j] * u(j, i).T).trace() for j in both))
    coriolis = sympy.Matrix(
        [
            sum(
                (u2(j, k, m) * inertias[j] * u(j, i).T).trace() * SPEEDS[k] * SPEEDS[m]
                for j in both
                for k in both
                for m in both
            )
            for i in both
        ]
    )
    gravity = sympy.Matrix([-sum(MASSES[j] * (pull * u(j, i) * centres[j])[0] for j in both) for i in both])
    return inertia, coriolis, gravity


def rods() -> Derived:
    """Uniform rods of length L on x in [-L, 0] of their own frame, upright: KON-KUK I as the paper takes it."""
    length, g = l2, sympy.Symbol("g")
    inertias = [
        sympy.Matrix([[m * length**2 / 3, 0, 0, -m * length / 2], [0] * 4, [0] * 4, [-m * length / 2, 0, 0, m]])
        for m in MASSES
    ]
    centre = sympy.Matrix([-length / 2, 0, 0, 1])
    parts = trace_form(inertias, [centre, centre], sympy.Matrix([[0, -g, 0, 0]]))
    return tuple(part.subs(l3, l2) for part in parts)  # type: ignore[return-value]


def test_rods_give_the_closed_form_of_the_paper_with_its_signs_put_right() -> None:
    inertia, coriolis, gravity = rods()
    (t2, t3), (v2, v3), length, g = ANGLES, SPEEDS, l2, sympy.Symbol("g")
    c2, c3, s3, c23 = sympy.cos(t2), sympy.cos(t3), sympy.sin(t3), sympy.cos(t2 + t3)
    square = length**2
    d22 = m2 * square / 3 + 4 * m3 * square / 3 + m3 * square * c3
    d23 = m3 * square / 3 + m3 * square * c3 / 2
    h2 = -m3 * square * s3 * v3**2 / 2 - m3 * square * s3 * v2 * v3
    h3 = m3 * square * s3 * v2**2 / 2
    g3 = m3 * g * length * c23 / 2
    g2 = m2 * g * length * c2 / 2 + g3 + m3 * g * length * c2
    assert sympy.simplify(inertia - sympy.Matrix([[d22, d23], [d23, m3 * square / 3]])) == sympy.zeros(2)
    assert sympy.simplify(coriolis - sympy.Matrix([h2, h3])) == sympy.zeros(2, 1)
    assert sympy.simplify(gravity - sympy.Matrix([g2, g3])) == sympy.zeros(2, 1)


def general_pair() -> Callable[..., list[np.ndarray]]:
    """D, H and G of any two planar links: centres off the axis, any moment of inertia, gravity askew."""
    centres = [sympy.Matrix([*CENTRES[i : i + 2], 0, 1]) for i in (0, 2)]
    inertias = [
        sympy.diag(moment / 2, moment / 2, 0, 0) + mass * centre * centre.T
        for mass, moment, centre in zip(MASSES, MOMENTS, centres, strict=True)
    ]
    parts = trace_form(inertias, centres, sympy.Matrix([[*PULL, 0, 0]]))
    symbols = [*MASSES, *LENGTHS, *CENTRES, *MOMENTS, *PULL, *ANGLES, *SPEEDS]
    return sympy.lambdify(symbols, [*parts], "numpy")  # type: ignore[no-any-return]


def test_the_closed_form_is_what_sympy_makes_of_the_trace_form() -> None:
    derived = general_pair()
    rng = np.random.default_rng(3)
    for _ in range(100):
        masses, lengths, moments = rng.uniform(0.1, 2.0, (3, 2))
        centres, pull = rng.uniform(-0.3, 0.3, 4), rng.uniform(-10.0, 10.0, 2)
        q, qd = rng.uniform(-np.pi, np.pi, 2), rng.uniform(-3.0, 3.0, 2)
        links = [
            KONKUK.joint[i].link.model_copy(
                update={
                    "a_m": lengths[i],
                    "mass_kg": masses[i],
                    "centre_of_mass_m": (*centres[2 * i : 2 * i + 2], 0.05),
                    "inertia_kg_m2": (moments[i] / 2, moments[i] / 2, moments[i]),
                }
            )
            for i in range(2)
        ]
        joints = tuple(joint.model_copy(update={"link": link}) for joint, link in zip(KONKUK.joint, links, strict=True))
        robot = KONKUK.model_copy(update={"joint": joints, "gravity_m_s2": (*pull, -3.0)})
        arm, chain = NominalArm.from_robot(robot), chain_of(robot)
        inertia, coriolis, gravity = derived(*masses, *lengths, *centres, *moments, *pull, *q, *qd)
        for closed, trace, expected in (
            (arm.inertia(q), lagrange_euler.inertia(chain, q), inertia),
            (arm.coriolis(q, qd), lagrange_euler.coriolis(chain, q, qd), coriolis.ravel()),
            (arm.gravity(q), lagrange_euler.gravity(chain, q), gravity.ravel()),
        ):
            size = np.abs(expected).max() + 1.0
            np.testing.assert_allclose(closed, expected, rtol=0.0, atol=1e-12 * size)
            np.testing.assert_allclose(trace, expected, rtol=0.0, atol=1e-12 * size)


def test_the_trace_form_refuses_a_state_that_does_not_fit() -> None:
    chain = chain_of(KONKUK)
    with pytest.raises(DynamicsError, match=r"q has shape \(3,\); must be \(2,\)"):
        lagrange_euler.inertia(chain, [0.0, 0.0, 0.0])
    with pytest.raises(DynamicsError, match="qd of joint3 = inf; must be finite"):
        lagrange_euler.coriolis(chain, [0.0, 0.0], [0.0, float("inf")])
