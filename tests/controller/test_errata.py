"""Every row of docs/dynamics-errata.md: what the paper prints is wrong, and what stands beside it is right.

The measure is never the trace form itself but derivatives of the arm's geometry, or energies summed over its points.
"""

import dataclasses
from math import cos, pi, sin

import numpy as np
import pytest
import sympy

from canarm_controller.dynamics import chain_of, lagrange_euler
from canarm_controller.dynamics.chain import Chain, ChainLink
from canarm_controller.dynamics.lagrange_euler import Pose, Q, link_transform
from canarm_controller.reference.memory import SAMPLES, TABLE_BASE, MemoryImage
from canarm_protocol.cards.kind import highest_code
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.sensing import joint_sensors

CELL = load_cell("konkuk1")
RODS = chain_of(CELL.robot[0])
M2, M3, L, GRAVITY = 1.0, 0.6, 0.18, 9.8062
TWISTED = Chain(
    "twisted",
    tuple(
        ChainLink(
            f"axis{i + 1}",
            a_m=0.3 - 0.1 * i,
            b_m=0.0,
            d_m=0.1 * i,
            cos_alpha=cos(twist),
            sin_alpha=sin(twist),
            theta_offset_rad=0.2 * i,
            mass_kg=1.0 + i,
            centre_m=centre,
            inertia_kg_m2=(*moments, 0.0, 0.0, 0.0),
        )
        for i, (twist, centre, moments) in enumerate(
            [
                (0.7, (-0.1, 0.02, 0.03), (0.01, 0.02, 0.025)),
                (-pi / 2, (0.05, -0.1, 0.0), (0.03, 0.02, 0.02)),
                (0.3, (0.0, 0.04, -0.06), (0.02, 0.03, 0.04)),
            ]
        )
    ),
    (1.0, -3.0, -9.0),
)
POSES = np.random.default_rng(5).uniform(-pi, pi, (200, 3))


def derivative(function: object, q: np.ndarray, joint: int) -> np.ndarray:
    """∂/∂q_joint of a matrix or number, by Richardson's extrapolation: good to 1e-10."""

    def difference(step: float) -> np.ndarray:
        ahead, behind = q.copy(), q.copy()
        ahead[joint] += step
        behind[joint] -= step
        return (np.asarray(function(ahead)) - np.asarray(function(behind))) / (2 * step)  # type: ignore[operator]

    return (4 * difference(5e-4) - difference(1e-3)) / 3


def is_close(a: object, b: object, tolerance: float = 1e-8) -> bool:
    return bool(np.allclose(np.asarray(a, dtype=float), np.asarray(b, dtype=float), rtol=0.0, atol=tolerance))


def mean_rod_points(q2: float, q3: float) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Mass, place in the plane and Jacobian of points that weigh, balance and turn like the two rods.

    Simpson's rule (1/6, 4/6, 1/6 of the mass at both ends and the middle) is exact up to cubes: 1/3·m·L² included.
    """
    first = L * np.array([cos(q2), sin(q2)])
    second = L * np.array([cos(q2 + q3), sin(q2 + q3)])
    turned1, turned2 = np.array([-first[1], first[0]]), np.array([-second[1], second[0]])
    nothing = np.zeros(2)
    points = []
    for weight, along in ((1 / 6, 0.0), (4 / 6, 0.5), (1 / 6, 1.0)):
        points.append((M2 * weight, along * first, np.stack([along * turned1, nothing], axis=1)))
        outer = along * turned2
        points.append((M3 * weight, first + along * second, np.stack([turned1 + outer, outer], axis=1)))
    return points


def rod_inertia(q: np.ndarray) -> np.ndarray:
    return sum((mass * jacobian.T @ jacobian for mass, _, jacobian in mean_rod_points(*q)), np.zeros((2, 2)))


def rod_gravity(q: np.ndarray) -> np.ndarray:
    return sum((mass * GRAVITY * jacobian[1] for mass, _, jacobian in mean_rod_points(*q)), np.zeros(2))


def rod_coriolis(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Ḋ·q̇ − ½ ∂(q̇ᵀDq̇)/∂q: Lagrange's equations for the energies summed over the points."""
    slopes = [derivative(rod_inertia, q, joint) for joint in range(2)]
    rate = slopes[0] * qd[0] + slopes[1] * qd[1]
    return np.asarray(rate @ qd - np.array([0.5 * qd @ slope @ qd for slope in slopes]))


def rod_states() -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(6)
    return list(zip(rng.uniform(-pi, pi, (50, 2)), rng.uniform(-2.5, 2.5, (50, 2)), strict=True))


