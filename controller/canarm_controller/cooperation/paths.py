"""Paths of the point A: circle, arc, line, and any points over time, for any arm.

A path is points over time, equally far apart: the master's tip follows it, pose by pose.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from ..errors import CooperationError
from .kinematics import Floats

INCH_M = 0.0254
PAPER_RADIUS_M = 0.5 * INCH_M
"""The paper's "0.5 inch circle". Of what, it does not say; taken for the radius. Half of it, if it is the diameter."""
PERIOD_S = 0.0025
LAP_S = 5.0
MOST_POSES = 1_000_000
"""41 minutes at 400 Hz: a plan of so many takes seconds."""
_PLANES = {"xy": (0, 1), "yz": (1, 2), "zx": (2, 0), "yx": (1, 0), "zy": (2, 1), "xz": (0, 2)}


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Points (n, 3) in m at times (n,) in s, along the axes of the master's base.

    With `from_start` they are displacements from where the master's tip is at the start, and the first one is 0;
    without it they are positions in the master's base. Raises `CooperationError` for other shapes, fewer than 2 points,
    numbers that are not finite, and times that do not increase.
    """

    time_s: Floats
    point_m: Floats
    from_start: bool = True

    def __post_init__(self) -> None:
        try:
            time_s, point_m = np.array(self.time_s, dtype=np.float64), np.array(self.point_m, dtype=np.float64)
        except (TypeError, ValueError):
            raise CooperationError("times and points of a path must be numbers") from None
        if time_s.ndim != 1 or point_m.shape != (len(time_s), 3) or len(time_s) < 2:
            raise CooperationError(
                f"a path has times {time_s.shape} and points {point_m.shape}; must be (n,) and (n, 3), n at least 2"
            )
        if not np.isfinite(time_s).all() or not np.isfinite(point_m).all():
            raise CooperationError("a time or a point of the path is not finite")
        late = np.flatnonzero(np.diff(time_s) <= 0.0)
        if len(late):
            row = int(late[0]) + 1
            raise CooperationError(
                f"point {row} of the path at {time_s[row]:g} s; must be later than the one before it"
            )
        if self.from_start and np.any(point_m[0] != 0.0):
            raise CooperationError(f"the first displacement is {point_m[0].tolist()} m; must be 0, where the tip is")
        object.__setattr__(self, "time_s", time_s)
        object.__setattr__(self, "point_m", point_m)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def length_m(self) -> float:
        """Length of the path, m."""
        return float(np.sqrt((np.diff(self.point_m, axis=0) ** 2).sum(axis=1)).sum())

    def resampled(self, period_s: float = PERIOD_S) -> Self:
        """The same path, every `period_s` seconds: straight lines at even speed between the points that are given."""
        time_s = _times(float(self.time_s[-1] - self.time_s[0]), period_s)
        given = self.time_s - self.time_s[0]
        point_m = np.stack([np.interp(time_s, given, each) for each in self.point_m.T], axis=1)
        return type(self)(time_s, point_m, self.from_start)


def circle(
    radius_m: float = PAPER_RADIUS_M,
    *,
    plane: str = "yz",
    start_deg: float = 0.0,
    laps: float = 1.0,
    seconds: float = LAP_S,
    period_s: float = PERIOD_S,
    ease_s: float = 0.0,
) -> Path:
    """`laps` of a circle, each in `seconds`; the paper's one unless another is asked for.

    `plane` names its first and second axis: it is run through from the first to the second, beginning where the tip is,
    `start_deg` from the first axis. With `ease_s`, the speed ramps up from 0 within that many seconds, and down to 0 at
    the end.
    """
    return arc(
        radius_m,
        360.0 * laps,
        plane=plane,
        start_deg=start_deg,
        seconds=seconds * abs(laps),
        period_s=period_s,
        ease_s=ease_s,
    )


def arc(
    radius_m: float,
    angle_deg: float,
    *,
    plane: str = "yz",
    start_deg: float = 0.0,
    seconds: float = LAP_S,
    period_s: float = PERIOD_S,
    ease_s: float = 0.0,
) -> Path:
    """Part of a circle as by `circle`, `angle_deg` long (negative: the other way round), in `seconds` in all."""
    if plane not in _PLANES:
        raise CooperationError(f"plane {plane!r}; must be one of {', '.join(_PLANES)}")
    if not 0.0 < radius_m < math.inf:
        raise CooperationError(f"radius_m = {radius_m}; must be positive, in metres")
    if not (math.isfinite(angle_deg) and angle_deg != 0.0 and math.isfinite(start_deg)):
        raise CooperationError(f"an arc of {angle_deg} deg from {start_deg} deg; must be finite, and not 0 long")
    time_s, progress = _progress(seconds, period_s, ease_s)
    start = math.radians(start_deg)
    angle = start + math.radians(angle_deg) * progress
    point_m = np.zeros((len(time_s), 3))
    first, second = _PLANES[plane]
    point_m[:, first] = radius_m * (np.cos(angle) - math.cos(start))
    point_m[:, second] = radius_m * (np.sin(angle) - math.sin(start))
    point_m[0] = 0.0
    return Path(time_s, point_m)


def line(by_m: Sequence[float], *, seconds: float = LAP_S, period_s: float = PERIOD_S, ease_s: float = 0.0) -> Path:
    """A straight line from where the tip is, by three numbers in m, in `seconds`."""
    by = np.asarray(by_m, dtype=np.float64)
    if by.shape != (3,) or not np.isfinite(by).all() or not by.any():
        raise CooperationError(f"a line by {by_m}; must be three finite numbers in m, not all 0")
    time_s, progress = _progress(seconds, period_s, ease_s)
    return Path(time_s, progress[:, None] * by)


def through(point_m: ArrayLike, time_s: ArrayLike, *, period_s: float = PERIOD_S, from_start: bool = False) -> Path:
    """Straight lines through points (n, 3) in m at times (n,) in s, every `period_s`."""
    return Path(np.asarray(time_s, float), np.asarray(point_m, float), from_start).resampled(period_s)


def _progress(seconds: float, period_s: float, ease_s: float) -> tuple[Floats, Floats]:
    """Times, and how much of the path is done by then, 0 to 1: even speed, but for x²(3 − 2x) of it at both ends."""
    time_s = _times(seconds, period_s)
    if not 0.0 <= ease_s <= seconds / 2:
        raise CooperationError(f"ease_s = {ease_s}; must be from 0 to half of the path's {seconds:g} s")
    if ease_s == 0.0:
        return time_s, time_s / time_s[-1]
    left = np.minimum(np.minimum(time_s, time_s[-1] - time_s) / ease_s, 1.0)
    # The integral of x²(3 − 2x) is x³ − x⁴/2, which is ½ at 1.
    eased = np.where(left < 1.0, ease_s * (left**3 - left**4 / 2), np.minimum(time_s, time_s[-1] - time_s) - ease_s / 2)
    done = eased / (time_s[-1] - ease_s)
    return time_s, np.where(time_s <= time_s[-1] / 2, done, 1.0 - done)


def _times(seconds: float, period_s: float) -> Floats:
    """0 to `seconds`, in steps as near to `period_s` as even ones can be."""
    if not 0.0 < seconds < math.inf or not 0.0 < period_s <= seconds:
        raise CooperationError(f"{seconds} s in steps of {period_s} s; must be positive, and at least one step")
    if seconds / period_s > MOST_POSES:
        raise CooperationError(f"{seconds:g} s in steps of {period_s:g} s; must be at most {MOST_POSES} poses")
    return np.linspace(0.0, seconds, round(seconds / period_s) + 1)
