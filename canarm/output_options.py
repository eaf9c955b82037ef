"""The options of a run's record and summary, which its commands share."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .options import Flag, at_least_one, whole_number


@Parameter(name="*")
@dataclass(frozen=True)
class OutputOptions:
    """Where the run is recorded and how it is summarized."""

    out: Annotated[Path | None, Parameter(metavar="DIR", help="Run folder to record into; must not hold a run.")] = None
    json: Annotated[Flag, Parameter(help="Last line on stdout is the summary as one JSON object.")] = False
    record: Annotated[
        str | None,
        Parameter(
            metavar="FORMAT,…",
            help="Further records: bench (the frames of the bench's own bus), parquet (of the signals, while the run "
            "goes on), and blf, mcap, mf4 at its end; "
            "needs: pip install 'canarm[parquet,mcap,mf4]'.",
        ),
    ] = None
    rotate: Annotated[
        int | None,
        Parameter(
            metavar="MB",
            converter=whole_number,
            validator=at_least_one,
            help="Go on in a new file when a log of frames or signals has so many megabytes.",
        ),
    ] = None
