"""Measure every law on cells of 1 to 7 joints and on an arm from a URDF file; write the figures into docs/robots.md.

Each cell is written by `canarm new-cell` and not changed. Takes minutes. Exit status 1 if a fault-free run
was stopped or had a detection.
"""

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import NamedTuple

from canarm.new_cell import Request, write_cell
from canarm.new_cell.arms import Arm, arm_of_urdf, made_up_arm
from canarm.rig.rig import Rig
from canarm_controller.laws.loading import LAWS
from canarm_controller.run.state import State
from canarm_protocol.cell.model import Cell

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "robots.md"
ARMS = ROOT / "examples" / "arms"
JOINTS = (1, 3, 5, 6, 7)
URDF = "bench_arm"
CELLS = (*map(str, JOINTS), URDF)
MOTIONS = ("sine", "trapezoid")
DETECTED = "detected "
CYCLES = 2048
"""Cycles per run; the figures leave out the first 1024, as everywhere."""


class Job(NamedTuple):
    """One run of one cell."""

    cell: str
    law: str
    motion: str
    seed: int


class Result(NamedTuple):
    """The worst joint's RMS error in steps of its position sensor; why the run was stopped, or None."""

    job: Job
    rms_lsb: float
    reason: str | None


def arm_of(name: str) -> tuple[Arm, Path]:
    if name == URDF:
        return arm_of_urdf(ARMS / f"{URDF}.urdf", f"{URDF}.urdf"), ARMS
    return made_up_arm(int(name)), ARMS


@cache
def cell_of(name: str) -> Cell:
    arm, folder = arm_of(name)
    return write_cell(arm, Request(), folder)[1]


def jobs(seeds: int) -> Iterator[Job]:
    """Every law and motion with seed 0; the other seeds take the laws in turn."""
    laws = list(LAWS)
    for cell in CELLS:
        yield from (Job(cell, law, motion, 0) for law in laws for motion in MOTIONS)
        yield from (Job(cell, laws[seed % len(laws)], MOTIONS[seed % 2], seed) for seed in range(1, seeds))


def measure(job: Job) -> Result:
    cell = cell_of(job.cell)
    with Rig(cell, job.law, job.motion, seed=job.seed) as rig:
        rig.run(CYCLES * cell.bus.cycle_s)
        stopped = rig.reason if rig.state is not State.RUNNING else None
        found = [detection.detector for detection in rig.detections]
        rms = max(joint.rms_error_lsb for joint in rig.joints.values()) if stopped is None else float("nan")
    return Result(job, rms, stopped or (f"{DETECTED}{found[0]}" if found else None))


def with_figures(page: str, results: Sequence[Result]) -> str:
    """The page with its tables replaced."""
    rms = {result.job: result.rms_lsb for result in results if result.job.seed == 0}
    rows = ["| cell | cycle | " + " | ".join(LAWS) + " |", "|---|---|" + "---|" * len(LAWS)]
    for name in CELLS:
        cell = cell_of(name)
        figures = ["; ".join(f"{rms[Job(name, law, motion, 0)]:.2f}" for motion in MOTIONS) for law in LAWS]
        rows.append(f"| {cell.title} | {cell.bus.cycle_us / 1000:g} ms | " + " | ".join(figures) + " |")
    page = between(page, "figures", rows)
    accused = [result for result in results if result.reason is not None and result.reason.startswith(DETECTED)]
    stops = sum(result.reason is not None for result in results) - len(accused)
    counts = Counter(result.job.cell for result in {result.job[::3]: result for result in results}.values())
    listed = ", ".join(f"{cell_of(name).name} {counts[name]}" for name in CELLS)
    runs = f"{len(results)} runs without a fault, by seeds ({listed}): {stops} stops, {len(accused)} detections."
    told = [
        f"- {cell_of(job.cell).name}, {job.law} on the {job.motion}, seed {job.seed}: {why}" for job, _, why in accused
    ]
    return between(page, "seeds", [runs, "", *told] if told else [runs])


def between(page: str, name: str, lines: Sequence[str]) -> str:
    text = "\n".join([f"<!-- {name} -->", *lines, f"<!-- end of {name} -->"])
    return re.sub(rf"<!-- {name} -->.*?<!-- end of {name} -->", lambda _: text, page, flags=re.DOTALL)


def main(words: Sequence[str] | None = None) -> int:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=20, help="for each cell (default: %(default)s)")
    arguments = parser.parse_args(words)
    wanted = list(jobs(arguments.seeds))
    results = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for result in pool.map(measure, wanted):
            results.append(result)
            print(f"{len(results)}/{len(wanted)} {result}", file=sys.stderr)
    PAGE.write_text(with_figures(PAGE.read_text(encoding="utf-8"), results), encoding="utf-8")
    return 1 if any(result.reason is not None for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
