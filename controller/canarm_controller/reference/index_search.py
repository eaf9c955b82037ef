"""The move that leads every joint past a pulse of its encoder's index, from wherever it is parked about home.

Owns which way each joint goes, and how far. What the pulses say belongs to the run.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from canarm_protocol.cell.control import Homing
from canarm_protocol.cell.homing import IndexMark, index_marks
from canarm_protocol.cell.model import Cell

from ..dynamics import ClosedChain
from ..errors import TrajectoryError
from .base import Trajectory
from .file_trajectory import PEAK, Approached
from .limits import Floats
from .moved import Rest

SPARE_COUNTS = 2.0
"""A joint goes so much further than to its pulse, for it follows its reference as well as a count allows."""
SETTLING_S = 0.4
"""Rest after the move: laws bring the last joints past their pulses."""
MOST_PATTERNS = 4096
PROJECTIONS = 200
CORRECTIONS = 4
LONGEST = 20.0
"""Where robots carry an object, no joint goes more than so many times as far as the nearest pulse asks for."""
ALIKE = 9
"""Decimals, rad, to which moves are compared: what the rounding of a processor's own arithmetic does not reach."""


class IndexSearch:
    """The search of one cell: `marks` are its indices, `legs_rad` where the joints (joints,) go in turn, from home.

    No joint is parked further than `within_rad` from home.
    """

    def __init__(self, cell: Cell, homing: Homing) -> None:
        """Raises `TrajectoryError` where a joint has no room for it, or the grips of an object allow no such move."""
        self.marks = index_marks(cell)
        self.within_rad = math.radians(homing.parked_within_deg)
        self._speed_rad_s = math.radians(homing.speed_deg_s)
        self._period_s = cell.bus.cycle_s
        self._chain = ClosedChain.of(cell)
        self.legs_rad = (
            _apart(cell, self.marks, self.within_rad)
            if self._chain is None
            else _together(cell, self.marks, self.within_rad)
        )

    def move(self, start_rad: Sequence[float], planned: Trajectory) -> tuple[Trajectory, int]:
        """The move from `start_rad`, and the cycle at which it is over. Raises `TrajectoryError` if it is impossible.

        `planned` is the run's own trajectory, whose limits hold.
        """
        start = np.array(start_rad)
        stops = [start, *(self._held(start, start + leg) for leg in self.legs_rad)]
        move: Trajectory = Rest(planned.limits, stops[-1], planned.amplitude_rad)
        duration_s = 0.0
        for begin, end in reversed(list(itertools.pairwise(stops))):
            first = move.sample(0, 1, self._period_s)
            leg = Approached(move, begin, first, max(self.slow_s(begin, end), self._period_s))
            move, duration_s = leg, duration_s + leg.approach_s
        planned.limits.check(move, duration_s, "homing by the encoders' index")
        return move, math.ceil((duration_s + SETTLING_S) / self._period_s)

    def slow_s(self, from_rad: Floats, to_rad: Floats) -> float:
        """How long a move from rest to rest takes in which no joint is faster than the cell says, s."""
        return PEAK * float(np.abs(to_rad - from_rad).max()) / self._speed_rad_s

    def _held(self, start: Floats, end: Floats) -> Floats:
        """The end of the move, corrected so that the hands are where they were at the object."""
        chain = self._chain
        if chain is None:
            return end
        apart, still = np.array(chain.gap(start.tolist())), [0.0] * len(end)
        for _ in range(CORRECTIONS):
            rows, _ = chain.constraint(end.tolist(), still)
            end = end - np.linalg.pinv(rows) @ (np.array(chain.gap(end.tolist())) - apart)
        return end


def _ways(mark: IndexMark, within_rad: float) -> tuple[float, float]:
    """How far the joint must go ahead or back, rad, to pass a pulse from anywhere within `within_rad` of home."""
    home_rad, period_rad = mark.home_rad, mark.period_rad

    def way(at_rad: float) -> float:
        beyond = math.ceil((at_rad + within_rad) / period_rad) * period_rad  # ahead wherever it is parked
        return min(beyond - at_rad + within_rad, period_rad) + SPARE_COUNTS * mark.scale.lsb

    return way(home_rad), way(-home_rad)


