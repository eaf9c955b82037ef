"""Gains and limits of a new cell's controller, as tables of its file. The laws derive their gains from the arm."""

from collections.abc import Mapping
from typing import Any

from canarm_controller.laws.tuning import suggested_control
from canarm_protocol.cell.model import Cell

PLACEHOLDER: dict[str, dict[str, Any]] = {
    "control": {"natural_frequency_rad_s": 1.0, "damping_ratio": 1.0},
    "control.mras": dict.fromkeys(
        (
            "gamma_alpha",
            "gamma_beta",
            "gamma_bias",
            "error_gain",
            "error_rate_gain",
            "leakage",
            "bias_limit_a",
        ),
        1.0,
    ),
}
"""What a cell must have before there is an arm to derive gains from."""
MISSING_S, LEAST_MISSING = 0.04, 4
"""Time without an input after which the controller stops, and the least number of cycles."""
MARGIN_DEG = 3.0


def control_tables(cell: Cell | None, cycle_us: int) -> Mapping[str, Mapping[str, Any]]:
    """The tables `control` and `supervision` for `cell`, whose own gains count for nothing; None before it is there."""
    tables = PLACEHOLDER if cell is None else suggested_control(cell)
    missing = max(LEAST_MISSING, round(MISSING_S * 1e6 / cycle_us))
    return {**tables, "supervision": {"missing_cycles": missing, "range_margin_deg": MARGIN_DEG}}
