"""What docs/rhino.md shows, computed: the paper's circle, its steps as printed, its claims, where a slave may stand.

Kinematics, and from `rhino_energy` what they cost; text and pictures must not enter.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rhino_energy import LapCost, cost_of

from canarm.cooperation import (
    RHINO_XR,
    ArmPair,
    Arrangement,
    CarriedObject,
    CooperationPlan,
    PlanChecks,
    Posture,
    ReachabilityMap,
    Reason,
    circle,
    comply,
    follow,
    forward,
    inverse_branch,
    least_motion,
    least_singular_value_m,
    plan_cooperation,
    printed_steps,
    reachability,
    seen_from,
)

Floats = NDArray[np.float64]

START = np.radians([0.0, -80.0, 90.0, -10.0, 90.0])
PAIR = ArmPair(master=RHINO_XR, slave=RHINO_XR, carried=CarriedObject(length_m=0.6), slave_base_m=(-0.28, -0.30, 0.0))
LAP, PAPER_LAP = circle(), circle(seconds=0.9)
"""At 400 Hz, 5 s a lap; and in 360 steps."""
MAP_LAP, SEARCH_LAP = circle(period_s=0.025), circle(period_s=0.1)
"""In 200 and 50 steps, where many are tried."""
ROLLS_DEG = (90.0, 75.0, 60.0, 30.0)
RANDOM_POSES = 20_000
X_M, Y_M = np.arange(-36, 41) * 0.025, np.arange(-48, 25) * 0.025
BESIDE_X_M, BESIDE_Y_M = np.arange(-18, 21) * 0.05, np.arange(-24, -5) * 0.05
"""Bases at least 0.3 m beside the master's: nearer ones work on paper alone."""
GRASPS_M = (0.2, 0.3, 0.4, 0.5, 0.6)


@dataclass(frozen=True)
class Printed:
    """The steps as printed along a lap: the yaw that they leave, and what an arm driven there passes over, degrees.

    `hand_deg` is how far the arm's hand then is from where the steps point; `across_deg` and `normal_deg` how far it is
    from Definition 1 put right.
    """

    least_yaw_deg: float
    greatest_yaw_deg: float
    hand_deg: float
    across_deg: float
    normal_deg: float


@dataclass(frozen=True)
class RandomPoses:
    """Random poses of the master and bases of the slave: which part of them has which reason, for the exact steps.

    Of those that work, `yaw_deg` are the yaws of the printed steps, and `across_deg` and `normal_deg` what an arm
    driven there misses of Definition 1, where it reaches the point at all.
    """

    shares: Mapping[Reason, float]
    yaw_deg: Floats
    across_deg: Floats
    normal_deg: Floats


@dataclass(frozen=True)
class Worst:
    """The base on the map from which the slave moves most, and how near it comes to trouble on the way."""

    x_m: float
    y_m: float
    axis_distance_m: float
    elbow_sine: float
    crossing: float


@dataclass(frozen=True)
class Results:
    """Everything on the page."""

    lap: CooperationPlan
    paper: PlanChecks
    drift_deg: float
    printed: Mapping[float, Printed]
    random: RandomPoses
    map: ReachabilityMap
    worst: Worst
    arrangements: list[Arrangement]
    way_of_b_m: tuple[float, float]
    """How far B goes in a lap, with the least and the greatest grasp distance."""
    cost: LapCost
    """Of the worked case."""
    worst_cost: LapCost
    costs: list[LapCost]
    """Of `arrangements`."""


def compute() -> Results:
    """All figures; some seconds."""
    lap = plan_cooperation(PAIR, LAP, START)
    paper = plan_cooperation(PAIR, PAPER_LAP, START, newton_steps=0)
    drift = np.degrees(np.abs(lap.master_rad[-1] - lap.master_rad[0]).max())
    objects = [CarriedObject(length_m=0.6, grasp_distance_m=distance) for distance in GRASPS_M]
    found = reachability(PAIR, MAP_LAP, START, X_M, Y_M)
    worst = worst_of(found)
    worst_pair = replace(PAIR, slave_base_m=(worst.x_m, worst.y_m, 0.0))
    arrangements = least_motion(PAIR, SEARCH_LAP, START, BESIDE_X_M, BESIDE_Y_M, objects=objects)
    return Results(
        lap=lap,
        paper=paper.checks(),
        drift_deg=float(drift),
        printed={roll: as_printed(roll) for roll in ROLLS_DEG},
        random=random_poses(),
        map=found,
        worst=worst,
        arrangements=arrangements,
        way_of_b_m=(way_of_b_m(GRASPS_M[0]), way_of_b_m(GRASPS_M[-1])),
        cost=cost_of(lap),
        worst_cost=cost_of(plan_cooperation(worst_pair, LAP, START)),
        costs=[cost_of(plan_cooperation(each.pair, MAP_LAP, START, posture=each.posture)) for each in arrangements],
    )


