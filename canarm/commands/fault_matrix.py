"""`canarm fault matrix`: every fault at every tap, and what became of it."""

import contextlib
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.shown import printable

from ..options import CellOptions, Flag
from ..stdout import keep_stdout
from ..usage import UsageError
from ..workers.jobs import Jobs, cores
from .matrix_options import ScenarioOptions

if TYPE_CHECKING:
    from ..matrix.plan import MatrixCell


def matrix(
    *,
    cell: CellOptions = CellOptions(),
    scenario: ScenarioOptions = ScenarioOptions(),
    jobs: Jobs = None,
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
        Parameter(
            metavar="DIR",
            help="Folder for matrix.csv, matrix.html and, with several draws, matrix-draws.csv; one that holds a "
            "matrix is refused.",
        ),
    ] = None,
    json_: Annotated[
        Flag, Parameter(name="--json", help="Last line on stdout is the matrix as one JSON object.")
    ] = False,
) -> int:
    """Run every fault at every tap that supports it, with its defaults: what detects it, how fast, what happens then?

    Beside the faults go fault-free runs, for the rate of false alarms; with --only, no more of them than are compared
    with. Exit status 1 if a cell is not as it should be in every draw, or a fault-free run raises an alarm. Ctrl-C ends
    it; with --out the cells so far are kept as matrix-partial.csv and matrix-partial.html.
    """
    from ..matrix.campaign import FAULT_FREE_RUNS, Campaign, run_campaign
    from ..matrix.files import claimed, write
    from ..matrix.foreign_run import words_of
    from ..matrix.text_report import as_text, part_of
    from ..workers.progress import Progress

    nominal = cell.load()
    scenarios, about = scenario.scenarios(cell, nominal, controller is None)
    if controller is not None:
        words_of(controller)
    cells = _chosen(nominal, only or (), cell.cell)
    campaign = Campaign(scenarios, cells, controller, 0 if only else FAULT_FREE_RUNS, about)
    processes = jobs or cores()
    progress = Progress(processes)
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
    """The cells to run. Raises `UsageError` for a pattern that matches none: it may be mistyped."""
    from ..matrix.plan import cells_of

    idle = [pattern for pattern in only if not cells_of(nominal, [pattern])]
    if idle:
        words = " ".join(f"--only {printable(shlex.quote(pattern))}" for pattern in idle)
        raise UsageError(f"{words}: fits no fault; see `canarm fault list --cell {name}`")
    return tuple(cells_of(nominal, only))


def _plain(result: Any) -> dict[str, Any]:
    return {
        "title": result.title,
        "cells": [cell.as_plain() for cell in result.cells],
        "counts": {verdict.value: count for verdict, count in result.counts.items()},
        "runs": len(result.rows),
        "failed_runs": len(result.failed),
        "failed": [cell.worst.name for cell in result.cells if not cell.worst.passes],
        "fault_free_runs": result.fault_free_runs,
        "false_alarms": [
            {"run": each.run, "detector": each.detector, "where": each.where, "cycle": each.cycle}
            for each in result.false_alarms
        ],
    }
