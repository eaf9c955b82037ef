"""Runs the benchmarks, shows one table and stores it as JSON, so that versions can be compared."""

import argparse
import importlib
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import against
from machine import commit, machine, python, python_text
from measure import Row

SUITES = ("cycle", "pair", "lockstep", "dynamics", "cooperation", "slave", "wall_clock")
RESULTS = Path(__file__).parent / "results"
SLOWER = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """`python benchmarks/run.py [suite ...]`; returns the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=f"Exit status {SLOWER}: something has become slower than in the file of --against."
    )
    parser.add_argument("suites", nargs="*", default=SUITES, help=f"which of {', '.join(SUITES)}; all unless given")
    parser.add_argument("--out", type=Path, help="where to keep the JSON; benchmarks/results/ unless given")
    parser.add_argument(
        "--against", type=Path, metavar="FILE", help="the JSON of an earlier run: what has become slower is marked"
    )
    given = parser.parse_args(arguments)
    unknown = sorted(set(given.suites) - set(SUITES))
    if unknown:
        parser.error(f"no suite {unknown[0]!r}; there are {', '.join(SUITES)}")
    try:
        earlier = None if given.against is None else against.read(given.against)
    except against.EarlierError as error:
        parser.error(str(error))
    interpreter = python()
    print(f"{machine()}\n{python_text(interpreter)}\n")
    print(f"{'what':<42}{'against':<42}{'median':>8}  {'range':<16}{'goal':<8}")
    rows: list[tuple[str, Row]] = []
    for suite in given.suites:
        for row in importlib.import_module(suite).rows():
            print(row.as_text(), flush=True)
            rows.append((suite, row))
    stamp = time.strftime("%Y%m%d-%H%M%S")
    kept = {
        "machine": machine(),
        "python": interpreter,
        "commit": commit(),
        "time": stamp,
        "rows": [{"suite": suite, **row.as_json()} for suite, row in rows],
    }
    path = given.out or RESULTS / f"{stamp}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")
    print(f"\nkept in {path}")
    if earlier is None:
        return 0
    return show_comparison(rows, earlier, python_text(interpreter))


def show_comparison(rows: Sequence[tuple[str, Row]], earlier: against.Earlier, interpreter: str) -> int:
    """Print `rows` beside the earlier ones; the exit status."""
    print(f"\nagainst {earlier.name}: commit {earlier.commit}")
    for what, then, now in (("machine", earlier.machine, machine()), ("Python", earlier.python, interpreter)):
        if then != now:
            print(f"another {what} then: {then}")
    print()
    print("\n".join(against.compared(rows, earlier)))
    slower = against.slower(rows, earlier)
    print(f"\n{len(slower)} slower beyond the spread of both{': ' if slower else ''}{', '.join(slower)}")
    return SLOWER if slower else 0


if __name__ == "__main__":
    sys.exit(main())
