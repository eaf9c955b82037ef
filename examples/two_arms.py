"""Two five-axis arms of one's own carry a rod: where may the second one stand, and how do all ten joints move?

Run it:  python examples/two_arms.py [FILE]   It writes FILE, runs/two_arms.csv unless given, one row every 2.5 ms.
"""

import sys
from pathlib import Path

import numpy as np

from canarm.cooperation import (
    ArmPair,
    CarriedObject,
    FiveAxisArm,
    Posture,
    least_motion,
    line,
    plan_cooperation,
    reachability,
)

ARM = FiveAxisArm(
    d_m=(0.30, 0.0, 0.0, 0.0, 0.18),
    a_m=(0.0, 0.25, 0.16, 0.0, 0.0),
    alpha_deg=(90.0, 0.0, 0.0, 90.0, 0.0),
    limits_deg=((-150, 150), (-30, 130), (-120, 20), (-50, 230), (-180, 180)),
)
START = np.radians([20.0, 60.0, -75.0, 15.0, 0.0])
LIFT = line((0.0, 0.0, 0.06), seconds=2.0, ease_s=0.5)
FILE = Path("runs", "two_arms.csv")
COARSE = line((0.0, 0.0, 0.06), seconds=2.0, period_s=0.1)


def main(file: Path) -> None:
    """Map, choose, plan, write."""
    pair = ArmPair(master=ARM, slave=ARM, carried=CarriedObject(length_m=0.5, theta_x_deg=90.0), slave_base_m=(0, 0, 0))
    x_m, y_m = np.arange(-0.3, 0.81, 0.05), np.arange(0.40, 1.01, 0.05)
    found = reachability(pair, COARSE, START, x_m, y_m, posture=Posture(elbow=-1))
    for reason, share in found.shares().items():
        print(f"{100 * share:5.1f} % of the bases: {reason.words}")
    best = least_motion(pair, COARSE, START, x_m, y_m)[0]
    plan = plan_cooperation(best.pair, LIFT, START, posture=best.posture)
    checks = plan.checks()
    x, y, _ = best.pair.slave_base_m
    print(f"the slave at ({x:.2f}, {y:.2f}) m moves {plan.travel_ratio:.2f} times as far as the master")
    print(f"largest step: {np.degrees(max(checks.master_step_rad, checks.slave_step_rad)):.3f} deg")
    file.parent.mkdir(parents=True, exist_ok=True)
    plan.write_csv(file)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
