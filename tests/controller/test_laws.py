"""The laws in closed loop with a KON-KUK I arm: plant, 8-bit sensors and DAC, one cycle of delay; and one by one.

The equations of the plant are the paper's (uniform rods, its printed signs put right) and share no code with the
controller. Its friction is the nominal one, which the table knows: a robot with other friction does worse.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import cos, radians, sin, tanh

import numpy as np
import pytest
from numpy.typing import NDArray

from canarm_controller.dynamics import NominalArm
from canarm_controller.laws import ControlLaw, Cycle, load_law
from canarm_controller.reference.feedforward import make_feedforward
from canarm_controller.reference.memory import SAMPLES, MemoryImage
from canarm_controller.reference.trajectory import blend_from, make_trajectory
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell

LENGTH_M, GRAVITY_M_S2 = 0.18, 9.8062
ROTOR_KG_M2 = (0.054, 0.024)
VISCOUS_NM_S = (0.05, 0.02)
COULOMB_NM = (0.15, 0.06)
TORQUE_PER_AMPERE = (4.08, 2.72)
STEP_S = 0.5e-3
STICTION_RAD_S = 1e-3
"""Speed within which Coulomb friction changes sign: twenty times sharper than the controller's model of it."""
POSITION_LSB_RAD = radians(270.0 / 255)
SPEED_LSB_RAD_S = 5.0 / 255
CURRENT_STEP_A = 1.5 / 255
CONVERSION_S = 100e-6
SETTLING_TICKS = 1024


@dataclass(frozen=True, eq=False)
class Run:
    """What a closed-loop run left behind, one row a tick."""

    error_lsb: NDArray[np.float64]
    speed_rad_s: NDArray[np.float64]
    current_a: NDArray[np.float64]
    steady: NDArray[np.bool_]
    law: ControlLaw

    @property
    def rms_lsb(self) -> float:
        """RMS of the true error of the worse joint in steps of the potentiometer, the first 1024 ticks left out."""
        settled = self.error_lsb[SETTLING_TICKS:]
        return float(np.sqrt(np.mean(settled**2, axis=0)).max())

    @property
    def ripple(self) -> float:
        """Standard deviation of speed over its mean on constant-speed stretches of the worse joint."""
        speed = np.where(self.steady, np.abs(self.speed_rad_s), np.nan)[SETTLING_TICKS:]
        return float((np.nanstd(speed, axis=0) / np.nanmean(speed, axis=0)).max())


def acceleration(state: list[float], torque_nm: list[float], mass2_kg: float, mass3_kg: float) -> tuple[float, float]:
    """θ̈ of the true arm: D⁻¹(τ - H - G - friction)."""
    q2, q3, v2, v3 = state
    coupling = mass3_kg * LENGTH_M**2
    c3, s3 = cos(q3), sin(q3)
    d22 = (mass2_kg / 3 + 4 * mass3_kg / 3) * LENGTH_M**2 + coupling * c3 + ROTOR_KG_M2[0]
    d23 = coupling / 3 + coupling * c3 / 2
    d33 = coupling / 3 + ROTOR_KG_M2[1]
    h2 = -coupling * s3 * (v3 * v3 / 2 + v2 * v3)
    h3 = coupling * s3 * v2 * v2 / 2
    g3 = mass3_kg * GRAVITY_M_S2 * LENGTH_M * cos(q2 + q3) / 2
    g2 = (mass2_kg / 2 + mass3_kg) * GRAVITY_M_S2 * LENGTH_M * cos(q2) + g3
    t2 = torque_nm[0] - h2 - g2 - VISCOUS_NM_S[0] * v2 - COULOMB_NM[0] * tanh(v2 / STICTION_RAD_S)
    t3 = torque_nm[1] - h3 - g3 - VISCOUS_NM_S[1] * v3 - COULOMB_NM[1] * tanh(v3 / STICTION_RAD_S)
    determinant = d22 * d33 - d23 * d23
    return (d33 * t2 - d23 * t3) / determinant, (d22 * t3 - d23 * t2) / determinant


def moved(state: list[float], torque_nm: list[float], mass2_kg: float, mass3_kg: float, step_s: float) -> list[float]:
    """`state` one Runge-Kutta step later under constant torque."""

    def slope(at: list[float]) -> list[float]:
        return [at[2], at[3], *acceleration(at, torque_nm, mass2_kg, mass3_kg)]

    k1 = slope(state)
    k2 = slope([x + 0.5 * step_s * k for x, k in zip(state, k1, strict=True)])
    k3 = slope([x + 0.5 * step_s * k for x, k in zip(state, k2, strict=True)])
    k4 = slope([x + step_s * k for x, k in zip(state, k3, strict=True)])
    return [x + step_s / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)]


