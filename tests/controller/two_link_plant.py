"""A KON-KUK I arm for closed-loop tests of the laws: plant, 8-bit sensors and DAC, one cycle of delay.

The equations are the paper's (uniform rods, its printed signs put right) and share no code with the controller.
"""

from dataclasses import dataclass
from math import cos, radians, sin, tanh

import numpy as np
from numpy.typing import NDArray

from canarm_controller.dynamics import NominalArm
from canarm_controller.feedforward import make_feedforward
from canarm_controller.laws import ControlLaw, Cycle
from canarm_controller.memory import SAMPLES, MemoryImage
from canarm_controller.trajectory import blend_from, make_trajectory
from canarm_protocol.cell import Cell

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
    """Positions and speeds as the 8-bit ADC gives them: potentiometers first, 100 µs a channel, zero between two codes."""
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
