"""`canarm fault matrix`: every fault at every tap, and what became of it."""

import json
import os
import sys
import time
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from canarm_controller.errors import ControllerError
from canarm_protocol.clock import Clock

from ..options import CellOptions, Flag, Seed
from ..session import make_controller
from ..stdout import keep_stdout
from ..usage import DEFAULT_LAW, DEFAULT_TRAJECTORY, UsageError, parse_settings

BAR = 30
"""Characters of the progress bar."""
REPORT_STEP = 0.1
"""Where stderr is no terminal, progress is a line for every so much of the whole."""
CSV_FILE, HTML_FILE = "matrix.csv", "matrix.html"


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
            metavar="GLOB", negative=(), help="Only what fits: tap, fault, family or 'TAP FAULT'; may be repeated."
        ),
    ] = None,
    controller: Annotated[
        str | None,
        Parameter(
            metavar="COMMAND",
            help="Another controller than ours, started anew for each run; {host} and {port} are where the virtual bus "
            "is. Judged by what is seen on the bus. --law and --trajectory are then its own business.",
        ),
    ] = None,
    out: Annotated[Path | None, Parameter(metavar="DIR", help=f"Folder for {CSV_FILE} and {HTML_FILE}.")] = None,
    json_: Annotated[
        Flag, Parameter(name="--json", help="Last line on stdout is the matrix as one JSON object.")
    ] = False,
) -> int:
    """Run every fault at every tap that supports it, with its defaults: what detects it, how fast, what happens then?

    Beside the faults go fault-free runs, for the rate of false alarms. Exit status 1 if a cell is not as it should be.
    """
    from ..matrix.campaign import Campaign, run_campaign
    from ..matrix.html_report import as_html
    from ..matrix.plan import Scenario, cells_of
    from ..matrix.table import as_csv
    from ..matrix.text_report import as_text

    nominal = cell.load()
    settings = tuple(parse_settings("--set", cell.settings).items())
    scenario = Scenario(cell.cell, settings, law, trajectory, seed)
    try:
        make_controller(nominal, law, trajectory, None, Clock.SYNC)
    except ControllerError as error:
        raise UsageError(str(error)) from None
    cells = tuple(cells_of(nominal, only or ()))
    if not cells:
        raise UsageError(f"--only {' '.join(only or ())}: fits no fault; see `canarm fault list --cell {cell.cell}`")
    say = keep_stdout()
    _prepare(out)
    result = run_campaign(Campaign(scenario, cells, controller), jobs or _cores(), _Progress())
    if out is not None:
        _write(out / CSV_FILE, as_csv(result.rows))
        _write(out / HTML_FILE, as_html(result))
    if json_:
        say(json.dumps(_plain(result)))
    else:
        say(as_text(result))
        if out is not None:
            say(f"written: {out / CSV_FILE}, {out / HTML_FILE}")
    return 0 if result.passes else 1


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


def _prepare(folder: Path | None) -> None:
    """Make the folder now: nobody wants to hear of a wrong name after minutes."""
    if folder is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"--out {folder}: is no folder and cannot become one: {error.strerror}") from None


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8", newline="")
    except OSError as error:
        raise UsageError(f"--out {path.parent}: {path.name} cannot be written: {error.strerror}") from None


class _Progress:
    """How many runs are done, on stderr: a bar on a terminal, else some lines."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._begun_s, self._told = time.monotonic(), 0.0

    def __call__(self, done: int, total: int) -> None:
        """`done` of `total` runs have ended."""
        if sys.stderr is None:
            return
        elapsed_s = time.monotonic() - self._begun_s
        left_s = elapsed_s * (total - done) / done
        if self._is_terminal:
            bar = "#" * (BAR * done // total)
            end = "\n" if done == total else ""
            print(f"\r{bar:.<{BAR}} {done}/{total} runs, {left_s:.0f} s left ", end=end, file=sys.stderr, flush=True)
        elif done == total or done / total >= self._told + REPORT_STEP:
            self._told = done / total
            print(f"canarm: {done}/{total} runs, {left_s:.0f} s left", file=sys.stderr, flush=True)
