"""`canarm report`: runs as one HTML file; several are compared."""

import math
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from canarm_protocol.errors import ExitStatus
from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.shown import printable

from ..options import named_file
from ..runs.report.figures import above, figures_of, parse_limits, unlike
from ..runs.report.figures_drawn import draw_figures
from ..runs.report.page import charts_in_page, report_page, run_names
from ..runs.run import Run
from ..usage import UsageError

REPORT_FILE = "report.html"
MOST_RUNS = 8
"""More curves could not be told apart."""


def report(
    *runs: Annotated[Path, Parameter(name="RUN", help="Run folders; several are compared with the first.")],
    out: Annotated[
        Path | None,
        Parameter(
            metavar="FILE",
            converter=named_file,
            help="The file; report.html in the run folder unless given, for several runs in the working folder.",
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        Parameter(
            metavar="DIR",
            converter=named_file,
            help="Write every chart as SVG and PNG into this folder too; needs: pip install 'canarm[figures]'.",
        ),
    ] = None,
    fail_above: Annotated[
        list[str],
        Parameter(
            metavar="KEY=RATIO",
            negative=(),
            consume_multiple=False,
            show_default=False,
            help="Several runs: status 1 if a figure, as rms_lsb or joint2.rms_lsb, is more than so many times that of "
            "the first; may be repeated.",
        ),
    ] = [],  # noqa: B006
) -> int:
    """Write one self-contained HTML file: verdict, curves, faults and latencies, events, timing, configuration.

    It opens offline, zooms, prints, and follows the browser's light or dark.
    """
    if not runs:
        raise UsageError("report: of which runs? name a run folder, or several")
    if len(runs) > MOST_RUNS:
        raise UsageError(f"report: {len(runs)} runs; at most {MOST_RUNS} can be told apart")
    limits = parse_limits(fail_above)
    if limits and len(runs) < 2:
        raise UsageError("report: --fail-above compares runs; name two or more")
    opened = [Run(path) for path in runs]
    path = out or (opened[0].path / REPORT_FILE if len(opened) == 1 else Path(REPORT_FILE))
    page = report_page(opened, limits)
    replace_file(path, page.encode("utf-8"))
    print(printable(str(path)))
    if figures is not None:
        drawn = draw_figures(charts_in_page(opened), figures)
        print(f"{len(drawn)} pictures in {printable(str(figures))}")
    for run in opened:
        for text in run.complaints:
            print(f"canarm: {printable(str(run.path))}: {text}", file=sys.stderr)
    names = run_names(opened)
    if caution := unlike(opened, names):
        print(f"canarm: {caution}", file=sys.stderr)
    found = above(figures_of(opened), limits)
    for figure, place, limit in found:
        ratio = figure.ratio(place)
        shown = "no figure" if ratio is None else f"{ratio:.4g} times that of {names[0]}"
        if ratio is not None and math.isinf(ratio):
            shown = f"{figure.values[place]:.4g} where {names[0]} has none"
        print(f"{figure.key} of {names[place]}: {shown}, above {limit:g}")
    return ExitStatus.FAILED if found else ExitStatus.DONE
