"""Run a share of the fault matrix of rhino-pair against its golden copy, or rewrite that. Takes minutes.

Every fortieth fault, in two scenarios of its own; the golden copy is as that of konkuk1 (`make matrix`). Exit status 1
if anything differs by more than a cycle, or the run is interrupted.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.golden import differences, golden_text, read_golden
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.table import Matrix
from canarm.matrix.text_report import as_text, part_of
from canarm.workers.progress import Progress

GOLDEN = Path(__file__).parent.parent / "tests" / "canarm" / "golden" / "matrix-rhino-pair.csv"
EVERY, FIRST = 40, 7
SCENARIOS = (
    Scenario(cell="rhino-pair", law="mras", trajectory="circle", at_s=6.0),
    Scenario(
        cell="rhino-pair",
        law="slotine-li",
        trajectory="line:y_mm=40,seconds=4",
        seed=1,
        truth=(("object.mass", "0.6"), ("slave_elbow.coulomb", "1.04"), ("master_shoulder.coulomb", "1.17")),
        at_s=7.1,
    ),
)
"""Once homed, on the way: the circle nominal, and a line with a heavier object and more friction."""


def pair_matrix(jobs: int, progress: Progress) -> Matrix:
    """The runs of the golden copy."""
    cells = cells_of(SCENARIOS[0].load())[FIRST::EVERY]
    return run_campaign(Campaign(SCENARIOS, tuple(cells), about="a share of rhino-pair's"), jobs, progress)


def changes(matrix: Matrix) -> list[str]:
    """One line for each run that differs from the golden copy."""
    cycle_ms = SCENARIOS[0].load().bus.cycle_s * 1e3
    return differences(matrix.rows, read_golden(GOLDEN.read_text(encoding="utf-8")), cycle_ms)


def main(words: Sequence[str] | None = None) -> int:
    """Run, then compare or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: %(default)s)")
    parser.add_argument("--update-golden", action="store_true", help="write the golden copy again")
    arguments = parser.parse_args(words)
    progress = Progress()
    matrix = pair_matrix(arguments.jobs, progress)
    if matrix.runs_left:
        progress.leave()
        progress.note(part_of(matrix))
        return 1
    print(as_text(matrix))
    if arguments.update_golden:
        GOLDEN.write_text(golden_text(matrix.rows), encoding="utf-8")
        return 0
    changed = changes(matrix)
    print(*changed, sep="\n", end="\n" if changed else "")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
