"""Run the fault matrix of konkuk1 and compare it with its golden copy, or rewrite that. Takes minutes.

The golden copy holds verdict, detector and latency of every run: each cell in each of the draws. Exit status 1 if
anything differs by more than a cycle, or the run is interrupted.
"""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from canarm.draws import CONFIDENCE
from canarm.matrix.campaign import Campaign, run_campaign
from canarm.matrix.golden import differences, draws_of, golden_text, read_golden
from canarm.matrix.naming import Part
from canarm.matrix.plan import Scenario, cells_of
from canarm.matrix.scenarios import command_of, drawn
from canarm.matrix.shares import Share
from canarm.matrix.table import Matrix, Tally, named_right
from canarm.matrix.text_report import as_text, as_they_should_be, part_of, wrong_names
from canarm.matrix.undetectable import BEYOND_CONTROL, DECLARED_UNDETECTABLE, Declared
from canarm.workers.progress import Progress

ROOT = Path(__file__).parent.parent
GOLDEN = ROOT / "tests" / "canarm" / "golden" / "matrix-konkuk1.csv"
PAGE = ROOT / "docs" / "fault-matrix.md"
DRAW_SEED = 0


def golden_scenarios(draws: int | None = None) -> tuple[Scenario, ...]:
    """The draws of the golden copy, as many as it has unless given; one is the scenario of the command alone."""
    base = Scenario()
    count = draws or (draws_of(read_golden(GOLDEN.read_text(encoding="utf-8"))) if GOLDEN.exists() else 1)
    return drawn(base, base.load(), count, DRAW_SEED) if count > 1 else (base,)


def with_figures(page: str, matrix: Matrix, scenarios: Sequence[Scenario]) -> str:
    """The page with the counts of `matrix`, its draws, and the table of what cannot be detected."""
    runs = len(matrix.rows)
    counts = [_share(verdict.value, Share(count, runs)) for verdict, count in matrix.counts.items()]
    counts.append(_share("as they should be", Share(runs - len(matrix.failed), runs)))
    page = _between(
        page, "counts", [f"| verdict | runs | share | {CONFIDENCE:.0%} bounds |", "|---|---|---|---|", *counts]
    )
    page = _between(page, "sum", ["```", *sum_of(matrix), "```"])
    page = _between(page, "draws", ["```", *(command_of(each, None) for each in scenarios), "```"])
    head = [f"| part | named right | share | {CONFIDENCE:.0%} bounds | aim | else |", "|---|---|---|---|---|---|"]
    page = _between(page, "names", [*head, *(_names(part, matrix) for part in _parts(matrix))])
    failed = [_failed(cell) for cell in matrix.cells if not cell.worst.passes]
    head = ["| tap | fault | as they should be | worst | draw | why |", "|---|---|---|---|---|---|"]
    page = _between(page, "failed", [*head, *failed])
    page = _between(page, "undetectable", ["| tap | fault | why undetectable |", *_declared(DECLARED_UNDETECTABLE)])
    return _between(page, "beyond", ["| tap | fault | why |", *_declared(BEYOND_CONTROL)])


def sum_of(matrix: Matrix) -> list[str]:
    """The last lines of the command."""
    partial = [part_of(matrix)] if matrix.runs_left else []
    alarmed = f"{matrix.alarmed_runs} of {matrix.fault_free_runs} fault-free runs raised an alarm"
    return [*partial, alarmed, *as_they_should_be(matrix)]


def _share(name: str, share: Share) -> str:
    return f"| {name} | {share.hits} | {share.value:.1%} | {share.low:.1%} to {share.high:.1%} |"


def _parts(matrix: Matrix) -> list[Part]:
    """The parts that the robot has."""
    return [part for part in Part if any(row.part == part.value for row in matrix.rows)]


def _names(part: Part, matrix: Matrix) -> str:
    rows = [row for row in matrix.rows if row.part == part.value]
    share = named_right(rows)
    called = "; ".join(wrong_names(rows))
    bounds = f"{share.low:.1%} to {share.high:.1%}"
    hits = f"{share.hits} of {share.count}"
    return f"| {part.value} | {hits} | {share.value:.1%} | {bounds} | {part.aim:.0%} | {called} |"


def _failed(cell: Tally) -> str:
    worst, share = cell.worst, cell.share
    why = worst.why or worst.note
    good = f"{share.hits} of {share.count}"
    return f"| `{worst.tap}` | {worst.fault} | {good} | {worst.verdict.value} | {worst.draw} | {why} |"


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
    parser.add_argument("--draws", type=int, help="of the new golden copy; as many as it has unless given")
    arguments = parser.parse_args(words)
    if arguments.draws is not None and not (arguments.update_golden and arguments.draws > 0):
        parser.error("--draws: is for --update-golden, and at least 1")
    scenarios, progress = golden_scenarios(arguments.draws), Progress()
    cell = scenarios[0].load()
    about = f"{len(scenarios)} draws, draw seed {DRAW_SEED}" if len(scenarios) > 1 else ""
    campaign = Campaign(scenarios, tuple(cells_of(cell)), about=about)
    matrix = run_campaign(campaign, arguments.jobs, progress)
    if matrix.runs_left:
        progress.leave()
        progress.note(part_of(matrix))
        return 1
    print(as_text(matrix))
    if arguments.update_golden:
        GOLDEN.parent.mkdir(parents=True, exist_ok=True)
        GOLDEN.write_text(golden_text(matrix.rows), encoding="utf-8")
        PAGE.write_text(with_figures(PAGE.read_text(encoding="utf-8"), matrix, scenarios), encoding="utf-8")
        return 0
    changed = differences(matrix.rows, read_golden(GOLDEN.read_text(encoding="utf-8")), cell.bus.cycle_s * 1e3)
    if changed:
        count = f"{len(changed)} {'run differs' if len(changed) == 1 else 'runs differ'} from the golden copy"
        print(*changed, f"{count}; if this is meant: make matrix ARGS=--update-golden", sep="\n")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
