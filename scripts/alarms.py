"""Count false alarms: whole robots drawn from the box, in runs without a fault. `make alarms ARGS="--draws 300"`.

Nothing may be detected and nothing stopped; but for a payload that is changed on the way, which may be noticed within
3 s. Each alarm is printed with the command that repeats its run. Exit status 1 if there is any.
"""

import argparse
import os
import sys
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from canarm.draws import (
    CYCLE_MS,
    PAYLOAD,
    SEED,
    Axis,
    Choice,
    Span,
    Value,
    Whole,
    clopper_pearson,
    hypercube,
    payload_truth,
    retimed,
    robot_box,
    truth_of,
)
from canarm.new_cell import Request, write_cell
from canarm.new_cell.arms import made_up_arm
from canarm.rig.arguments import RigWarning
from canarm.rig.rig import Rig
from canarm.workers.pool import results_of
from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import BUILT_IN
from canarm_controller.run.state import State
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell

CELL = "konkuk1"
SECONDS = 6.0
"""Of a run; of one with a change, so long after it as to see a second detection too."""
CHANGE, CHANGED_AT, CHANGED_PAYLOAD = (
    Choice("change", ("no", "yes")),
    Span("changed_at", 1.0, 4.0, "s"),
    "changed_payload",
)
SETTLED_S, WATCHED_S = 3.0, 4.0
"""A payload that was changed may be noticed for so long, and the run ends so long after the change."""
NOTICES = ("acceleration-mismatch", "saturation")
"""What a change of the payload is called."""
RUN_BOX: tuple[Axis, ...] = (
    Choice("law", tuple(LAWS)), Choice("motion", BUILT_IN), SEED, CYCLE_MS,
    CHANGE, CHANGED_AT, Span(CHANGED_PAYLOAD, PAYLOAD.low, PAYLOAD.high),
)  # fmt: skip
SENSING = (
    "potentiometer,tachometer,current_sense",
    "potentiometer,tachometer",
    "potentiometer,current_sense",
    "potentiometer",
)
CELL_BOX: tuple[Axis, ...] = (
    Whole("joints", 1, 7), Choice("sensing", SENSING), Choice("bits", (8, 10, 12, 16)),
    Choice("least_cycle_us", (1000, 2500, 5000, 10_000)),
)  # fmt: skip
"""Cells as `canarm new-cell` writes them, with the shortest of its cycles that fits and is not below the least."""


@dataclass(frozen=True, slots=True)
class Job:
    """One run: which number of which draw, the cell's part of it and the robot's."""

    number: int
    cell: dict[str, Value]
    run: dict[str, Value]
    robot: dict[str, Value]


@dataclass(frozen=True, slots=True)
class Result:
    """What one run has led to: detections that should not be, or one line that says why it was stopped."""

    job: Job
    title: str
    alarms: tuple[str, ...]
    is_stopped: bool
    cycles: int


def jobs(count: int, seed: int, with_cells: bool) -> list[Job]:
    """The draws; every number means the same run for the same `count` and `seed`."""
    cells = hypercube(CELL_BOX, count, seed) if with_cells else [{} for _ in range(count)]
    runs = hypercube(RUN_BOX, count, seed)
    widest = robot_box(cell_of({"joints": 7}) if with_cells else load_cell(CELL))
    robots = hypercube(widest, count, seed)
    return [Job(number, *parts) for number, parts in enumerate(zip(cells, runs, robots, strict=True))]


def cell_of(draw: dict[str, Value]) -> Cell:
    """The cell that was drawn."""
    return _made_up(int(draw["joints"]), str(draw.get("sensing", SENSING[0])), int(draw.get("bits", 8)),
                    int(draw.get("least_cycle_us", 2500)))  # fmt: skip


@cache
def _made_up(joints: int, sensing: str, bits: int, least_cycle_us: int) -> Cell:
    request = Request(bits=bits, sensing=tuple(sensing.split(",")))
    cell = write_cell(made_up_arm(joints), request, Path())[1]
    return cell if cell.bus.cycle_us >= least_cycle_us else retimed(cell, least_cycle_us)


