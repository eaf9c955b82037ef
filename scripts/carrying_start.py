"""How two robots take up an object: the forces of the grips from power-on until they carry it on their path. A table.

Draws seed, law, motion and truth; each joint is parked anywhere within what homing finds. With `--on-stand` the hands
are homed empty and close at the object.
"""

import argparse
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from carrying_faults import LAWS, MOTIONS, likely, true_robot

from canarm import Rig, State
from canarm_protocol.cell import Cell, load_cell

TAKEN_UP_S, SETTLED_S, ON_THE_PATH_S = 0.25, 0.25, 1.0
RISE_S = 0.01
"""In which a jerk shows: what is shorter the pads of the hands take up (`canarm_emulator.robot.carried.PAD_S`)."""


@dataclass(frozen=True)
class Start:
    """The grips during one part of a start: most force, most change of it in `RISE_S`, most squeeze, all in N."""

    part: str
    grip_n: float
    rise_n: float
    squeeze_n: float


def parked_rig(cell: Cell, seed: str) -> tuple[Rig, str]:
    """A rig, and what was drawn: object ±50 %, friction ±30 %, 0.6 mm, and joints as far off as homing allows."""
    draw = random.Random(seed)
    truth = true_robot(cell, draw)
    assert cell.control.homing is not None
    most_deg = cell.control.homing.parked_within_deg
    for name, joint in zip(cell.joint_names, cell.joints, strict=True):
        truth[f"{name}.initial_deg"] = joint.home_deg + draw.uniform(-most_deg, most_deg)
    law, motion = draw.choice(LAWS), draw.choice(MOTIONS)
    return Rig(cell, law, motion, seed=draw.randrange(2**31), truth=truth, history_s=20.0), f"{seed}: {law}, {motion}"


def parts(rig: Rig) -> list[Start]:
    """Run until the object is carried along its path, and cut that into its parts."""
    whole = rig.cell.object
    assert whole is not None
    rig.run(seconds=0.5)
    while rig.controller.is_homing:
        rig.run(seconds=0.1)
    homed_s = rig.time_s
    while rig.controller.is_empty and rig.state is State.RUNNING:
        rig.run(seconds=rig.cell.bus.cycle_s)
    held_s = rig.time_s
    rig.run(seconds=max(rig.approach_s, held_s) + ON_THE_PATH_S - rig.time_s)
    carried = rig.object
    times_s, grips_n, squeezes_n = carried.time_s, carried.grip_force_n, np.abs(carried.squeeze_n)
    cycles = round(RISE_S / rig.cell.bus.cycle_s)
    rises_n = np.abs(grips_n - np.concatenate([np.zeros(cycles), grips_n[:-cycles]]))
    ends = {"the supports let go": TAKEN_UP_S, "homing": homed_s}
    if whole.on_stand:
        closes_s = held_s - whole.closing_s
        ends = {
            "the hands are empty": closes_s,
            "the hands close": held_s,
            "the stand sinks": held_s + whole.taken_up_s + SETTLED_S,
        }
    ends |= {"the way to the path": rig.approach_s, "the first second of it": math.inf}
    found, begin_s = [], 0.0
    for part, end_s in ends.items():
        own = (times_s >= begin_s) & (times_s < end_s)
        found.append(Start(part, *(float(each[own].max()) for each in (grips_n, rises_n, squeezes_n))))
        begin_s = end_s
    return found


def table(starts: list[list[Start]]) -> Iterator[str]:
    """Median, 95 % of the draws, and worst."""
    yield "| part | grip: median, 95 %, worst | change in 10 ms | squeeze |"
    yield "|---|---|---|---|"
    for rows in zip(*starts, strict=True):
        cells = []
        for figure in ("grip_n", "rise_n", "squeeze_n"):
            values = sorted(getattr(each, figure) for each in rows)
            cells.append(", ".join(f"{float(np.quantile(values, share)):.1f}" for share in (0.5, 0.95, 1.0)) + " N")
        yield f"| {rows[0].part} | {' | '.join(cells)} |"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cell", default="rhino-pair")
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--draw-seed", type=int, default=0)
    parser.add_argument("--on-stand", action="store_true", help="empty hands take it from a stand")
    options = parser.parse_args()
    settings = {"object.on_stand": "true"} if options.on_stand else None
    cell, starts, bad = load_cell(options.cell, settings), [], 0
    assert cell.object is not None
    for number in range(options.draws):
        rig, draw = parked_rig(cell, f"start {options.draw_seed}/{number}")
        starts.append(parts(rig))
        is_well = rig.state is State.RUNNING and rig.object.is_held and not rig.detections
        bad += not is_well
        print(draw if is_well else f"{draw}: {rig.reason or rig.detections}", flush=True)
    print("\n".join(table(starts)))
    worst_n = max(each.grip_n for rows in starts for each in rows)
    low, high = likely(bad, options.draws)
    print(f"stopped, detected or lost: {bad} of {options.draws} ({100 * low:.0f} to {100 * high:.0f} %)")
    print(f"worst grip: {worst_n:.1f} N of the {cell.object.slip_force_n:g} N at which a hand slips")


if __name__ == "__main__":
    main()
