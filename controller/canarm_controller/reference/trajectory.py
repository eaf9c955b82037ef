"""Makes a trajectory: one of the two built-in motions, or from a user's file, table or function.

Owns the choice, and the formulas of the built-in motions. `trajectory_file` reads files.
"""

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from canarm_protocol.cell.arm import Joint
from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import first_line, name_of, printable, quoted

from ..errors import TrajectoryError
from .base import Blended, Bools, Trajectory, blend_from
from .built_in import Swing
from .built_in import swings as swings_of
from .carried_motion import PATHS, check_grips, is_tip_path, plan_file, plan_motion
from .excite import PERIOD_S, excite
from .file_trajectory import FileTrajectory, FunctionTrajectory, Interpolation
from .limits import Floats, Limits, Reference, real_numbers
from .trajectory_file import read_trajectory_columns, read_trajectory_csv

__all__ = [
    "Blended",
    "FileTrajectory",
    "Limits",
    "Reference",
    "Sine",
    "Trajectory",
    "Trapezoid",
    "blend_from",
    "built_in_motions",
    "make_trajectory",
    "named_motions",
    "trajectory_name",
    "usual_motion",
]

BUILT_IN = ("sine", "trapezoid")
EXCITE = "excite"
"""The motion made for identification, which nobody takes without asking for it."""
TRAPEZOID_PERIOD_S = 5.12
LEAST_OF_SUPPLY = 0.2
"""Share of the supply for the back-EMF if the winding would take it all: full current is never needed at speed."""
CARRIED_TICKS = 8192
"""Of a motion of two robots with an object that is given in Python, so many cycles are checked."""
CHECKED_S = 4 * TRAPEZOID_PERIOD_S
"""The built-in motions, whose joints have different periods, are checked for this long."""


class Sine(Trajectory):
    """Each joint swings sinusoidally about a centre: no stretch of constant speed."""

    def __init__(
        self, limits: Limits, centre_deg: Sequence[float], amplitude_deg: Sequence[float], period_s: Sequence[float]
    ) -> None:
        super().__init__(limits, tuple(np.radians(np.asarray(amplitude_deg)).tolist()))
        self._centre_rad = np.radians(np.asarray(centre_deg))
        self._omega_rad_s = 2.0 * np.pi / np.asarray(period_s)

    def _at(self, time_s: Floats) -> Reference:
        omega = self._omega_rad_s
        phase = time_s[:, None] * omega
        amplitude = np.asarray(self.amplitude_rad)
        swing = amplitude * np.sin(phase)
        return Reference(self._centre_rad + swing, amplitude * omega * np.cos(phase), -(omega**2) * swing)

    def _is_steady(self, time_s: Floats) -> Bools:
        return np.zeros((len(time_s), len(self.amplitude_rad)), dtype=np.bool_)


class Trapezoid(Trajectory):
    """Each joint goes up and down between two angles at constant speed, half a period each way.

    A move begins and ends at rest with parabolic blends of `blend_s`: linear segments with parabolic blends.
    """

    def __init__(
        self, limits: Limits, low_deg: Sequence[float], high_deg: Sequence[float], period_s: float, blend_s: float
    ) -> None:
        self._low_rad = np.radians(np.asarray(low_deg))
        self._stroke_rad = np.radians(np.asarray(high_deg)) - self._low_rad
        self._move_s = period_s / 2.0
        self._blend_s = blend_s
        super().__init__(limits, tuple((self._stroke_rad / 2.0).tolist()))

    def _at(self, time_s: Floats) -> Reference:
        move_s, blend_s = self._move_s, self._blend_s
        move, t = np.divmod(time_s, move_s)
        left = move_s - t
        begins, ends = t < blend_s, left < blend_s
        way = np.where(
            begins, t * t / (2 * blend_s), np.where(ends, move_s - blend_s - left**2 / (2 * blend_s), t - blend_s / 2)
        )
        rate = np.minimum(np.minimum(t, left) / blend_s, 1.0)
        rate_change = np.where(begins, 1.0, np.where(ends, -1.0, 0.0)) / blend_s
        downward = move % 2 == 1
        sign = np.where(downward, -1.0, 1.0)
        speed = self._stroke_rad / (move_s - blend_s)
        travelled = np.where(downward[:, None], self._stroke_rad - way[:, None] * speed, way[:, None] * speed)
        return Reference(
            self._low_rad + travelled, (sign * rate)[:, None] * speed, (sign * rate_change)[:, None] * speed
        )

    def _is_steady(self, time_s: Floats) -> Bools:
        t = np.mod(time_s, self._move_s)
        steady: Bools = (t >= self._blend_s) & (self._move_s - t >= self._blend_s)
        return np.repeat(steady[:, None], len(self.amplitude_rad), axis=1)


