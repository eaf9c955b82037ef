"""`canarm study`: many runs with settings from a grid or a sample, on all cores or a cluster."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from canarm_protocol.errors import ExitStatus
from canarm_protocol.shown import printable

from ..options import Flag, named_file
from ..stdout import keep_stdout
from ..usage import UsageError
from ..workers.jobs import Jobs, cores

if TYPE_CHECKING:
    from ..study.journal import Journal
    from ..study.objective import Objective
    from ..study.plan import Study
    from ..study.running import Runner
    from ..workers.progress import Progress

STUDIES = Path("studies")
Say = Any


def study(
    file: Annotated[Path, Parameter(name="FILE", converter=named_file, help="Study file (TOML).")],
    /,
    *,
    out: Annotated[
        Path | None,
        Parameter(
            metavar="DIR",
            converter=named_file,
            help="Folder of the study, where it goes on after a kill; "
            "studies/NAME unless given, with the name of the file.",
        ),
    ] = None,
    jobs: Jobs = None,
    scheduler: Annotated[
        str | None,
        Parameter(metavar="ADDRESS", help="Run on the Dask cluster whose scheduler is there, such as tcp://host:8786."),
    ] = None,
    tune: Annotated[
        list[str],
        Parameter(
            metavar="KEY",
            negative=(),
            consume_multiple=False,
            show_default=False,
            help="Look for the gains, such as 'control.mras.*', with which the runs of the study go best ([tune] in "
            "the file says what is best), and print them as lines of a cell; may be repeated.",
        ),
    ] = [],  # noqa: B006
    json_: Annotated[Flag, Parameter(name="--json", help="Last line on stdout is one JSON object.")] = False,
) -> int:
    """Run a study: every combination, or a sample, of settings, in virtual time, into one table and one HTML page.

    What is done stays: started again after a kill, it goes on with what is left. Exit status 1 if a run could not be
    carried out, or the study was interrupted; a run that ends in a safe stop is a result like any other.
    """
    from ..study.checking import check_study, without_errors
    from ..study.cluster import on_cluster
    from ..study.running import on_this_machine
    from ..study.study_file import read_study
    from ..workers.progress import Progress

    planned, objective = read_study(file)
    check_study(planned, printable(str(file)))
    if short := without_errors(planned):
        if tune and objective.is_of_errors:
            raise UsageError(f"{printable(str(file))}: --tune would compare nothing: {short}")
        Progress().note(f"{printable(str(file))}: {short}")
    folder = STUDIES / file.stem if out is None else out
    processes = jobs or cores()
    runner = on_this_machine(processes) if scheduler is None else on_cluster(scheduler)
    where = f"{processes} at a time" if scheduler is None else f"on {printable(scheduler)}"
    progress = Progress(processes if scheduler is None else 1)
    say = keep_stdout()
    if tune:
        return _tune(planned, objective, tune, folder, runner, progress, say, json_)
    return _run(planned, folder, runner, progress, where, say, json_)


def _tune(
    planned: "Study",
    objective: "Objective",
    keys: list[str],
    folder: Path,
    runner: "Runner",
    progress: "Progress",
    say: Say,
    json_: bool,
) -> int:
    from ..study.description import description
    from ..study.journal import Journal
    from ..study.tuning import gains_of, lines_of, tuned

    gains = gains_of(planned, keys, objective)
    about = {**description(planned), "tune": [str(gain) for gain in gains], "objective": str(objective)}
    about |= {"evaluations": objective.evaluations, "search_seed": objective.seed}
    with Journal(folder, about) as journal:
        each = f"{len(planned)} run{'s' * (len(planned) != 1)} each"
        progress.note(f"{len(gains)} gains, at most {objective.evaluations} sets of them, {each}")
        progress.note(f"objective: {objective}")
        found = tuned(planned, objective, gains, journal, runner, progress)
    if found is None:
        progress.leave()
        progress.note("interrupted; again to go on")
        return ExitStatus.FAILED
    if json_:
        say(json.dumps(found.as_plain()))
    else:
        say("\n".join(lines_of(found, objective)))
    return ExitStatus.DONE


def _run(
    planned: "Study", folder: Path, runner: "Runner", progress: "Progress", where: str, say: Say, json_: bool
) -> int:
    from ..study.description import description
    from ..study.journal import Journal
    from ..study.running import run_study

    with Journal(folder, description(planned)) as journal:
        done = len(journal.places)
        before = f", {done} of them done before" if done else ""
        many = "s" * (len(planned) != 1)
        progress.note(f"{planned.title}: {len(planned)} run{many} of {planned.base.seconds:g} s{before}; {where}")
        begun_s = time.monotonic()
        is_whole = run_study(planned, journal, runner, progress)
        ran = len(journal.places) - done
        if not is_whole:
            progress.leave()
            progress.note(f"interrupted: {len(journal.places)} of {len(planned)} run{many} are done; again to go on")
        return _end(planned, journal, ran, time.monotonic() - begun_s, is_whole, say, json_)


def _end(planned: "Study", journal: "Journal", ran: int, wall_s: float, is_whole: bool, say: Say, json_: bool) -> int:
    from canarm_protocol.runs.own_file import replace_file

    from ..study.findings import findings_of
    from ..study.page import PAGE_FILE, study_page
    from ..study.table import write_table

    if not journal.places:
        return ExitStatus.FAILED
    found = findings_of(planned, journal)
    table, page = write_table(journal), journal.folder / PAGE_FILE
    replace_file(page, study_page(planned, found).encode())
    speed = ran * planned.base.seconds / wall_s if ran else None
    if json_:
        plain = {"title": planned.title, "runs": len(planned), "done": found.runs, "states": found.states}
        plain |= {"ran": ran, "wall_s": round(wall_s, 3), "table": str(table), "report": str(page)}
        say(json.dumps(plain | {"worst": [each.as_plain() for each in found.worst[:3]]}))
    else:
        say("\n".join([*found.lines(), *([] if speed is None else [f"{speed:.3g} virtual seconds a second"])]))
        say(f"written: {printable(str(table))}, {printable(str(page))}")
    return ExitStatus.DONE if is_whole and not found.states.get("broken") else ExitStatus.FAILED