def run_closed_loop(
    cell: Cell,
    law_type: type[ControlLaw],
    trajectory_name: str,
    feedforward: str | None = None,
    mass3_kg: float = 0.6,
    ticks: int = 4096,
    seed: int = 0,
    lead_cycles: float = 1.5,
) -> Run:
    """Run `law_type` against the true arm for `ticks` cycles of the cell, from rest at the home pose."""
    period_s = cell.bus.cycle_s
    substeps = round(period_s / STEP_S)
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 0.3, (ticks + 1, 4))
    arm = NominalArm.from_robot(cell.robot[0])
    law = law_type(arm, cell.control, period_s)
    ahead = make_feedforward(
        feedforward or law.default_feedforward,
        arm,
        MemoryImage(2, arm.max_current_a),
        law.feedforward_excludes_inertia,
        lead_cycles * period_s,
    )
    home = [radians(joint.home_deg) for joint in cell.joints]
    state = [*home, 0.0, 0.0]
    torque = list(arm.gravity(home))
    start_position, start_speed = sensed(state, (0.0, 0.0), noise[ticks])
    trajectory = blend_from(make_trajectory(trajectory_name, cell), start_position)
    law.start(start_position, start_speed, trajectory.amplitude_rad)
    cycle = Cycle(2)
    command = torque
    true_state = np.empty((ticks, 4))
    applied_a = np.empty((ticks, 2))
    errors = np.empty((ticks, 2))
    for tick in range(ticks):
        if tick % SAMPLES == 0:
            block = trajectory.sample(tick, SAMPLES, period_s)
            ahead.prepare(block, tick)
            rows = [part.tolist() for part in (block.position_rad, block.velocity_rad_s, block.acceleration_rad_s2)]
        torque = command
        index = tick % SAMPLES
        reference = rows[0][index]
        true_state[tick] = state
        errors[tick] = [(state[0] - reference[0]) / POSITION_LSB_RAD, (state[1] - reference[1]) / POSITION_LSB_RAD]
        applied_a[tick] = [torque[0] / TORQUE_PER_AMPERE[0], torque[1] / TORQUE_PER_AMPERE[1]]
        cycle.tick = tick
        cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = (part[index] for part in rows)
        speeding = acceleration(state, list(torque), 1.0, mass3_kg)
        cycle.position_rad, cycle.velocity_rad_s = sensed(state, speeding, noise[tick])
        cycle.feedforward_nm = ahead.torque_nm(tick)
        wanted = [t / k for t, k in zip(law.update(cycle), TORQUE_PER_AMPERE, strict=True)]
        codes = [max(-255, min(255, round(current / CURRENT_STEP_A))) for current in wanted]
        cycle.saturated = [abs(current) > 1.5 for current in wanted]
        command = [code * CURRENT_STEP_A * k for code, k in zip(codes, TORQUE_PER_AMPERE, strict=True)]
        cycle.applied_nm = command
        for _ in range(substeps):
            state = moved(state, list(torque), 1.0, mass3_kg, STEP_S)
    steady = trajectory.constant_speed(0, ticks, period_s)
    return Run(errors, true_state[:, 2:], applied_a, steady, law)


def sensed(
    state: list[float], speeding: tuple[float, float], noise_lsb: NDArray[np.float64]
) -> tuple[list[float], list[float]]:
    """Positions and speeds as the ADC gives them: potentiometers first, 100 µs per channel, zero between two codes."""
    positions = [quantised(state[i] + state[2 + i] * i * CONVERSION_S, POSITION_LSB_RAD, noise_lsb[i]) for i in (0, 1)]
    speeds = [
        quantised(state[2 + i] + speeding[i] * (2 + i) * CONVERSION_S, SPEED_LSB_RAD_S, noise_lsb[2 + i])
        for i in (0, 1)
    ]
    return positions, speeds


def quantised(value: float, lsb: float, noise_lsb: float) -> float:
    """`value` through an 8-bit converter whose middle, 127.5, is zero."""
    code = round(value / lsb + 127.5 + noise_lsb)
    return (max(0, min(255, code)) - 127.5) * lsb


@lru_cache
def run(
    law: str, trajectory: str, feedforward: str | None = None, mass3_kg: float = 0.6, settings: tuple[str, ...] = ()
) -> Run:
    """One closed-loop run of 10.24 s, kept for the other tests that look at it; `settings` as "key=value"."""
    pairs = dict(setting.split("=") for setting in settings)
    return run_closed_loop(load_cell("konkuk1", pairs), load_law(law), trajectory, feedforward, mass3_kg)