def test_printed_link_transform_is_no_rotation_and_the_right_one_is_four_plain_motions() -> None:
    angle, a, d, twist = 0.6, 0.3, 0.1, 0.7
    c, s, ca, sa = cos(angle), sin(angle), cos(twist), sin(twist)
    printed = np.array([[c, -s, sa, a * c], [s, c, -sa, a * s], [0, 0, ca, d], [0, 0, 0, 1]])
    assert not is_close(printed[:3, :3] @ printed[:3, :3].T, np.eye(3), 0.1)
    right = [[c, -ca * s, sa * s, a * c], [s, ca * c, -sa * c, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    rise = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
    shift = np.array([[1, 0, 0, a], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    bend = np.array([[1, 0, 0, 0], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
    link = ChainLink("axis", a, 0.0, d, ca, sa, 0.0, 1.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    assert is_close(right, turn @ rise @ shift @ bend, 1e-15)
    assert is_close(right, link_transform(link, angle), 1e-15)


def test_q_gives_the_derivative_of_the_transform_that_its_own_joint_turns() -> None:
    """Read as it stands, (2-6) puts Q before A of the joint before."""
    for q in POSES[:20]:
        for i in (1, 2):
            slope = derivative(lambda q, i=i: link_transform(TWISTED.links[i], q[i]), q, i)
            assert is_close(slope, Q @ link_transform(TWISTED.links[i], q[i]))
            assert not is_close(slope, Q @ link_transform(TWISTED.links[i - 1], q[i - 1]))


def test_second_derivatives_are_taken_by_angle_and_vanish_beyond_the_link() -> None:
    """The paper prints ∂/∂R_k and zero for i > k. U_321 is not zero although 3 > 1, and U_112 is although 1 < 2."""
    for q in POSES[:20]:
        pose = Pose(TWISTED, q)
        for i, j, k in np.ndindex(3, 3, 3):
            slope = derivative(lambda q, i=i, j=j: Pose(TWISTED, q).u(i, j), q, k)
            assert is_close(slope, pose.u2(i, j, k))
            assert is_close(slope, 0.0) == (i < j or i < k)


def rod_second_moments() -> np.ndarray:
    """∫ r rᵀ dm of a rod of 1 kg on x ∈ [−L, 0], integrated."""
    x = sympy.Symbol("x")
    point = sympy.Matrix([x, 0, 0, 1])
    return np.array((point * point.T / L).integrate((x, -L, 0)).tolist(), dtype=float)


def test_inertia_about_the_origin_must_not_be_shifted_again() -> None:
    """The rod's moment about its end holds the ¼·m·L² of its centre already; the paper adds it a second time."""
    about_end = np.array([0.0, L**2 / 3, L**2 / 3])
    about_centre = np.array([0.0, L**2 / 12, L**2 / 12])
    offset = (-L / 2) ** 2
    of_moments = np.array([-1, 1, 1]) / 2
    right = rod_second_moments()
    assert right[0, 0] == pytest.approx(L**2 / 3)
    assert of_moments @ about_end + offset == pytest.approx(7 / 12 * L**2)  # as printed
    assert of_moments @ about_end == pytest.approx(right[0, 0])
    assert of_moments @ about_centre + offset == pytest.approx(right[0, 0])


def test_central_inertia_needs_the_products_of_the_centre_too() -> None:
    """The paper shifts the diagonal alone. Two points of 1 kg at (1, 1, 0) and (3, 2, 0): Σ m·x·y = 7."""
    points = np.array([[1.0, 1.0, 0.0, 1.0], [3.0, 2.0, 0.0, 1.0]])
    exact = points.T @ points
    centre = points[:, :3].mean(axis=0)
    spread = points[:, :3] - centre
    central = spread.T @ spread
    assert exact[0, 1] == 7.0
    assert not is_close(central + 2 * np.diag(centre**2), exact[:3, :3], 0.1)
    assert is_close(central + 2 * np.outer(centre, centre), exact[:3, :3])


def test_the_inertia_matrix_depends_on_how_the_mass_lies_and_on_nothing_that_moves() -> None:
    """A rod and a point of the same mass at its centre differ by m·L²/12; each has one J in all poses."""
    point = np.outer([-L / 2, 0, 0, 1], [-L / 2, 0, 0, 1])
    assert rod_second_moments()[0, 0] - point[0, 0] == pytest.approx(L**2 / 12)
    assert is_close(RODS.links[0].pseudo_inertia(), M2 * rod_second_moments(), 1e-15)
    for q, qd in rod_states():
        summed = sum(0.5 * mass * np.sum((jacobian @ qd) ** 2) for mass, _, jacobian in mean_rod_points(*q))
        rates = [sum(Pose(RODS, q).u(i, p) * qd[p] for p in range(i + 1)) for i in range(2)]
        traces = [
            0.5 * np.trace(rate @ link.pseudo_inertia() @ rate.T) for rate, link in zip(rates, RODS.links, strict=True)
        ]
        assert sum(traces) == pytest.approx(summed, abs=1e-12)


def test_traces_need_the_transpose_and_the_inertia_of_the_link_that_is_summed_over() -> None:
    """(2-12) prints Tr(U·J·U), which makes an inertia negative, and J_i in the second sum, which runs over links j."""
    printed_d33 = []
    coriolis_misses = []
    for q, qd in rod_states():
        pose = Pose(RODS, q)
        inertia2, inertia3 = (link.pseudo_inertia() for link in RODS.links)
        printed_d33.append(np.trace(pose.u(1, 1) @ inertia3 @ pose.u(1, 1)))
        assert is_close(lagrange_euler.inertia(RODS, q), rod_inertia(q), 1e-14)
        own = pose.u2(0, 0, 0) * qd[0] ** 2
        outer = sum(pose.u2(1, k, m) * qd[k] * qd[m] for k, m in np.ndindex(2, 2))
        first = np.trace(own @ inertia2 @ pose.u(0, 0).T)
        printed, right = (first + np.trace(outer @ inertia @ pose.u(1, 0).T) for inertia in (inertia2, inertia3))
        assert right == pytest.approx(rod_coriolis(q, qd)[0], abs=1e-9)
        coriolis_misses.append(abs(printed - right))
    assert min(printed_d33) < 0.0
    assert max(coriolis_misses) > 0.05


def test_inertia_multiplies_the_acceleration() -> None:
    """(2-13) prints D·θ̇: an arm at rest would need no torque to be accelerated. Here D33·1 rad/s² = m3·L²/3."""
    at_rest, ahead = [0.3, -0.2], [0.0, 1.0]
    torque = lagrange_euler.joint_torques(RODS, at_rest, [0.0, 0.0], ahead) - rod_gravity(np.array(at_rest))
    assert torque[1] == pytest.approx(M3 * L**2 / 3, rel=1e-12)
    assert np.all(np.abs(torque) > 1e-3)


def test_printed_entries_of_the_first_derivatives_have_wrong_signs_and_angles() -> None:
    """U22 and U32, U33 of the worked example: places (2,2) and (2,4)."""

    def reach(q: np.ndarray, joints: int) -> np.ndarray:
        ends = np.cumsum(q[:joints])
        angle, place = ends[-1], L * np.array([np.cos(ends).sum(), np.sin(ends).sum()])
        c, s = cos(angle), sin(angle)
        return np.array([[c, -s, 0, place[0]], [s, c, 0, place[1]], [0, 0, 1, 0], [0, 0, 0, 1]])

    for q, _ in rod_states():
        q2, q3 = q
        u22 = derivative(lambda q: reach(q, 1), q, 0)
        u32, u33 = (derivative(lambda q: reach(q, 2), q, joint) for joint in range(2))
        c2, s2, c23, s23 = cos(q2), sin(q2), cos(q2 + q3), sin(q2 + q3)
        right = -s2, L * c2, L * (c23 + c2), L * c23
        assert is_close((u22[1, 1], u22[1, 3], u32[1, 3], u33[1, 3]), right)
        assert not is_close(u22[1, 1], s2, 1e-3)
        assert not is_close(u22[1, 3], L * s2, 1e-4)
        assert not is_close(u32[1, 3], L * (s23 + c2), 1e-4)
        assert not is_close(u33[1, 3], L * s23, 1e-4)
        assert is_close(Pose(RODS, q).u(1, 0), u32)


def test_printed_coriolis_terms_belong_to_other_speeds() -> None:
    """H2 = ½·m3·S3·L²·θ̇2² − … and H3 ∝ θ̇2·θ̇3 in print; − ½·…·θ̇3² − … and θ̇2² in truth."""
    misses = []
    for (q2, q3), (v2, v3) in rod_states():
        size = M3 * sin(q3) * L**2
        truth = rod_coriolis(np.array([q2, q3]), np.array([v2, v3]))
        assert is_close(truth, (-size * v3**2 / 2 - size * v2 * v3, size * v2**2 / 2), 1e-9)
        printed = np.array((size * v2**2 / 2 - size * v2 * v3, size * v2 * v3 / 2))
        misses.append(np.abs(printed - truth))
    assert np.all(np.max(misses, axis=0) > 0.05)


def test_printed_gravity_terms_take_wrong_angles_and_a_sign_that_only_a_negative_g_repairs() -> None:
    """With g = +9.8062 the print is off by twice the weight: 4.94 N·m; with g_y = −9.8062 still by 1.06 N·m."""
    grid = np.linspace(-pi, pi, 73)

    def worst(g: float, last_angle: int) -> tuple[float, float]:
        misses = []
        for q2 in grid:
            for q3 in grid:
                last = (q3, q2)[last_angle]
                g2 = -M2 * g * L * cos(q2) / 2 - M3 * g * L * cos(q2) / 2 - M3 * g * L * cos(q2)
                misses.append(np.abs(np.array([g2, -M3 * g * L * cos(last) / 2]) - rod_gravity(np.array([q2, q3]))))
        return tuple(np.max(misses, axis=0))

    weight2, weight3 = (M2 / 2 + 3 / 2 * M3) * GRAVITY * L, M3 * GRAVITY * L / 2
    for last_angle in range(2):  # the text prints C3 in G3, the final equation C2
        assert worst(GRAVITY, last_angle) == pytest.approx((2 * weight2, 2 * weight3), rel=1e-9)
        assert worst(-GRAVITY, last_angle) == pytest.approx((2 * weight3, 2 * weight3), rel=1e-9)
    assert 2 * weight2 == pytest.approx(4.94, abs=0.005)
    assert 2 * weight3 == pytest.approx(1.06, abs=0.005)
    for q, _ in rod_states():
        right3 = M3 * GRAVITY * L * cos(q[0] + q[1]) / 2
        right2 = M2 * GRAVITY * L * cos(q[0]) / 2 + right3 + M3 * GRAVITY * L * cos(q[0])
        assert is_close(rod_gravity(q), (right2, right3), 1e-14)
        assert is_close(lagrange_euler.gravity(RODS, q), (right2, right3), 1e-14)


def test_gravity_along_the_axes_of_both_joints_would_take_all_gravity_terms_away() -> None:
    """The paper's G lies along z, about which joints 2 and 3 turn; its own terms with g need it along -y."""
    assert all((link.cos_alpha, link.sin_alpha) == (1.0, 0.0) for link in RODS.links)
    printed = dataclasses.replace(RODS, gravity_m_s2=(0.0, 0.0, -GRAVITY))
    right = dataclasses.replace(RODS, gravity_m_s2=(0.0, -GRAVITY, 0.0))
    for q, _ in rod_states():
        assert is_close(lagrange_euler.gravity(printed, q), (0.0, 0.0), 1e-15)
        assert is_close(lagrange_euler.gravity(right, q), rod_gravity(q), 1e-14)
    assert np.abs(lagrange_euler.gravity(right, [0.0, 0.0])).min() > 0.5


def test_tachometer_reaches_0_v_where_the_paper_prints_minus_5_v() -> None:
    """2.5 V at rest and +5 V at full speed one way leave 0 V the other way; −5 V would be 255 codes below zero."""
    joint = CELL.joints[0]
    wired = joint_sensors(CELL)[0].velocity
    assert wired is not None
    scale = wired.scale
    tachometer = joint.sensors.tachometer
    assert tachometer is not None
    volts = tachometer.full_scale_v / highest_code(8)
    assert scale(5.0 / volts) == pytest.approx(2.5)
    assert scale(0.0 / volts) == pytest.approx(-2.5)
    assert scale(-5.0 / volts) == pytest.approx(-7.5)


def test_a_dac0808_has_256_levels_and_the_table_8_bits_a_sample() -> None:
    """In print "0-225 level" and "4K X 3bit". $2000-$3FFF is 8 KiB: two joints of 4096 bytes, 10.24 s at 2.5 ms."""
    assert highest_code(8) == 2**8 - 1
    assert 0x3FFF + 1 - TABLE_BASE == 2 * SAMPLES == 8 * 1024
    assert SAMPLES * CELL.bus.cycle_s == pytest.approx(10.24)
    image = MemoryImage(1, 1.5)
    image.load_table(0, np.linspace(-1.5, 1.5, SAMPLES))
    levels = {image.table_current_a(0, sample) for sample in range(SAMPLES)}
    assert 2**3 < len(levels) <= 2**8
