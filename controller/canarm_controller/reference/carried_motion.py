"""Motions of two robots that carry one object: the master's tip follows a path, the slave supports.

Owns the names of paths and their options. `cooperation` plans the joints; how a plan is followed is for `trajectory`.
"""

import csv
import math
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable
from canarm_protocol.text_file import csv_rows, read_text

from ..cooperation import ArmPair, CarriedObject, Path, arc, line, pair_of, plan_cooperation, read_path
from ..cooperation.path_file import LARGEST_BYTES
from ..dynamics import ClosedChain
from ..errors import CooperationError, TrajectoryError
from .limits import Floats

LAPS, LAP_S, EASE_S = 12.0, 5.0, 1.0
"""A path is run through so often, each time in so many seconds; it begins and ends slowly."""
RADIUS_MM, LENGTH_MM, ARC_DEG = 12.7, 25.4, 180.0
"""Of circle and arc, half an inch as in the paper; of the line; of the arc."""
CHECKED_ROWS = 2000
"""Of a table of joint angles, so many are checked."""
HOME_DIGITS = 6
"""Decimals of an angle in degrees: a millionth is 10 nm at a tip."""
LOOSE_M = 0.002
"""The hands may be so far from their distance in a table of joint angles: the grips give way by less."""


def plan_motion(name: str, cell: Cell) -> tuple[Floats, Floats]:
    """Times (n,) and angles (n, joints) in rad of `NAME[:KEY=VALUE,…]`. Raises `TrajectoryError`."""
    word, _, text = name.partition(":")
    try:
        make = PATHS[word]
        options = _Options(name, text, cell.bus.cycle_s)
        path = make(options)
        options.refuse_rest()
        return _planned(path, cell)
    except CooperationError as error:
        raise TrajectoryError(f"{printable(name)}: {error}") from None


def is_tip_path(file: FilePath) -> bool:
    """Whether a CSV file has the way of the master's tip, not joint angles; False too where it cannot be read."""
    try:
        header, _ = csv_rows(read_text(file, LARGEST_BYTES, "a path", "CSV"))
    except (OSError, ValueError, csv.Error):
        return False
    return any(name in header for name in ("x_m", "x_mm", "x_in"))


def plan_file(file: FilePath, cell: Cell) -> tuple[Floats, Floats]:
    """As `plan_motion`, from a CSV file with `time_s` and the master's tip, x_m, y_m, z_m. Raises `TrajectoryError`."""
    try:
        return _planned(read_path(file, period_s=cell.bus.cycle_s), cell)
    except CooperationError as error:
        raise TrajectoryError(str(error)) from None


