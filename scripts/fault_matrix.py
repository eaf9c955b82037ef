"""Run the fault matrix of konkuk1 and compare it with its golden copy, or write that again. Takes minutes.

The golden copy holds verdict, detector and latency of every cell. Exit status 1 if anything differs by more than a
cycle, or the run is interrupted.
"""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.golden import differences, golden_text, read_golden
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.progress import Progress
from canarm.matrix.table import Matrix
from canarm.matrix.text_report import as_text, part_of
from canarm.matrix.undetectable import BEYOND_CONTROL, DECLARED_UNDETECTABLE, Declared

ROOT = Path(__file__).parent.parent
GOLDEN = ROOT / "tests" / "canarm" / "golden" / "matrix-konkuk1.csv"
PAGE = ROOT / "docs" / "fault-matrix.md"


def with_figures(page: str, matrix: Matrix) -> str:
    """The page with the counts of `matrix`, and with the table of what cannot be detected."""
    counts = [
        f"| {verdict.value} | {count} | {count / len(matrix.rows):.1%} |" for verdict, count in matrix.counts.items()
    ]
    page = _between(page, "counts", ["| verdict | cells | share |", "|---|---|---|", *counts])
    failed = [f"| `{row.tap}` | {row.fault} | {row.verdict.value} | {row.why or row.note} |" for row in matrix.failed]
    page = _between(page, "failed", ["| tap | fault | verdict | why |", "|---|---|---|---|", *failed])
    page = _between(page, "undetectable", ["| tap | fault | why nobody can tell |", *_declared(DECLARED_UNDETECTABLE)])
    return _between(page, "beyond", ["| tap | fault | why |", *_declared(BEYOND_CONTROL)])


def _declared(table: Sequence[Declared]) -> list[str]:
    return ["|---|---|---|", *[f"| `{each.tap}` | {each.fault} | {each.reason} |" for each in table]]


def _between(page: str, name: str, lines: list[str]) -> str:
    text = "\n".join([f"<!-- {name} -->", *lines, f"<!-- end of {name} -->"])
    return re.sub(rf"<!-- {name} -->.*?<!-- end of {name} -->", lambda _: text, page, flags=re.DOTALL)


def main(words: Sequence[str] | None = None) -> int:
    """Run, then compare or write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: %(default)s)")
    parser.add_argument(
        "--update-golden", action="store_true", help="write the golden copy and the page's figures again"
    )
    arguments = parser.parse_args(words)
    scenario = Scenario()
    cell = scenario.load()
    progress = Progress()
    matrix = run_campaign(Campaign(scenario, tuple(cells_of(cell))), arguments.jobs, progress)
    if matrix.runs_left:
        progress.leave()
        progress.note(part_of(matrix))
        return 1
    print(as_text(matrix))
    if arguments.update_golden:
        GOLDEN.parent.mkdir(parents=True, exist_ok=True)
        GOLDEN.write_text(golden_text(matrix.rows), encoding="utf-8")
        PAGE.write_text(with_figures(PAGE.read_text(encoding="utf-8"), matrix), encoding="utf-8")
        return 0
    changed = differences(matrix.rows, read_golden(GOLDEN.read_text(encoding="utf-8")), cell.bus.cycle_s * 1e3)
    if changed:
        count = f"{len(changed)} {'cell differs' if len(changed) == 1 else 'cells differ'} from the golden copy"
        print(*changed, f"{count}; if this is meant: make matrix ARGS=--update-golden", sep="\n")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