def worst_of(found: ReachabilityMap) -> Worst:
    """Of the feasible bases, the one from which the slave moves most."""
    row, column = np.unravel_index(np.nanargmax(found.travel_ratio), found.reason.shape)
    x_m, y_m = float(found.x_m[column]), float(found.y_m[row])
    pair = replace(PAIR, slave_base_m=(x_m, y_m, 0.0))
    plan = plan_cooperation(pair, LAP, START)
    seen = seen_from(pair.base_transform, plan.object_frame)
    crossing = comply(RHINO_XR, seen, plan.posture).crossing
    distance = np.hypot(seen[:, 0, 3], seen[:, 1, 3])
    sine = np.abs(np.sin(plan.slave_rad[:, 2]))
    return Worst(x_m, y_m, float(distance.min()), float(sine.min()), float(crossing.min()))


def way_of_b_m(distance_m: float) -> float:
    """How far B goes in a lap."""
    carried = replace(PAIR.carried, grasp_distance_m=distance_m)
    b = carried.frame(forward(RHINO_XR, follow(RHINO_XR, START, LAP.point_m + forward(RHINO_XR, START)[:3, 3])))
    return float(np.linalg.norm(np.diff(b[:, :3, 3], axis=0), axis=1).sum())


def as_printed(roll_deg: float) -> Printed:
    """Along the lap, the master's tool rolled, and the object turned in it so that it stays where it is."""
    start = START.copy()
    start[4] = np.radians(roll_deg)
    carried = replace(PAIR.carried, theta_x_deg=90.0 - roll_deg)
    q = follow(RHINO_XR, start, LAP.point_m + forward(RHINO_XR, start)[:3, 3])
    seen = seen_from(PAIR.base_transform, carried.frame(forward(RHINO_XR, q)))
    steps = printed_steps(seen)
    yaw_deg = np.degrees(steps.yaw_rad)
    hand, across, normal, _ = driven(seen, steps.third)
    return Printed(
        float(yaw_deg.min()), float(yaw_deg.max()), float(hand.max()), float(across.max()), float(normal.max())
    )


def driven(seen: Floats, aim: Floats) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
    """What an arm reaches that is driven to `aim` with its yaw passed over: angles in degrees, and where it gets there.

    Between its hand and that of `aim`, between its hand and Definition 1's plane, and between its normal and a_o.
    """
    found = inverse_branch(RHINO_XR, aim, yaw_tolerance=np.inf)
    tip = forward(RHINO_XR, found.q_rad[found.found])
    hand, normal, a_o = tip[:, :3, 2], tip[:, :3, 0], seen[found.found][:, :3, 2]
    across = np.degrees(np.arcsin(np.clip(np.abs((hand * a_o).sum(axis=1)), 0.0, 1.0)))
    return angle_deg(hand, aim[found.found][:, :3, 2]), across, angle_deg(normal, a_o), found.found


def angle_deg(a: Floats, b: Floats) -> Floats:
    """Between vectors (n, 3); exact for small ones too."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))


def random_poses() -> RandomPoses:
    """Master in any pose away from singular ones, with its tip above the floor; slave's base within 1 m of its own."""
    random = np.random.default_rng(1986)
    q = random.uniform(-np.pi, np.pi, (4 * RANDOM_POSES, 5))
    tip = forward(RHINO_XR, q)
    usable = (tip[:, 2, 3] > 0.0) & (least_singular_value_m(RHINO_XR, q) > 0.03)
    tip = tip[usable][:RANDOM_POSES]
    radius, angle = np.sqrt(random.uniform(0.0, 1.0, len(tip))), random.uniform(-np.pi, np.pi, len(tip))
    seen = PAIR.carried.frame(tip)
    seen[:, 0, 3] -= radius * np.cos(angle)
    seen[:, 1, 3] -= radius * np.sin(angle)
    exact = comply(RHINO_XR, seen[:, None], Posture(), least_axis_distance_m=0.01)
    reason = exact.reason[:, 0]
    counts = Counter(Reason(int(each)) for each in reason)
    working = seen[reason == Reason.NONE]
    steps = printed_steps(working)
    _, across, normal, _ = driven(working, steps.third)
    return RandomPoses(
        {each: count / len(reason) for each, count in counts.most_common()},
        np.degrees(steps.yaw_rad),
        across,
        normal,
    )
