"""Gains for an untuned robot: the table `[control]` from nominal arm, sensors and cycle time of a cell.

The factors are chosen such that KON-KUK I gets its own proven gains. The laws explain the gains; the text of a cell
must not enter.

The units show how each gain scales to another robot. With ω the natural frequency of the error, J the effective inertia
of a joint and K_I its torque per ampere, a gain in A per rad and second scales with ω³·J/K_I, one in 1/s with ω, and
one that multiplies noise with the step of the sensor.
"""

from collections.abc import Sequence
from math import hypot, radians, sqrt

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.sensors.base import AnalogueSensor

from ..dynamics import Arm, cell_arm
from ..estimation.arm_model import arm_model

Table = dict[str, float | bool]

USUAL_RAD_S = 12.0
"""ω of KON-KUK I: a tenth of what its sensors and cycle would allow."""
MOST_PHASE_RAD = 0.08
"""Largest ω·T. A law that sees raw values acts about two cycles late at its crossover of 2.4·ω: 0.4 rad of its phase
margin of 1.3 rad."""
LSB_SHARE = 0.1
"""Largest effect of one sensor step on the command, J·ω²·LSB/K_I, as a share of the amplifier's current."""
BIAS_RATE, LYAPUNOV_BIAS_RATE = 1.0, 3.0
"""γ3 over the smallest ω³·J/K_I of all joints."""
POSITION_RATE, VELOCITY_RATE = 2.5, 0.55
"""γ1 and γ2 over the smallest nominal gains Kp0 = J·ω²/K_I and Kv0 = 2ζ·J·ω/K_I of all joints."""
BIAS_SHARE = 0.4
"""Limit of the bias as a share of the amplifier's current: enough for a wrong payload's weight."""
ERROR_RATE, SLIDING_RATE = 25.0 / 12.0, 40.0 / 12.0
"""Λ and κ over ω: poles near 2.6·ω."""
BAND_LSB = 0.27
"""Half a step of a position sensor is unknown; a quarter of a step is held."""
OFFSET_RATE = 0.5
"""Drift of a tachometer's offset, rad/s²/√Hz, over its noise in rad/s."""
MODEL_ERROR, MODEL_DRIFT = 0.015, 1.5
"""Noise of the model's acceleration and of its error, in 1/√Hz and 1/s/√Hz, over the acceleration by a joint's Coulomb
friction, which is the least known of an arm."""
OBSERVED_NOISE_RAD_S = 0.05
"""Noise of a speed from an observer instead of a tachometer."""
SAMPLES, SEED, FASTEST_RAD_S = 64, 0, 1.5
"""Random states at which the model is evaluated."""


def suggested_control(cell: Cell) -> dict[str, Table]:
    """Tables of a cell file, "control" and "control.<law>" with their keys, for the robots and sensors of `cell`.

    The gains in `cell` itself are ignored. Raises `ControllerError` for an arm without a model.
    """
    arm, period_s = cell_arm(cell.laden, cell.joint_names), cell.bus.cycle_s
    steps_rad = [each.position.scale.lsb for each in joint_sensors(cell)]
    omega = _natural_frequency(arm, steps_rad, period_s)
    amperes = [inertia / torque for inertia, torque in zip(arm.effective_inertia, arm.torque_per_ampere, strict=True)]
    least, bias_limit_a = min(amperes), BIAS_SHARE * max(arm.max_current_a)
    sliding = SLIDING_RATE * omega
    return {
        "control": {
            "natural_frequency_rad_s": _rounded(omega),
            "damping_ratio": 1.0,
            "standing_band_rad": _rounded(BAND_LSB * max(steps_rad)),
        },
        "control.mras": {
            "gamma_alpha": _rounded(0.02 * USUAL_RAD_S / omega),
            "gamma_beta": 0.2,
            "gamma_bias": _rounded(BIAS_RATE * omega**3 * least),
            "error_gain": 1.0,
            "error_rate_gain": _rounded(1.2 / omega),
            "leakage": 0.3,
            "bias_limit_a": _rounded(bias_limit_a),
        },
        "control.mras_lyapunov": {
            "gamma_position": _rounded(POSITION_RATE * omega**2 * least),
            "gamma_velocity": _rounded(VELOCITY_RATE * 2.0 * omega * least),
            "gamma_bias": _rounded(LYAPUNOV_BIAS_RATE * omega**3 * least),
            "leakage": 0.5,
            "bias_limit_a": _rounded(bias_limit_a),
        },
        "control.slotine_li": {
            "error_rate_rad_s": _rounded(ERROR_RATE * omega),
            "sliding_rate_rad_s": _rounded(sliding),
            "adaptation": _rounded((sliding / 2.0) ** 2 / _model_gain(arm, cell)),
            "leakage": 0.02,
        },
        "control.observer": _observer(cell, arm),
    }