def run(job: Job) -> Result:
    """One run in virtual time."""
    drawn = job.run
    cell = cell_of(job.cell) if job.cell else retimed(load_cell(CELL), 10 * round(100.0 * float(drawn["cycle"])))
    truth, changed_at = truth_of(cell, job.robot, str(drawn["law"])), None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RigWarning)  # 0.8 ms are too short for a bus of 1 Mbit/s; a rig has none
        rig = Rig(cell, str(drawn["law"]), str(drawn["motion"]), seed=int(drawn["seed"]), truth=truth)
    with rig:
        if drawn["change"] == "yes":
            rig.run(float(drawn["changed_at"]))
            ((key, value),) = payload_truth(cell, float(drawn[CHANGED_PAYLOAD])).items()
            if rig.state is State.RUNNING:
                rig.change_truth(key, value)
            changed_at = rig.controller.tick
            rig.run(WATCHED_S)
        else:
            rig.run(SECONDS)
        is_stopped = rig.state is not State.RUNNING
        alarms = [
            f"{each.detector} at {each.where} in cycle {each.tick}, {each.reaction.value}: {each.detail}"
            for each in rig.detections
            if each.reaction.stops or not _is_change(each.detector, each.tick, changed_at, cell.bus.cycle_s)
        ]
        title = f"{cell.name}, {cell.bus.cycle_us} us, {drawn['law']}, {drawn['motion']}"
        return Result(job, title, tuple(alarms), is_stopped, rig.controller.tick)


def _is_change(detector: str, tick: int, changed_at: int | None, cycle_s: float) -> bool:
    return changed_at is not None and detector in NOTICES and 0.0 <= (tick - changed_at) * cycle_s <= SETTLED_S


def lines_of(result: Result, words: str) -> Iterator[str]:
    """What is printed of a run with an alarm, and how it is repeated."""
    job = result.job
    yield f"draw {job.number}: {result.title}{', stopped' if result.is_stopped else ''}"
    yield from (f"    {alarm}" for alarm in result.alarms)
    yield f"    repeat: make alarms ARGS='{words} --only {job.number}'"


def details_of(job: Job) -> Iterator[str]:
    """Everything that was drawn."""
    for part in (job.cell, job.run, job.robot):
        yield "    " + ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in part.items()
        )


def verdict_lines(results: Sequence[Result]) -> Iterator[str]:
    """How many of each law, and bounds of the proportion."""
    runs = Counter(str(each.job.run["law"]) for each in results)
    false = Counter(str(each.job.run["law"]) for each in results if each.alarms or each.is_stopped)
    kinds = Counter(alarm.split(" ", 1)[0] for each in results for alarm in dict.fromkeys(each.alarms))
    yield f"{'law':16} {'runs':>6} {'with a false alarm':>19}"
    yield from (f"{law:16} {runs[law]:6} {false[law]:19}" for law in LAWS)
    for what, count in (
        ("false alarms", false.total()), ("stops", sum(each.is_stopped for each in results)),
    ):  # fmt: skip
        low, high = clopper_pearson(count, len(results))
        yield f"{what}: {count} of {len(results)} runs; 95 % bounds {100 * low:.2g} to {100 * high:.2g} %"
    if kinds:
        yield ", ".join(f"{name} {count}" for name, count in kinds.most_common())


def main(words: Sequence[str] | None = None) -> int:
    """Draw, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=3000, help="runs (default: %(default)s)")
    parser.add_argument("--draw-seed", type=int, default=0, help="(default: %(default)s)")
    parser.add_argument("--cells", action="store_true", help="draw cells too: 1 to 7 joints, sensors, bits, cycles")
    parser.add_argument("--only", type=int, action="append", help="run this number alone, and print what was drawn")
    parser.add_argument("--first", type=int, help="run so many of the draws")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: %(default)s)")
    given = parser.parse_args(words)
    drawn = jobs(given.draws, given.draw_seed, given.cells)
    wanted = drawn[: given.first] if given.only is None else [drawn[number] for number in given.only]
    again = f"{'--cells ' if given.cells else ''}--draws {given.draws} --draw-seed {given.draw_seed}"
    results = []
    for _, result in results_of(run, wanted, given.jobs):
        results.append(result)
        if result.alarms or result.is_stopped:
            print(*lines_of(result, again), sep="\n", flush=True)
        if given.only is not None:
            print(*details_of(result.job), sep="\n")
        if sys.stderr.isatty():
            print(f"\r{len(results)}/{len(wanted)}", end="", file=sys.stderr)
    print(*verdict_lines(results), sep="\n")
    return 1 if any(each.alarms or each.is_stopped for each in results) else 0


if __name__ == "__main__":
    sys.exit(main())
