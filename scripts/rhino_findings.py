"""What docs/rhino.md says in sentences: each takes its figures from the results and says when it would be false."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from rhino_figures import GRASPS_M, Results

from canarm.cooperation import Arrangement


@dataclass(frozen=True)
class Finding:
    """A sentence or two of the page, and whether the figures bear them out."""

    text: str
    holds: bool


def percent(share: float) -> str:
    """A share, with one digit behind the point, two where it is small."""
    return f"{100.0 * share:.1f} %" if share >= 0.001 else f"{100.0 * share:.2f} %"


def by_grasp(results: Results) -> dict[float, Arrangement]:
    """The arrangement of least motion for each grasp distance, m."""
    found: dict[float, Arrangement] = {}
    for each in results.arrangements:  # the best first
        found.setdefault(each.pair.carried.distance_m, each)
    return dict(sorted(found.items()))


def as_printed(results: Results) -> Finding:
    """How often the printed steps lead somewhere."""
    random = results.random
    reached = len(random.across_deg) / len(random.yaw_deg)
    small = float(np.mean(random.yaw_deg < 1.0))
    return Finding(
        f"The printed steps have a yaw below 1° in {percent(small)} of them; the exact ones have none at all. "
        f"Driven there, the arm reaches the point in {percent(reached)} of them, and misses Definition 1 by what "
        "stands above.",
        small < 0.05 and reached < 0.95,
    )


def continuity(results: Results) -> Finding:
    """Where joint paths are continuous."""
    step = math.degrees(results.lap.checks().slave_step_rad)
    largest = math.degrees(np.nanmax(results.map.largest_step_rad))
    return Finding(
        f"True for the worked case: at 400 Hz no joint of the slave turns by more than {step:.3f}° from one pose to "
        "the next. Not true wherever there is a solution at every pose: the waist swings round where B passes the "
        "slave's axis, the hand where a_o crosses h. Both are refused here. Of the bases on the map that work, the "
        f"worst has steps of {largest:.1f}° in 200 poses a lap, {largest / (step * 10):.0f} times those of the worked "
        "case.",
        step < 0.02 and largest > 1.0,
    )


def motion(results: Results) -> list[Finding]:
    """What makes the slave move less."""
    best, worst = results.arrangements[0], results.worst
    near, far = (1e3 * way for way in results.way_of_b_m)
    ratios = [each.travel_ratio for each in by_grasp(results).values()]
    outward, inward = (_least(results, "approach", sign) for sign in (1, -1))
    up, down = (_least(results, "elbow", sign) for sign in (1, -1))
    return [
        Finding(
            f"The base is worth most: from {results.lap.travel_ratio:.2f} to {best.travel_ratio:.2f}, and up to "
            f"{np.nanmax(results.map.travel_ratio):.0f} in a bad place, where the arm is nearly folded or B is near "
            "the slave's axis.",
            best.travel_ratio < 0.8 * results.lap.travel_ratio
            and (worst.elbow_sine < 0.3 or worst.axis_distance_m < 0.1),
        ),
        Finding(
            "A grasp nearer to the master is better. (5) turns the object as it leads it, and so B's way grows with "
            f"the grasp distance: {near:.0f} mm a lap at {GRASPS_M[0]:g} m, {far:.0f} mm at {GRASPS_M[-1]:g} m.",
            all(a <= b + 1e-6 for a, b in pairwise(ratios)) and near < far,
        ),
        Finding(
            "s₂ = +1, with which the hand points away from the slave's base here, gives "
            f"{outward:.2f}, s₂ = −1 gives {inward:.2f}.",
            outward < inward,
        ),
        Finding(
            "The elbow matters little, and s₃ not at all: it turns the roll by 180° and leaves the path's length as "
            "it is.",
            abs(up - down) < 0.05,
        ),
    ]


def energy(results: Results) -> list[Finding]:
    """What the slave's motion costs, and what would cost less."""
    cost, worst, motion = results.cost, results.worst_cost, results.costs[0]
    cheapest = min(range(len(results.costs)), key=lambda place: results.costs[place].slave.work_j)
    least, arrangement = results.costs[cheapest], results.arrangements[cheapest]
    work_j, slave_j = cost.master.work_j, cost.slave.work_j
    share = slave_j / work_j
    return [
        Finding(
            "What the authors feared happens in their own circle, mildly: a step of the slave's joints is "
            f"{cost.least_ratio:.2f} to {cost.greatest_ratio:.2f} times that of the master's, most at "
            f"{cost.greatest_at_deg:.0f}° of the lap, and its motors do {share:.1f} times the work. From the "
            f"worst base on the map it is {worst.greatest_ratio:.0f} times as much at "
            f"{worst.greatest_at_deg:.0f}° of the lap, and {worst.slave.work_j / work_j:.0f} times the work.",
            share > 2.0 and worst.greatest_ratio > 5.0 * cost.greatest_ratio and worst.slave.work_j > 2.0 * slave_j,
        ),
        Finding(
            f"Least motion is not least work: that arrangement takes {motion.slave.work_j:.2f} J, and "
            f"{least.slave.work_j:.2f} J are enough ({arrangement_text(arrangement)}), no more than the master "
            f"needs. What a lap costs is friction, which differs from joint to joint ({cost.slave.lost_j:.2f} J of the "
            f"{slave_j:.2f} J of the worked case), and weights that are lifted and let down again. s₂ = −1, which "
            "moves more, takes less.",
            least.slave.work_j < 0.7 * motion.slave.work_j
            and arrangement.posture.approach == -1
            and least.slave.work_j < 1.1 * work_j,
        ),
        Finding(
            f"Most of the energy holds weights: {cost.slave.heat_j:.1f} J a lap heat the slave's windings, "
            f"{cost.master.heat_j:.1f} J the master's, and that is a matter of the pose, not of the path. (5) "
            "minimises neither.",
            cost.slave.heat_j > 2.0 * slave_j and cost.master.heat_j > 2.0 * work_j,
        ),
    ]


def arrangement_text(each: Arrangement) -> str:
    """Base, grasp distance and signs."""
    pair, posture = each.pair, each.posture
    x, y, _ = pair.slave_base_m
    signs = f"s₂ = {posture.approach:+d}, elbow {posture.elbow:+d}, facing {posture.facing:+d}"
    return f"base ({x:.2f}, {y:.2f}) m, K = {pair.carried.distance_m:g} m, {signs}"


def _least(results: Results, name: str, sign: int) -> float:
    """The least ratio of travel with one sign of the posture."""
    return min(each.travel_ratio for each in results.arrangements if getattr(each.posture, name) == sign)
