"""`canarm runs`: the run folders that there are: list, show, convert, prune."""

import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter

from canarm_protocol.errors import ExitStatus
from canarm_protocol.shown import printable, printable_lines, printable_values

from ..number_checks import not_negative
from ..options import Flag, named_file, whole_number
from ..runs.again import fault_file_of, untold_faults
from ..runs.converting import FORMATS, convert
from ..runs.listing import Listed, list_lines, remove_run, runs_below, size_text, to_prune, why_not_removed
from ..runs.run import Run
from ..runs.showing import show_lines
from ..usage import UsageError

RUNS = Path("runs")

runs = App(name="runs", help="The run folders that there are: list, show, convert, prune.")

Base = Annotated[Path, Parameter(name="DIR", converter=named_file, help="Folder with run folders in it.")]
AsJson = Annotated[Flag, Parameter(name="--json", help="As JSON.")]


@runs.command(name="list")
def list_(base: Base = RUNS, /, *, json_: AsJson = False) -> int:
    """A line for each run below a folder: when it was last written (oldest first), its size, what ran, how it ended."""
    found = runs_below(base)
    if json_:
        print(json.dumps(printable_values([each.as_plain() for each in found])))
    elif found:
        print("\n".join(list_lines(found, base)))
    else:
        print(f"{printable(str(base))}: no runs")
    return ExitStatus.DONE


@runs.command
def show(
    run: Annotated[Path, Parameter(name="RUN", converter=named_file, help="A run folder.")],
    /,
    *,
    json_: AsJson = False,
    faults: Annotated[
        Flag, Parameter(help="Only the faults that were declared before it began, as a file for --faults.")
    ] = False,
) -> int:
    """Summary, origin, files, faults and detections of a run, and the command that repeats it.

    What cannot be read is said, with status 1.
    """
    opened = Run(run)
    if faults:
        print(printable_lines(fault_file_of(opened)), end="")
        if why := untold_faults(opened):
            print(f"canarm: {why}", file=sys.stderr)
    elif json_:
        print(json.dumps(printable_values(_plain(opened))))
    else:
        print("\n".join(show_lines(opened)))
    return ExitStatus.FAILED if opened.complaints else ExitStatus.DONE


@runs.command(name="convert")
def convert_(
    run: Annotated[Path, Parameter(name="RUN", converter=named_file, help="A run folder.")],
    /,
    *formats: Annotated[str, Parameter(name="FORMAT", help="blf, csv, mcap, mf4, parquet.", show_env_var=False)],
) -> int:
    """Write a run in formats of other tools, into its folder. Parquet takes the place of CSV, csv that of Parquet."""
    opened = Run(run)
    if not formats or (unknown := [each for each in formats if each not in FORMATS]):
        said = f"{printable(unknown[0])}: " if formats else ""
        raise UsageError(f"runs convert: {said}name formats: {', '.join(FORMATS)}")
    for each in formats:
        for path in convert(opened, each):
            print(f"{printable(str(path))}: {size_text(path.stat().st_size)}")
    return ExitStatus.DONE


@runs.command
def prune(
    base: Base = RUNS,
    /,
    *,
    keep: Annotated[
        int | None,
        Parameter(
            metavar="NUMBER", converter=whole_number, validator=not_negative, help="Keep so many, the newest ones."
        ),
    ] = None,
    older_than: Annotated[
        int | None,
        Parameter(
            metavar="DAYS",
            converter=whole_number,
            validator=not_negative,
            help="Remove only what was written longer ago.",
        ),
    ] = None,
    yes: Annotated[Flag, Parameter(name="--yes", help="Remove them; else it is only said which.")] = False,
) -> int:
    """Remove old runs. Only files that a run leaves are removed; a folder with others in it stays.

    A run that goes on, and what no run of canarm has left, are left alone.
    """
    if keep is None and older_than is None:
        raise UsageError("runs prune: which? give --keep NUMBER, --older-than DAYS, or both")
    limit = None if older_than is None else datetime.now(UTC) - timedelta(days=min(older_than, 1_000_000))
    there = runs_below(base)
    chosen = to_prune(there, keep, limit)
    freed, removed, failed = 0, 0, False
    for each in reversed(chosen):  # later runs of a session before the folder that they are in
        try:
            said = why_not_removed(each.run)
            if not said:
                print(_pruned(each) if yes else f"would remove {printable(str(each.path))}")
                freed, removed = freed + each.size_bytes, removed + 1
        except OSError as error:
            said, failed = error.strerror or "cannot be read", True
        if said:
            print(f"left {printable(str(each.path))}: {said}")
    if not chosen:
        print(f"nothing to remove: {_why_none(base, len(there), keep, older_than)}")
        return ExitStatus.DONE
    print(
        f"{removed} run{'s' * (removed != 1)}, {size_text(freed)}{'' if yes or not removed else '; --yes removes them'}"
    )
    return ExitStatus.FAILED if failed else ExitStatus.DONE


def _why_none(base: Path, there: int, keep: int | None, older_than: int | None) -> str:
    kept = "" if keep is None else f", and the newest {keep} are kept"
    of = "none of the others" if kept else "none"
    older = (
        "" if older_than is None else f", and {of} was written more than {older_than} day{'s' * (older_than != 1)} ago"
    )
    return f"{there} run{'s' * (there != 1)} below {printable(str(base))}{kept}{older}"


def _pruned(each: Listed) -> str:
    others = remove_run(each.path)
    left = f"; left: {', '.join(printable(name, 60) for name in others)}" if others else ""
    return f"removed {printable(str(each.path))}{left}"


def _plain(run: Run) -> dict[str, Any]:
    return {
        "path": str(run.path),
        "summary": run.summary,
        "made_by": run.made_by,
        "events": run.event_list,
        "complaints": run.complaints,
    }
