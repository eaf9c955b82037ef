"""What a cycle of `rhino-pair` (ten joints, two arms, one object) costs against one of konkuk1, by parts of its run.

CPU time in one process, detectors on. The two cells alternate, block by block.
"""

import statistics
from functools import partial

from measure import Ratio, Row
from replay import LAW, spent

from canarm import Rig

PAIR, SINGLE = "rhino-pair", "konkuk1"
PARTS_S = {"homing": (0.3, 1.7), "on the way": (2.0, 3.4), "on the path": (5.0, 8.0)}
"""Of the pair's run with the paper's circle: from and until when a part of it is measured."""
SINGLE_S = 0.5, 3.5
BLOCKS = 7


def rows(blocks: int = BLOCKS) -> list[Row]:
    """A row for each part of the pair's run."""
    single_s: list[float] = []
    pair_s: dict[str, list[float]] = {name: [] for name in PARTS_S}
    for _ in range(blocks):
        (cycle_s,) = cycles_s(SINGLE, {"": SINGLE_S}).values()
        single_s.append(cycle_s)
        for name, cycle_s in cycles_s(PAIR, PARTS_S).items():
            pair_s[name].append(cycle_s)
    found = []
    for name, each_s in pair_s.items():
        remark = f"{statistics.median(each_s) * 1e6:.0f} us a cycle"
        found.append(Row(f"CPU: {PAIR} {name}", f"{SINGLE} (rig)", Ratio.of(each_s, single_s), "<= 3.5", remark))
    return found


def cycles_s(cell: str, parts_s: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Seconds of CPU for a cycle of one run, in each of its parts."""
    found = {}
    with Rig(cell, law=LAW, seed=0, history_s=1.0) as rig:
        now_s = 0.0
        for name, (begin_s, end_s) in parts_s.items():
            rig.run(begin_s - now_s)
            length_s = end_s - begin_s
            found[name] = spent(partial(rig.run, length_s)) * rig.cell.bus.cycle_s / length_s
            now_s = end_s
    return found
