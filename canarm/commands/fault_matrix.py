"""`canarm fault matrix`: every fault at every tap, and what became of it."""

import contextlib
import json
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from ..options import CellOptions, Flag, Seed
from ..session import make_controller
from ..stdout import keep_stdout
from ..usage import DEFAULT_LAW, DEFAULT_TRAJECTORY, UsageError, parse_settings

if TYPE_CHECKING:
    from ..matrix.plan import MatrixCell


def _at_least_one(type_: object, value: int | None) -> None:
    if value is not None and value < 1:
        raise ValueError("must be 1 or more.")


def matrix(
    *,
    cell: CellOptions = CellOptions(),
    law: Annotated[str, Parameter(metavar="NAME|FILE.py:CLASS", help="Control law, as of canarm demo.")] = DEFAULT_LAW,
    trajectory: Annotated[
        str, Parameter(metavar="NAME|FILE", help="Trajectory, as of canarm demo.")
    ] = DEFAULT_TRAJECTORY,
    seed: Seed = 0,
    jobs: Annotated[
        int | None,
        Parameter(validator=_at_least_one, metavar="NUMBER", help="Processes; one a core unless given."),
    ] = None,
    only: Annotated[
        list[str] | None,
        Parameter(
            metavar="GLOB",
            negative=(),
            help="Only what fits: tap, fault, family or 'TAP FAULT'; may be repeated: what fits any of them runs.",
        ),
    ] = None,
    controller: Annotated[
        str | None,
        Parameter(
            metavar="COMMAND",
            help="Another controller than ours, started for each run; {host} and {port} are where the virtual bus "
            "is. Judged by what is seen on the bus. --law and --trajectory are then its own business.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Parameter(metavar="DIR", help="Folder for matrix.csv and matrix.html; one that holds a matrix is refused."),
    ] = None,
    json_: Annotated[
        Flag, Parameter(name="--json", help="Last line on stdout is the matrix as one JSON object.")
    ] = False,
) -> int:
    """Run every fault at every tap that supports it, with its defaults: what detects it, how fast, what happens then?

    Beside the faults go fault-free runs, for the rate of false alarms. Exit status 1 if a cell is not as it should be.
    Ctrl-C ends it; with --out the cells so far are kept as matrix-partial.csv and matrix-partial.html.
    """
    from ..matrix.campaign import Campaign, run_campaign
    from ..matrix.files import claimed, write
    from ..matrix.foreign_run import words_of
    from ..matrix.plan import Scenario
    from ..matrix.progress import Progress
    from ..matrix.text_report import as_text, part_of

    nominal = cell.load()
    settings = tuple(parse_settings("--set", cell.settings).items())
    scenario = Scenario(cell.cell, settings, law, trajectory, seed)
    make_controller(nominal, law, trajectory, None, Clock.SYNC)
    if controller is not None:
        words_of(controller)
    cells = _chosen(nominal, only or (), cell.cell)
    campaign, processes, progress = Campaign(scenario, cells, controller), jobs or _cores(), Progress()
    say = keep_stdout()
    with contextlib.nullcontext() if out is None else claimed(out):
        with_fault, without = campaign.runs
        also = f", {without} without" if without else ""
        progress.note(f"runs: {with_fault} with a fault{also}; {processes} at a time")
        result = run_campaign(campaign, processes, progress, progress.note)
        written, trouble = [], None
        try:
            written = write(out, result) if out is not None and result.runs else []
        except OSError as error:
            trouble = f"--out {out}: {Path(str(error.filename)).name} cannot be written: {error.strerror}"
    where = f"written: {', '.join(map(str, written))}" if written else ""
    if result.runs_left:
        progress.leave()
        progress.note("; ".join(filter(None, (part_of(result), where, trouble))))
        return 1
    if json_:
        say(json.dumps(_plain(result)))
    else:
        say("\n".join(filter(None, (as_text(result), where))))
    if trouble is not None:
        progress.note(trouble)
    return 0 if result.passes and trouble is None else 1


def _chosen(nominal: Cell, only: Sequence[str], name: str) -> "tuple[MatrixCell, ...]":
    """The cells to be run. Raises `UsageError` for a pattern that fits none: it may be a slip of the pen."""
    from ..matrix.plan import cells_of

    idle = [pattern for pattern in only if not cells_of(nominal, [pattern])]
    if idle:
        words = " ".join(f"--only {shlex.quote(pattern)}" for pattern in idle)
        raise UsageError(f"{words}: fits no fault; see `canarm fault list --cell {name}`")
    return tuple(cells_of(nominal, only))


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _plain(result: Any) -> dict[str, Any]:
    return {
        "title": result.title,
        "cells": [row.as_plain() for row in result.rows],
        "counts": {verdict.value: count for verdict, count in result.counts.items()},
        "failed": [row.name for row in result.failed],
        "fault_free_runs": result.fault_free_runs,
        "false_alarms": [
            {"run": each.run, "detector": each.detector, "where": each.where, "cycle": each.cycle}
            for each in result.false_alarms
        ],
    }