def _to_and_fro(mark: IndexMark, within_rad: float) -> tuple[float, float] | None:
    """From home how far ahead, and how far back, to pass a pulse that may be on either side; None if there is none."""
    home_rad, period_rad = mark.home_rad, mark.period_rad
    off_rad = round(home_rad / period_rad) * period_rad - home_rad
    reach_rad = within_rad + SPARE_COUNTS * mark.scale.lsb
    return None if abs(off_rad) >= reach_rad else (reach_rad + off_rad, off_rad - reach_rad)


def _apart(cell: Cell, marks: Sequence[IndexMark], within_rad: float) -> tuple[Floats, ...]:
    """Each joint goes the shortest way that its limits allow: ahead, back, or a little to and fro."""
    legs = np.zeros((2, len(cell.joints)))
    for mark in marks:
        joint = cell.joints[mark.joint]
        low, high = (math.radians(limit - joint.home_deg) for limit in joint.limits_deg)
        ahead, back = _ways(mark, within_rad)
        choices = [(ahead, ahead), (-back, -back)]
        both = _to_and_fro(mark, within_rad)
        if both is not None:
            choices += [both, both[::-1]]
        possible = [each for each in choices if low <= min(each) and max(each) <= high]
        if not possible:
            raise TrajectoryError(
                f"homing: {cell.joint_names[mark.joint]} would have to turn by {math.degrees(ahead):.4g} or "
                f"{-math.degrees(back):.4g} deg from home_deg = {joint.home_deg:g} to pass a pulse of its encoder's "
                f"index; limits_deg = [{joint.limits_deg[0]:g}, {joint.limits_deg[1]:g}]: park it nearer to a pulse, "
                "or leave [control.homing] out"
            )
        legs[:, mark.joint] = min(possible, key=lambda each: abs(each[0]) + abs(each[1] - each[0]))
    return (legs[0], legs[1]) if (legs[0] != legs[1]).any() else (legs[0],)


def _together(cell: Cell, marks: Sequence[IndexMark], within_rad: float) -> tuple[Floats, ...]:
    """The joints go in directions in which the object stays in both hands: C·Δq = 0, and far enough each.

    For every pattern of directions, projections in turn on what the grips allow and on what the pulses ask for; of the
    patterns for which that ends well, the one in which no joint goes far; of those alike, that in which all go least.
    """
    chain = ClosedChain(cell)
    home = [math.radians(joint.home_deg) for joint in cell.joints]
    rows, _ = chain.constraint(home, [0.0] * len(home))
    allowed = np.eye(len(home)) - np.linalg.pinv(rows) @ rows
    signs = _patterns(len(marks))
    ways = [_ways(mark, within_rad) for mark in marks]
    least = np.where(signs > 0.0, *(np.array(column) for column in zip(*ways, strict=True)))
    searching = [mark.joint for mark in marks]
    travel = np.zeros((len(signs), len(home)))
    travel[:, searching] = signs * least
    for _ in range(PROJECTIONS):
        travel = travel @ allowed
        travel[:, searching] = signs * np.maximum(signs * travel[:, searching], least)
    travel = travel @ allowed
    with np.errstate(divide="ignore"):
        short = np.where(signs * travel[:, searching] > 0.0, least / np.abs(travel[:, searching]), np.inf).max(axis=1)
    factor = np.where(np.isfinite(short), np.maximum(short, 1.0), np.inf)
    longest, together = np.abs(travel).max(axis=1) * factor, np.abs(travel).sum(axis=1) * factor
    best = int(np.lexsort((together.round(ALIKE), longest.round(ALIKE)))[0])
    if not longest[best] <= LONGEST * least.max():
        raise TrajectoryError(
            "homing: no motion that leaves the object in both hands brings every joint past a pulse of its encoder's "
            "index; park the robots otherwise, or leave [control.homing] out"
        )
    return (travel[best] * max(float(short[best]), 1.0),)


def _patterns(count: int) -> Floats:
    """Directions of `count` joints, one pattern a row: all of them, or as many as `MOST_PATTERNS` drawn ones."""
    if 2**count <= MOST_PATTERNS:
        return np.array(list(itertools.product((1.0, -1.0), repeat=count)))
    return np.random.default_rng(0).choice((1.0, -1.0), (MOST_PATTERNS, count))
