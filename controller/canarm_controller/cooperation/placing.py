"""Where the slave's base may stand, why not elsewhere, and where it has to move least.

Knows neither tables nor other obstacles: an arm may cross the object, the other arm or the floor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import CooperationError
from .carrying import ArmPair, CarriedObject, seen_from
from .closed_form import Codes
from .compliance import Posture
from .kinematics import Floats
from .leading import MasterMotion, lead
from .limits import PlanLimits
from .paths import Path
from .plan import travel_rad
from .reasons import Reason
from .supporting import support

POSTURES = tuple(
    Posture(approach=approach, elbow=elbow, facing=facing)
    for approach in (1, -1)
    for elbow in (1, -1)
    for facing in (1, -1)
)
"""All postures that differ in how far the slave moves; s₃ only turns the roll by 180°."""
_POSES_AT_ONCE = 50_000
MOST_POSES = 200_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ReachabilityMap:
    """What a path comes to for slave bases at `x_m` (nx,) and `y_m` (ny,) in the master's base; arrays are (ny, nx).

    `reason` is of `Reason`, `pose` the first pose that fails (0 where none does), `travel_ratio` the slave's joint path
    over the master's, and `largest_step_rad` of any of the slave's joints; both NaN where it fails.
    """

    x_m: Floats
    y_m: Floats
    reason: Codes
    pose: NDArray[np.intp]
    travel_ratio: Floats
    largest_step_rad: Floats

    def shares(self) -> dict[Reason, float]:
        """Which part of the placements has which reason, those without any left out."""
        return {reason: float((self.reason == reason).mean()) for reason in Reason if (self.reason == reason).any()}


@dataclass(frozen=True, slots=True)
class Arrangement:
    """A pair and a posture in which the path works, and how far the slave moves: its joint path over the master's."""

    pair: ArmPair
    posture: Posture
    travel_ratio: float
    largest_step_rad: float


def reachability(
    pair: ArmPair,
    path: Path,
    master_start_rad: ArrayLike,
    x_m: ArrayLike,
    y_m: ArrayLike,
    *,
    posture: Posture | None = None,
    limits: PlanLimits | None = None,
) -> ReachabilityMap:
    """Try the slave's base at every x and y in m, at the height and turned as in `pair`.

    Raises `RefusedPlanError` where the master cannot follow the path, wherever the slave stands, and `CooperationError`
    for a grid that is not two lists of finite numbers, or has more than 2·10⁸ poses.
    """
    limits = limits or PlanLimits()
    master = lead(pair, path, master_start_rad, limits=limits)
    return _map(pair, master, _axis("x_m", x_m), _axis("y_m", y_m), posture or Posture(), limits)


def least_motion(
    pair: ArmPair,
    path: Path,
    master_start_rad: ArrayLike,
    x_m: ArrayLike,
    y_m: ArrayLike,
    *,
    objects: Sequence[CarriedObject] = (),
    postures: Sequence[Posture] = POSTURES,
    limits: PlanLimits | None = None,
) -> list[Arrangement]:
    """For each object and posture the base in which the slave moves least, the best first; none where none works.

    `objects` differ in where the slave takes hold; the pair's own unless given. Raises as `reachability`.
    """
    limits = limits or PlanLimits()
    master = lead(pair, path, master_start_rad, limits=limits)
    x, y = _axis("x_m", x_m), _axis("y_m", y_m)
    found = []
    for carried in objects or (pair.carried,):
        for posture in postures:
            candidate = replace(pair, carried=carried)
            tried = _map(candidate, master, x, y, posture, limits)
            if np.isnan(tried.travel_ratio).all():
                continue
            row, column = np.unravel_index(np.nanargmin(tried.travel_ratio), tried.reason.shape)
            base = float(x[column]), float(y[row]), pair.slave_base_m[2]
            found.append(
                Arrangement(
                    replace(candidate, slave_base_m=base),
                    posture,
                    float(tried.travel_ratio[row, column]),
                    float(tried.largest_step_rad[row, column]),
                )
            )
    return sorted(found, key=lambda each: each.travel_ratio)


def _map(
    pair: ArmPair, master: MasterMotion, x_m: Floats, y_m: Floats, posture: Posture, limits: PlanLimits
) -> ReachabilityMap:
    frame = pair.carried.frame(master.tip)
    if len(x_m) * len(y_m) * len(frame) > MOST_POSES:
        raise CooperationError(
            f"{len(x_m)} x {len(y_m)} places and {len(frame)} poses; must be at most {MOST_POSES:.0e} poses in all: "
            "take a coarser grid, or a path with a longer period"
        )
    led = travel_rad(master.q_rad)
    count = len(x_m) * len(y_m)
    reason, pose = np.zeros(count, np.int8), np.zeros(count, np.intp)
    ratio, step = np.full(count, np.nan), np.full(count, np.nan)
    for part, bases in _bases(pair, x_m, y_m, max(1, _POSES_AT_ONCE // len(frame))):
        moved = support(pair.slave, seen_from(bases, frame), posture, limits)
        works = moved.reason == Reason.NONE
        reason[part], pose[part] = moved.reason, moved.pose
        ratio[part] = np.where(works, travel_rad(moved.q_rad) / led, np.nan)
        step[part] = np.where(works, moved.largest_step_rad, np.nan)
    shape = len(y_m), len(x_m)
    return ReachabilityMap(
        x_m, y_m, reason.reshape(shape), pose.reshape(shape), ratio.reshape(shape), step.reshape(shape)
    )


def _bases(pair: ArmPair, x_m: Floats, y_m: Floats, at_once: int) -> Iterator[tuple[slice, Floats]]:
    """The pair's w* at every place, row by row, some at once: which ones, and (places, 4, 4)."""
    places = np.stack([np.tile(x_m, len(y_m)), np.repeat(y_m, len(x_m))], axis=1)
    for start in range(0, len(places), at_once):
        part = slice(start, min(start + at_once, len(places)))
        bases = np.tile(pair.base_transform, (part.stop - start, 1, 1))
        bases[:, :2, 3] = places[part]
        yield part, bases


def _axis(name: str, values: ArrayLike) -> Floats:
    try:
        axis = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise CooperationError(f"{name} must be a list of numbers in m") from None
    if axis.ndim != 1 or not len(axis) or not np.isfinite(axis).all():
        raise CooperationError(f"{name} has shape {axis.shape}; must be a list of finite numbers in m")
    return axis
