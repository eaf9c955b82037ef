"""Runs the benchmarks, shows one table and stores it as JSON, so that versions can be compared."""

import argparse
import importlib
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

SUITES = ("lockstep", "dynamics", "cooperation", "slave", "wall_clock")
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    """`python benchmarks/run.py [suite ...]`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("suites", nargs="*", default=SUITES, help=f"which of {', '.join(SUITES)}; all unless given")
    parser.add_argument("--out", type=Path, help="where to keep the JSON; benchmarks/results/ unless given")
    arguments = parser.parse_args()
    unknown = sorted(set(arguments.suites) - set(SUITES))
    if unknown:
        parser.error(f"no suite {unknown[0]!r}; there are {', '.join(SUITES)}")
    print(f"{_machine()}\n")
    print(f"{'what':<42}{'against':<38}{'median':>8}  {'range':<16}{'goal':<8}")
    kept = []
    for suite in arguments.suites:
        for row in importlib.import_module(suite).rows():
            print(row.as_text(), flush=True)
            kept.append({"suite": suite, **row.as_json()})
    stamp = time.strftime("%Y%m%d-%H%M%S")
    path = arguments.out or RESULTS / f"{stamp}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        json.dumps({"machine": _machine(), "commit": _commit(), "time": stamp, "rows": kept}, indent=2) + "\n"
    )
    print(f"\nkept in {path}")


def _machine() -> str:
    cpu = next(
        (line.split(":")[1].strip() for line in _lines("/proc/cpuinfo") if line.startswith("model name")),
        platform.processor() or "unknown processor",
    )
    return f"{cpu}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text().splitlines()
    except OSError:
        return []


def _commit() -> str:
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return described.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
