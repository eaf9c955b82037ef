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


def _least(results: Results, name: str, sign: int) -> float:
    """The least ratio of travel with one sign of the posture."""
    return min(each.travel_ratio for each in results.arrangements if getattr(each.posture, name) == sign)
