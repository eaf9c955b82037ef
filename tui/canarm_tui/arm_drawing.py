"""A picture of a cell's arms in braille dots: projection to a plane, lines, trail. Arrays in and out; no widget.

The picture has one of two scales for a cell: what its joints reach one at a time, the others at home, near home or
in all of their range.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.rigid import from_rpy_deg

from .braille import DOTS_X, DOTS_Y, pack_dots
from .kinematics import Floats, joint_places

SWEEP_POSES = 13
NEAR_DEG = 60.0
"""Arms that stay this near home are drawn larger."""
SLACK_M = 0.02
MARGIN = 1.05
FLAT = 0.1
"""A side view whose height is less than this share of what the top shows is not the first choice."""
_AXES = "xyz"
_JOINT_DOTS = np.array([[x, y] for x in range(-1, 3) for y in range(-1, 3) if x * (x - 1) + y * (y - 1) < 4])
"""A disc of four dots across about the two dots of a thick line."""


class Layer(IntEnum):
    """What a dot belongs to; where several meet in a cell, the last one gives the colour."""

    GROUND = 0
    TRAIL = 1
    REFERENCE = 2
    OBJECT = 3
    TRUE = 4


@dataclass(frozen=True, slots=True)
class Projection:
    """A view of the world: the directions that point right and up on the screen, and what has to fit, in m."""

    name: str
    right: Floats
    up: Floats
    low_m: Floats
    high_m: Floats
    far_low_m: Floats
    """As `low_m` and `high_m`, for poses that they do not contain."""
    far_high_m: Floats

    def box(self, *flat_m: Floats) -> tuple[Floats, Floats]:
        """What has to fit, so that all places (..., 2) of `flat_m` do."""
        is_near = all((each >= self.low_m - SLACK_M).all() and (each <= self.high_m + SLACK_M).all() for each in flat_m)
        return (self.low_m, self.high_m) if is_near else (self.far_low_m, self.far_high_m)

    def flat(self, places_m: Floats) -> Floats:
        """Places (..., 3) as (..., 2): to the right, and up."""
        return np.stack([places_m @ self.right, places_m @ self.up], axis=-1)


def projections(cell: Cell) -> tuple[Projection, ...]:
    """From the side that shows most of the arms, and what they carry not end-on; from the other side, and from above; a
    flat arm's plane first.
    """
    robot = cell.robot[0]
    down = np.array(from_rpy_deg(robot.base_rpy_deg)) @ np.array(robot.gravity_m_s2)
    axis = int(np.argmax(np.abs(down)))
    up = -np.sign(down[axis]) * np.eye(3)[axis] if down.any() else np.eye(3)[2]
    one, other = (np.eye(3)[each] for each in range(3) if not np.eye(3)[each] @ up)
    reach = _reach(cell, NEAR_DEG), _reach(cell, 360.0)
    hands = _hands(cell, joint_places(cell, _home(cell)[np.newaxis]))

    def shown(view: Projection) -> tuple[bool, float]:
        along = view.flat(hands[1] - hands[0])
        return bool(np.hypot(*along) >= FLAT * np.linalg.norm(hands[1] - hands[0])), _area(view)

    sides = sorted((_view("side view", each, up, reach) for each in (one, other)), key=shown, reverse=True)
    top = _view("top view", one, other, reach)
    height = float(np.subtract(sides[0].high_m, sides[0].low_m)[1])
    views = (*sides, top) if height > FLAT * float(np.max(top.high_m - top.low_m)) else (top, *sides)
    return tuple(each for each in views if min(each.high_m - each.low_m) > 1e-6) or views[:1]


def _view(name: str, right: Floats, up: Floats, reach: tuple[Floats, Floats]) -> Projection:
    along = "".join(_AXES[int(np.argmax(np.abs(each)))] for each in (right, up))
    near, far = (np.stack([places @ right, places @ up], axis=-1) for places in reach)
    boxes = near.min(axis=0), near.max(axis=0), far.min(axis=0), far.max(axis=0)
    return Projection(f"{name} {along[0]}–{along[1]}", right, up, *boxes)


def _area(view: Projection) -> float:
    return float(np.prod(view.high_m - view.low_m))


def _reach(cell: Cell, sweep_deg: float) -> Floats:
    """Places (n, 3) of all joints while each one goes so far from home both ways, as its range allows."""
    home = _home(cell)
    poses = [home]
    for number, joint in enumerate(cell.joints):
        low, high = joint.limits_deg
        begin, end = max(low, joint.home_deg - sweep_deg), min(high, joint.home_deg + sweep_deg)
        for angle in np.radians(np.linspace(begin, end, SWEEP_POSES)):
            pose = home.copy()
            pose[number] = angle
            poses.append(pose)
    return np.concatenate([each.reshape(-1, 3) for each in joint_places(cell, np.array(poses))])


def _home(cell: Cell) -> Floats:
    return np.radians([joint.home_deg for joint in cell.joints])


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """What is to be drawn: true and reference angles (joints,) in rad, NaN where not known; those of the trail (n,
    joints).
    """

    true_rad: Floats
    reference_rad: Floats
    trail_rad: Floats


def drawing(
    cell: Cell, view: Projection, pose: Pose, rows: int, cells: int
) -> tuple[NDArray[np.uint8], NDArray[np.int8]]:
    """Braille bits (rows, cells), and the `Layer` of each cell, −1 where it is empty."""
    layers = np.zeros((len(Layer), DOTS_Y * rows, DOTS_X * cells), dtype=np.bool_)
    trail = pose.trail_rad[np.isfinite(pose.trail_rad).all(axis=1)]
    tips = [view.flat(places[:, -1]) for places in joint_places(cell, trail)] if len(trail) else []
    poses = ((pose.reference_rad, Layer.REFERENCE), (pose.true_rad, Layer.TRUE))
    arms = {
        layer: [view.flat(each[0]) for each in joint_places(cell, angles[np.newaxis])]
        for angles, layer in poses
        if np.isfinite(angles).all()
    }
    low_m, high_m = view.box(*tips, *(chain for chains in arms.values() for chain in chains))
    middle, room = (high_m + low_m) / 2, np.array([DOTS_X * cells - 2, DOTS_Y * rows - 2])
    scale = float(np.min(room / (MARGIN * np.maximum(high_m - low_m, 1e-6))))

    def dots(flat_m: Floats) -> Floats:
        offset = (flat_m - middle) * scale
        return np.stack([room[0] / 2 + offset[..., 0], room[1] / 2 - offset[..., 1]], axis=-1)

    for tip in tips:
        _dot(layers[Layer.TRAIL], dots(tip))
    for layer, flat in arms.items():
        chains = [dots(chain) for chain in flat]
        for chain in chains:
            _chain(layers[layer], chain, is_thick=layer is Layer.TRUE)
            _line(layers[Layer.GROUND], chain[0] + [-6, 3], chain[0] + [6, 3])
        if layer is Layer.TRUE and cell.object is not None:
            begin, end = _hands(cell, [chain[np.newaxis] for chain in chains])
            for below in np.array([[0, 0], [0, 1], [0, 2]]):
                _line(layers[Layer.OBJECT], begin + below, end + below)
    top = np.full((rows, cells), -1, dtype=np.int8)
    packed = pack_dots(layers)
    for layer in Layer:
        top[packed[layer] != 0] = layer
    return np.bitwise_or.reduce(packed, axis=0), top


def _hands(cell: Cell, places: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Where the two hands are that carry the object; of a cell without one, the first robot's hand, twice."""
    names = [robot.name for robot in cell.robot]
    master, slave = (0, 0) if cell.object is None else (names.index(cell.object.master), names.index(cell.object.slave))
    return places[master][0, -1], places[slave][0, -1]


def _chain(dots: NDArray[np.bool_], chain: Floats, is_thick: bool) -> None:
    for begin, end in itertools.pairwise(chain):
        _line(dots, begin, end, 1 if is_thick else 3)
        if is_thick:
            across = [0, 1] if abs(end[0] - begin[0]) > abs(end[1] - begin[1]) else [1, 0]
            _line(dots, begin + across, end + across)
    if is_thick:
        _dot(dots, (chain[:-1, np.newaxis] + _JOINT_DOTS).reshape(-1, 2))


def _line(dots: NDArray[np.bool_], begin: Floats, end: Floats, every: int = 1) -> None:
    count = min(int(np.max(np.abs(end - begin))) + 2, 4 * sum(dots.shape))
    _dot(dots, np.linspace(begin, end, count)[::every])


def _dot(dots: NDArray[np.bool_], places: Floats) -> None:
    x, y = np.rint(places).astype(np.int64).T
    inside = (x >= 0) & (x < dots.shape[1]) & (y >= 0) & (y < dots.shape[0])
    dots[y[inside], x[inside]] = True