def fresh(law: str, **mras: str) -> ControlLaw:
    cell = load_cell("konkuk1", {f"control.mras.{key}": value for key, value in mras.items()})
    return load_law(law)(NominalArm.from_robot(cell.robot[0]), cell.control, cell.bus.cycle_s)


def cycle_at(position_rad: tuple[float, float], reference_rad: tuple[float, float]) -> Cycle:
    cycle = Cycle(2)
    cycle.position_rad, cycle.reference_rad = position_rad, reference_rad
    return cycle


@pytest.mark.parametrize(
    ("trajectory", "mass3_kg", "prototype_lsb"),
    [("sine", 0.6, 7.6), ("trapezoid", 0.6, 7.2), ("sine", 0.9, 10.0), ("trapezoid", 0.9, 9.5)],
)
def test_pd_alone_sags_under_its_weight_as_the_prototype_did(
    trajectory: str, mass3_kg: float, prototype_lsb: float
) -> None:
    assert run("pd", trajectory, mass3_kg=mass3_kg).rms_lsb == pytest.approx(prototype_lsb, rel=0.03)


@pytest.mark.parametrize(
    ("trajectory", "mass3_kg", "prototype_lsb"),
    [("sine", 0.6, 0.26), ("trapezoid", 0.6, 0.15), ("sine", 0.9, 0.35), ("trapezoid", 0.9, 0.27)],
)
def test_mras_with_table_tracks_at_least_as_well_as_the_prototype(
    trajectory: str, mass3_kg: float, prototype_lsb: float
) -> None:
    """The prototype's figures are bounds, not a like-for-like comparison: its table seems to have held no friction."""
    assert run("mras", trajectory, mass3_kg=mass3_kg).rms_lsb <= prototype_lsb


def test_table_is_what_makes_pd_follow_and_a_wrong_payload_undoes_it() -> None:
    assert run("pd", "sine", "table").rms_lsb < 0.05 * run("pd", "sine").rms_lsb
    assert run("pd", "sine", "table", 0.9).rms_lsb > 20 * run("pd", "sine", "table").rms_lsb


def test_most_of_the_gain_at_a_wrong_payload_is_the_bias() -> None:
    fixed = run("pd", "sine", "table", 0.9).rms_lsb
    both = run("mras", "sine", mass3_kg=0.9).rms_lsb
    off = ("control.mras.gamma_alpha=0.0", "control.mras.gamma_beta=0.0")
    bias_only = run("mras", "sine", mass3_kg=0.9, settings=off).rms_lsb
    gains_only = run("mras", "sine", mass3_kg=0.9, settings=("control.mras.gamma_bias=0.0",)).rms_lsb
    assert both < bias_only < 0.2 * fixed
    assert gains_only > 5 * both


def test_feedforward_makes_speed_constant() -> None:
    """The paper's claim for its dynamics table; it gives no figure, so the yardstick is PD without the table."""
    without = run("pd", "trapezoid").ripple
    assert run("pd", "trapezoid", "table").ripple < 0.5 * without
    assert run("mras", "trapezoid").ripple < 0.5 * without


def test_gains_and_bias_stay_within_their_projection() -> None:
    """Joints that will not move, with wild gains: everything runs into both of its limits and never past them."""
    law = fresh("mras", gamma_alpha="1000.0", gamma_beta="1000.0")
    law.start((0.0, 0.0), (0.0, 0.0), (0.6, 0.6))
    seen: dict[str, list[float]] = {"alpha": [], "beta": [], "bias_a": []}
    cycle = Cycle(2)
    for tick in range(4096):
        wanted = float(0.6 * np.sin(tick * 0.01))
        cycle.reference_rad = (wanted, wanted)
        law.update(cycle)
        for name, values in seen.items():
            values.extend(law.internals()[name])
    a, b = 1 / 12.0**2, 2 / 12.0
    assert (min(seen["alpha"]), max(seen["alpha"])) == pytest.approx((0.35 * a, 3 * a))
    assert (min(seen["beta"]), max(seen["beta"])) == pytest.approx((0.35 * b, 3 * b))
    assert (min(seen["bias_a"]), max(seen["bias_a"])) == pytest.approx((-0.6, 0.6))


def test_an_impossible_payload_saturates_without_winding_up() -> None:
    """m3 x 3.5 needs 1.579 A to hold, more than the amplifier's 1.5 A."""
    heavy = run("mras", "sine", mass3_kg=2.1)
    assert np.abs(heavy.current_a).max() == pytest.approx(1.5)
    assert all(np.isfinite(value).all() for value in heavy.law.internals().values())
    assert np.abs(heavy.law.internals()["bias_a"]).max() <= 0.6