def _natural_frequency(arm: Arm, steps_rad: Sequence[float], period_s: float) -> float:
    by_step = [
        sqrt(LSB_SHARE * limit * torque / (inertia * step))
        for limit, torque, inertia, step in zip(
            arm.max_current_a, arm.torque_per_ampere, arm.effective_inertia, steps_rad, strict=True
        )
    ]
    return min(USUAL_RAD_S, MOST_PHASE_RAD / period_s, *by_step)


def _model_gain(arm: Arm, cell: Cell) -> float:
    """The greatest ‖J^-½·Y·diag(a0)‖², N·m·rad/s², over moderate motions about home.

    With adaptation Γ the parameters answer s with Γ times as much torque per inertia and second; with κ·s beside it,
    that is still damped at Γ·‖...‖² = (κ/2)².
    """
    model, rng = arm_model(arm), np.random.default_rng(SEED)
    low, high = (np.radians([joint.limits_deg[end] for joint in cell.joints]) for end in (0, 1))
    home = np.array([radians(joint.home_deg) for joint in cell.joints])
    nominal, weight = np.array(model.nominal), 1.0 / np.sqrt(np.array(arm.effective_inertia))
    greatest = 0.0
    for _ in range(SAMPLES):
        q = home + 0.5 * (rng.uniform(low, high) - home)
        qd, qdd = rng.uniform(-1.0, 1.0, (2, arm.joint_count)) * FASTEST_RAD_S
        state = model.at(q.tolist(), qd.tolist(), qd.tolist(), (5.0 * qdd).tolist(), qd.tolist())
        rows = np.array([state.gradient(unit) for unit in np.eye(arm.joint_count).tolist()])
        greatest = max(greatest, float(np.linalg.norm(weight[:, None] * rows * nominal, ord=2)) ** 2)
    return greatest


def _observer(cell: Cell, arm: Arm) -> Table:
    positions, speeds = [], []
    for each in joint_sensors(cell):
        positions.append(_noise(each.position.sensor, each.position.scale.lsb))
        velocity = each.velocity
        speeds.append(OBSERVED_NOISE_RAD_S if velocity is None else _noise(velocity.sensor, velocity.scale.lsb))
    friction = max(
        joint.motor.coulomb_friction_nm / inertia
        for joint, inertia in zip(cell.joints, arm.effective_inertia, strict=True)
    )
    friction = max(friction, 1.0)
    return {
        "enabled": True,
        "position_noise_rad": _rounded(max(positions)),
        "velocity_noise_rad_s": _rounded(max(speeds)),
        "acceleration_noise": _rounded(MODEL_ERROR * friction),
        "acceleration_bias_noise": _rounded(MODEL_DRIFT * friction),
        "tachometer_offset_noise": _rounded(OFFSET_RATE * max(speeds)),
    }


def _noise(sensor: object, lsb: float) -> float:
    """Standard deviation of one sample: the sensor's noise, and rounding to whole steps."""
    noise_lsb = sensor.noise_lsb if isinstance(sensor, AnalogueSensor) else 0.0
    return lsb * hypot(noise_lsb, sqrt(1.0 / 12.0))


def _rounded(value: float) -> float:
    """`value` to two digits, which is all that is known."""
    return float(f"{value:.2g}")