def built_in_motions(cell: Cell) -> tuple[str, ...]:
    """The names of motions that a cell can do without a file: other ones where its robots carry an object."""
    return BUILT_IN if cell.object is None else tuple(PATHS)


def named_motions(cell: Cell) -> tuple[str, ...]:
    """The names of all motions of a cell that need no file."""
    return built_in_motions(cell) if cell.object is not None else (*BUILT_IN, EXCITE)


def usual_motion(cell: Cell) -> str:
    """The motion of a cell unless another is asked for."""
    return built_in_motions(cell)[0]


def make_trajectory(spec: object, cell: Cell) -> Trajectory:
    """The trajectory "sine", "trapezoid", "excite", of a CSV file (its path) or, in Python, of a table or a function.

    Where two robots carry an object it is "circle", "line" or "arc", with options as in "circle:radius_mm=20,plane=xy",
    or a file with the way of the master's tip. Joint angles are taken where they leave the object in both hands.

    `:monotone`, `:spline` or `:samples` after the path chooses the `Interpolation`. A DataFrame or a dict of columns is
    like the file; an array (n, joints) has the angles in rad, one row per cycle; a function returns them for a time in
    s, from 0 on.

    Raises `TrajectoryError` if there is no such trajectory, the file is wrong, or a joint cannot follow.
    """
    limits = Limits.of(cell)
    if cell.object is not None:
        return _carried(spec, limits, cell)
    if not isinstance(spec, str | Path):
        return _given(spec, limits)
    if spec in BUILT_IN:
        trajectory = _built_in(str(spec), limits, cell)
        limits.check(trajectory, CHECKED_S, str(spec))
        return trajectory
    if spec == EXCITE:
        trajectory = excite(cell, limits, [swing.centre_deg for swing in _swings(limits, cell)], _speeds(limits, cell))
        limits.check(trajectory, PERIOD_S, EXCITE)
        return trajectory
    path, interpolation = _file_of(str(spec), named_motions(cell))
    time_s, position_rad = read_trajectory_csv(path, limits.joint_names)
    return FileTrajectory(limits, time_s, position_rad, interpolation, str(path))


def _carried(spec: object, limits: Limits, cell: Cell) -> Trajectory:
    """A motion of two robots that leaves their object in both hands."""
    if not isinstance(spec, str | Path):
        trajectory = _given(spec, limits)
        check_grips(trajectory.sample(0, CARRIED_TICKS, limits.period_s).position_rad, cell, "trajectory")
        return trajectory
    name = str(spec)
    if name.partition(":")[0] in PATHS:
        return FileTrajectory(limits, *plan_motion(name, cell), Interpolation.SAMPLES, name)
    if name in (*BUILT_IN, EXCITE):
        raise TrajectoryError(
            f"{name}: joints that swing by themselves would tear the object apart; built in here: {', '.join(PATHS)}"
        )
    path, interpolation = _file_of(name, tuple(PATHS))
    if is_tip_path(path):
        return FileTrajectory(limits, *plan_file(path, cell), Interpolation.SAMPLES, str(path))
    time_s, position_rad = read_trajectory_csv(path, limits.joint_names)
    check_grips(position_rad, cell, str(path))
    return FileTrajectory(limits, time_s, position_rad, interpolation, str(path))


def _file_of(spec: str, built_in: Sequence[str]) -> tuple[Path, Interpolation | None]:
    """The file and how its rows are joined. Raises `TrajectoryError` if there is no such file."""
    try:
        path, interpolation = _path_of(spec)
        exists = path.exists()
    except (OSError, ValueError) as error:  # too long a name, a null byte
        raise TrajectoryError(f"{printable(spec)}: no trajectory, and no name of a file: {first_line(error)}") from None
    if not exists or not spec:
        close = difflib.get_close_matches(spec, built_in, n=1)
        hint = f"; did you mean {quoted(close[0])}?" if close else ""
        raise TrajectoryError(f"{spec}: no such trajectory or file; built in: {', '.join(built_in)}{hint}")
    return path, interpolation