def test_mras_starts_without_a_bump() -> None:
    law = fresh("mras")
    law.start((0.3, -0.2), (0.0, 0.0), (0.6, 0.5))
    cycle = cycle_at((0.3, -0.2), (0.3, -0.2))
    cycle.feedforward_nm = (1.25, -0.5)
    assert law.update(cycle) == pytest.approx([1.25, -0.5], abs=1e-12)


def test_mras_without_adaptation_is_the_linear_law_of_its_model() -> None:
    """α = a, β = b: τ = J·(q̈_d + 2ζωn·(q̇_d - q̇) + ωn²·(q_d - q)), with ωn = 12 and ζ = 1."""
    law = fresh("mras")
    law.start((0.0, 0.0), (0.0, 0.0), (0.6, 0.5))
    cycle = cycle_at((0.01, 0.02), (0.03, -0.01))
    cycle.velocity_rad_s, cycle.reference_rad_s, cycle.reference_rad_s2 = (0.1, 0.2), (0.4, -0.3), (2.0, 1.0)
    inertia = NominalArm.from_robot(load_cell("konkuk1").robot[0]).effective_inertia
    expected = [inertia[0] * (2.0 + 24 * 0.3 + 144 * 0.02), inertia[1] * (1.0 - 24 * 0.5 - 144 * 0.03)]
    assert law.update(cycle) == pytest.approx(expected, rel=1e-9)


def test_bias_pushes_towards_the_reference() -> None:
    law = fresh("mras")
    law.start((0.1, 0.1), (0.0, 0.0), (0.6, 0.5))
    cycle = cycle_at((0.05, 0.15), (0.1, 0.1))
    for _ in range(20):
        law.update(cycle)
    bias_a = law.internals()["bias_a"]
    assert bias_a[0] > 0.02
    assert bias_a[1] < -0.02


@pytest.mark.parametrize("actual_inertia", [0.6, 1.6])
def test_alpha_moves_so_that_the_loop_acts_like_the_model(actual_inertia: float) -> None:
    """A joint of `actual_inertia` times the nominal one acts as α·`actual_inertia`: to match, α falls if it is > 1."""
    law = fresh("mras", gamma_bias="0.0", leakage="0.0", gamma_beta="0.0")
    inertia = NominalArm.from_robot(load_cell("konkuk1").robot[0]).effective_inertia
    law.start((0.0, 0.0), (0.0, 0.0), (0.6, 0.6))
    cycle = Cycle(2)
    position, speed = np.zeros(2), np.zeros(2)
    for tick in range(4000):
        t = tick * 0.0025
        cycle.reference_rad = (0.6 * np.sin(4 * t),) * 2
        cycle.reference_rad_s = (2.4 * np.cos(4 * t),) * 2
        cycle.reference_rad_s2 = (-9.6 * np.sin(4 * t),) * 2
        cycle.position_rad, cycle.velocity_rad_s = tuple(position), tuple(speed)
        speed = speed + 0.0025 * np.array(law.update(cycle)) / (np.array(inertia) * actual_inertia)
        position = position + 0.0025 * speed
    alpha = np.array(law.internals()["alpha"]) * 12.0**2
    assert ((alpha - 1) * (1 - actual_inertia) > 0).all()
    assert np.abs(alpha * actual_inertia - 1).max() < 0.5 * abs(actual_inertia - 1)


def test_adaptation_stands_still_while_saturated() -> None:
    law = fresh("mras")
    law.start((0.1, 0.1), (0.0, 0.0), (0.6, 0.5))
    cycle = cycle_at((0.0, 0.0), (0.3, 0.3))
    for _ in range(10):
        law.update(cycle)
    names = ("alpha", "beta", "bias_a")
    before = {name: list(law.internals()[name]) for name in names}
    cycle.saturated = (True, False)
    for _ in range(10):
        law.update(cycle)
    for name in names:
        assert law.internals()[name][0] == before[name][0]
        assert law.internals()[name][1] != before[name][1]


def test_a_standing_trajectory_has_finite_gains() -> None:
    law = fresh("mras")
    law.start((0.1, 0.1), (0.0, 0.0), (0.0, 0.0))
    torque = law.update(cycle_at((0.09, 0.11), (0.1, 0.1)))
    assert np.isfinite(torque).all()


def test_restarting_forgets_everything() -> None:
    law = fresh("mras")
    law.start((0.1, 0.1), (0.0, 0.0), (0.6, 0.5))
    first = law.update(cycle_at((0.0, 0.0), (0.3, 0.3)))
    for _ in range(50):
        law.update(cycle_at((0.0, 0.0), (0.3, 0.3)))
    law.start((0.1, 0.1), (0.0, 0.0), (0.6, 0.5))
    assert law.update(cycle_at((0.0, 0.0), (0.3, 0.3))) == first
