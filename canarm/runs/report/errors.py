"""How far each joint was from its reference in truth, in steps of its sensor; from a run's tables alone."""

import math
from collections.abc import Iterator

import numpy as np

from canarm_protocol.cell.bench_objects import SETTLING_CYCLES
from canarm_protocol.cell.sensing import position_steps_rad
from canarm_protocol.errors import CanarmError

from ...signal_table import Floats
from ..run import Run

DEGREES = 180.0 / math.pi


def step_rad(run: Run, joint: str) -> float | None:
    """The step of the joint's position sensor; None without a cell."""
    try:
        cell = run.cell
        return position_steps_rad(cell)[cell.joint_names.index(joint)]
    except (CanarmError, ValueError):
        return None


def error_of(run: Run, joint: str) -> tuple[Floats | None, str]:
    """True minus reference angle of every row, NaN without a reference, and its unit; None without these columns."""
    true, reference = (run.columns.get(f"{joint}.{name}") for name in ("true_angle_rad", "reference_rad"))
    if true is None or reference is None:
        return None, ""
    step = step_rad(run, joint)
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged row may hold any number
        if step is None:
            return (true - reference) * DEGREES, "degrees"
        return (true - reference) / step, f"steps of the sensor (1 step is {step * DEGREES:.3g} degrees)"


def settled_s(run: Run) -> float:
    """When errors begin to count; infinite if the run has not come so far, 0 without a table that tells."""
    cycles = run.columns.get("cycle", np.empty(0))
    if not len(cycles):
        return 0.0
    counted = cycles >= SETTLING_CYCLES
    return float(run.columns["time_s"][counted].min()) if counted.any() else math.inf


def largest_errors(run: Run, since_s: float) -> Iterator[tuple[str, float, str]]:
    """Each joint with the magnitude of its largest error from `since_s` on, and the unit in a word or two."""
    names = [name.removesuffix(".true_angle_rad") for name in run.columns if name.endswith(".true_angle_rad")]
    for joint in names:
        errors, unit = error_of(run, joint)
        if errors is None:
            continue
        chosen = np.abs(errors[run.columns["time_s"] >= since_s])
        known = chosen[np.isfinite(chosen)]
        if len(known):
            yield joint, float(known.max()), unit.partition(" of ")[0]
