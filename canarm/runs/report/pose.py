"""Where each robot's tip is over a run, and how far it is off its reference, from angles and the cell's geometry."""

from collections.abc import Iterable, Sequence

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import printable
from canarm_tui.kinematics import joint_places

from ...signal_table import Floats
from ..run import Run
from .charts import COLOURS, Chart, annotated, named, series_of

MM = 1e3


def pose_charts(runs: Sequence[Run], names: Sequence[str]) -> list[Chart]:
    """Charts of the tips in the world; none of a run without a cell or angles."""
    found = [_tips(run) for run in runs]
    robots = dict.fromkeys(robot for each in found for robot in each)
    return [chart for robot in robots for chart in _of_robot(robot, runs, names, found)]


_Tips = dict[str, tuple[Floats, Floats]]
"""Robot → true place and reference of its tip, each (samples, 3), m."""


def _tips(run: Run) -> _Tips:
    try:
        cell = run.cell
        true, reference = (_angles(cell, run, column) for column in ("true_angle_rad", "reference_rad"))
        places = [joint_places(cell, angles) for angles in (true, reference)]
    except (CanarmError, KeyError, ValueError, ArithmeticError):
        return {}
    rows = zip(cell.robot, *places, strict=True)
    return {robot.name: (is_[:, -1], wanted[:, -1]) for robot, is_, wanted in rows}


def _angles(cell: Cell, run: Run, column: str) -> Floats:
    return np.column_stack([run.columns[f"{name}.{column}"] for name in cell.joint_names])


def _of_robot(robot: str, runs: Sequence[Run], names: Sequence[str], found: Sequence[_Tips]) -> Iterable[Chart]:
    shown = printable(robot, 40)
    places, errors = [], []
    for number, (run, tips) in enumerate(zip(runs, found, strict=True)):
        if robot not in tips:
            continue
        (true, reference), times_s = tips[robot], run.columns["time_s"]
        off_mm = MM * np.linalg.norm(true - reference, axis=1)
        errors.append(series_of(named("distance", names, number), times_s, off_mm, number % COLOURS))
        if len(runs) == 1:
            for axis, name in enumerate("xyz"):
                if np.nanmax(np.abs(true[:, axis]), initial=0.0) > 1e-9:  # not what a planar arm cannot reach
                    places.append(series_of(name, times_s, true[:, axis], axis))
                    places.append(series_of(f"{name}, reference", times_s, reference[:, axis], axis, dashed=True))
    if places:
        yield annotated(f"{shown}: place of its tip, m", places, runs, names, None)
    yield annotated(f"{shown}: its tip from where it should be, mm", errors, runs, names, None)