def check_grips(position_rad: Floats, cell: Cell, source: str) -> None:
    """Raise `TrajectoryError` where joint angles (n, joints) would tear the object out of a hand."""
    chain = ClosedChain(cell)
    stride = -(-len(position_rad) // CHECKED_ROWS)
    for row in range(0, len(position_rad), stride):
        apart_m = math.hypot(*chain.gap(position_rad[row].tolist()))
        if apart_m > LOOSE_M:
            raise TrajectoryError(
                f"{source}: row {row + 1}: the slave's hand is {apart_m * 1e3:.3g} mm from where it holds the object; "
                f"at most {LOOSE_M * 1e3:g} mm: `canarm.cooperation` plans both robots"
            )


def slave_home_deg(cell: Cell) -> tuple[float, ...]:
    """Where the slave holds the object while the master is at home: the pose in which every path begins, degrees.

    Raises `CooperationError`, `RefusedPlanError` with its reason where there is none.
    """
    pair, start = _pair(cell)
    here = Path(cell.bus.cycle_s * np.arange(2, dtype=np.float64), np.zeros((2, 3)))
    found = np.degrees(plan_cooperation(pair, here, start).slave_rad[0])
    return tuple(round(angle, HOME_DIGITS) for angle in found.tolist())


def _pair(cell: Cell) -> tuple[ArmPair, Floats]:
    """Both arms with the object, and the master's home (5,), rad."""
    carried = cell.object
    assert carried is not None
    robots = {robot.name: robot for robot in cell.robot}
    master, slave = robots[carried.master], robots[carried.slave]
    bodies = CarriedObject(
        length_m=carried.length_m,
        grasp_distance_m=carried.grasp_distance_m,
        theta_x_deg=carried.theta_x_deg,
        theta_z_deg=carried.theta_z_deg,
    )
    return pair_of(master, slave, bodies), np.radians([joint.home_deg for joint in master.joint])


def _planned(path: Path, cell: Cell) -> tuple[Floats, Floats]:
    carried = cell.object
    assert carried is not None
    pair, start = _pair(cell)
    plan = plan_cooperation(pair, path, start)
    home = np.radians([joint.home_deg for joint in cell.joints])
    angles = np.tile(home, (len(plan.time_s), 1))
    for robot, own in zip(cell.robot, cell.blocks, strict=True):
        if robot.name == carried.master:
            angles[:, own] = plan.master_rad
        elif robot.name == carried.slave:
            angles[:, own] = plan.slave_rad
    return plan.time_s - plan.time_s[0], angles


class _Options:
    """The `KEY=VALUE` of a path."""

    def __init__(self, source: str, text: str, period_s: float) -> None:
        self._source, self.period_s = printable(source), period_s
        self._given: dict[str, str] = {}
        for part in text.split(",") if text else ():
            key, equals, value = part.partition("=")
            if not equals or key in self._given:
                raise TrajectoryError(f"{self._source}: {printable(part)!r}: must be KEY=VALUE, each key once")
            self._given[key] = value
        self._known: list[str] = []

    def number(self, key: str, usual: float) -> float:
        """A number; raises `TrajectoryError` if it is none."""
        self._known.append(key)
        text = self._given.pop(key, None)
        if text is None:
            return usual
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise TrajectoryError(f"{self._source}: {key}={printable(text)}: must be a number")
        return value

    def plane(self) -> str:
        """Two axes of the master's base; the paper's unless given."""
        self._known.append("plane")
        return self._given.pop("plane", "yz")

    def seconds(self) -> float:
        """Of one lap; raises `TrajectoryError` unless positive."""
        return self._positive("seconds", LAP_S)

    def laps(self) -> float:
        """How often; raises `TrajectoryError` unless positive."""
        return self._positive("laps", LAPS)

    def refuse_rest(self) -> None:
        """Raise `TrajectoryError` for a key that nobody has asked for."""
        for key in self._given:
            raise TrajectoryError(f"{self._source}: no option {printable(key)!r}; there are {', '.join(self._known)}")

    def _positive(self, key: str, usual: float) -> float:
        value = self.number(key, usual)
        if not value > 0.0:
            raise TrajectoryError(f"{self._source}: {key}={value:g}: must be positive")
        return value


def _circle(options: _Options) -> Path:
    laps, lap_s = options.laps(), options.seconds()
    return _turn(options, 360.0 * laps, laps * lap_s)


def _arc(options: _Options) -> Path:
    return _turn(options, options.number("angle_deg", ARC_DEG), options.seconds())


def _turn(options: _Options, angle_deg: float, seconds: float) -> Path:
    return arc(
        options.number("radius_mm", RADIUS_MM) * 1e-3,
        angle_deg,
        plane=options.plane(),
        start_deg=options.number("start_deg", 0.0),
        seconds=seconds,
        period_s=options.period_s,
        ease_s=min(EASE_S, seconds / 4),
    )


def _line(options: _Options) -> Path:
    """To and fro, each way along a straight line, slowest at its ends."""
    way_m = [options.number(f"{axis}_mm", LENGTH_MM if axis == "y" else 0.0) * 1e-3 for axis in "xyz"]
    laps, lap_s = options.laps(), options.seconds()
    once = line(way_m, seconds=laps * lap_s, period_s=options.period_s)
    share = 0.5 - 0.5 * np.cos(2.0 * np.pi * once.time_s / lap_s)
    return Path(once.time_s, share[:, np.newaxis] * np.array(way_m))


PATHS: dict[str, Callable[[_Options], Path]] = {"circle": _circle, "line": _line, "arc": _arc}
"""The first is the usual one."""