def trajectory_name(spec: object) -> str:
    """The trajectory's name in summaries: of an object without a name, what it is."""
    if isinstance(spec, str | Path):
        return str(spec)
    if hasattr(spec, "keys"):  # a DataFrame is no Mapping
        return f"a {type(spec).__name__}"
    if callable(spec):
        return name_of(spec)
    rows = np.shape(spec)[0] if isinstance(spec, np.ndarray) and spec.ndim else None
    rows = len(spec) if isinstance(spec, list | tuple) else rows
    return type(spec).__name__ if rows is None else f"an array of {rows} rows"


def _given(spec: Any, limits: Limits) -> Trajectory:
    """The trajectory of a Python object."""
    if isinstance(spec, Trajectory):
        return spec
    if hasattr(spec, "keys"):  # a DataFrame is no Mapping
        return FileTrajectory(limits, *read_trajectory_columns(spec, limits.joint_names))
    if callable(spec):
        return FunctionTrajectory(limits, spec)
    try:
        angles = real_numbers(spec)
    except (TypeError, ValueError, OverflowError):
        raise TrajectoryError(
            f"trajectory: {type(spec).__name__} is none; must be a name, a file, a DataFrame, an array or a function"
        ) from None
    if not angles.ndim:
        raise TrajectoryError(
            f"trajectory {quoted(spec)}: is none; must be a name, a file, a DataFrame, an array or a function"
        )
    joints = len(limits.joint_names)
    if angles.ndim != 2 or angles.shape[1] != joints or len(angles) < 3:
        turned = angles.ndim == 2 and angles.shape[0] == joints != angles.shape[1]
        raise TrajectoryError(
            f"trajectory: an array of shape {angles.shape}; must be (n, {joints}) with n of at least 3: angles in rad, "
            f"one row per cycle, one column per joint{'; give its transpose, .T' if turned else ''}"
        )
    if not np.isfinite(angles).all():
        row, joint = np.argwhere(~np.isfinite(angles))[0].tolist()
        raise TrajectoryError(
            f"trajectory: row {row}, {limits.joint_names[joint]}: {angles[row, joint]}; must be a finite number, in rad"
        )
    times: Floats = np.arange(len(angles), dtype=np.float64) * limits.period_s
    try:
        return FileTrajectory(limits, times, angles, Interpolation.SAMPLES)
    except TrajectoryError as error:
        if np.abs(angles).max() <= 2.0 * np.pi:
            raise
        raise TrajectoryError(f"{error}; the array's angles are rad: are these degrees? Then np.radians(...)") from None


def _path_of(spec: str) -> tuple[Path, Interpolation | None]:
    """Path and interpolation of `FILE[:WORD]`; a file of just that name is that file."""
    name, colon, word = spec.rpartition(":")
    if colon and word in tuple(Interpolation) and not Path(spec).exists():
        return Path(name), Interpolation(word)
    return Path(spec), None


def _built_in(name: str, limits: Limits, cell: Cell) -> Trajectory:
    """The two test motions, for the joints of `cell`."""
    swings = _swings(limits, cell)
    centre, amplitude = [each.centre_deg for each in swings], [each.amplitude_deg for each in swings]
    if name == "sine":
        return Sine(limits, centre, amplitude, [each.period_s for each in swings])
    low, high = ([c + way * a for c, a in zip(centre, amplitude, strict=True)] for way in (-1.0, 1.0))
    return Trapezoid(limits, low, high, period_s=TRAPEZOID_PERIOD_S, blend_s=0.15)


def _swings(limits: Limits, cell: Cell) -> tuple[Swing, ...]:
    home_deg = [joint.home_deg for joint in cell.joints]
    return swings_of(home_deg, limits.low_deg, limits.high_deg, _speeds(limits, cell))


def _speeds(limits: Limits, cell: Cell) -> list[float]:
    return [min(own, _driven_rad_s(joint)) for own, joint in zip(limits.speed_rad_s, cell.joints, strict=True)]


def _driven_rad_s(joint: Joint) -> float:
    """The speed at which the supply still drives all of the amplifier's current through the winding."""
    left_v = joint.drive.supply_v - joint.drive.max_current_a * joint.motor.winding_ohm
    return max(left_v, LEAST_OF_SUPPLY * joint.drive.supply_v) / joint.motor.back_emf_v_s_rad
