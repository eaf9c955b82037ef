"""Gains and limits of a new cell's controller, as tables of its file."""

from collections.abc import Mapping
from typing import Any

from canarm_protocol.cell.model import Cell

ROUGH: dict[str, dict[str, Any]] = {
    "control": {"natural_frequency_rad_s": 12.0, "damping_ratio": 1.0, "standing_band_rad": 0.005},
    "control.mras": {
        "gamma_alpha": 0.02, "gamma_beta": 0.2, "gamma_bias": 20.0, "error_gain": 1.0, "error_rate_gain": 0.1,
        "leakage": 0.3, "bias_limit_a": 0.6,
    },
    "control.mras_lyapunov": {
        "gamma_position": 4.0, "gamma_velocity": 0.15, "gamma_bias": 60.0, "leakage": 0.5, "bias_limit_a": 0.6,
    },
    "control.slotine_li": {
        "error_rate_rad_s": 25.0, "sliding_rate_rad_s": 40.0, "adaptation": 10.0, "leakage": 0.02,
    },
    "control.observer": {
        "enabled": True, "position_noise_rad": 0.0077, "velocity_noise_rad_s": 0.0082, "acceleration_noise": 0.03,
        "acceleration_bias_noise": 3.0, "tachometer_offset_noise": 0.004,
    },
    "supervision": {"missing_cycles": 16, "range_margin_deg": 3.0, "max_position_step_deg": 8.0},
}  # fmt: skip


def control_tables(cell: Cell | None) -> Mapping[str, Mapping[str, Any]]:
    """The tables `control` and `supervision` for `cell`, whose own are taken for none."""
    return ROUGH
