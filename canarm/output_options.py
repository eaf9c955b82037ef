"""The options of a run's record and summary, which its commands share."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .options import Flag

LEAST_MB = 0.1
"""Of a second of konkuk1 a log has 0.1 MB: smaller parts would be thousands."""
MOST_MB = 1e6


def megabytes(type_: object, value: float | None) -> None:
    """Refuse a size of a part that is too small, or none."""
    if value is not None and not LEAST_MB <= value <= MOST_MB:
        raise ValueError(f"must be a number of megabytes from {LEAST_MB:g} to {MOST_MB:g}.")


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
        float | None,
        Parameter(
            metavar="MB",
            validator=megabytes,
            help="Go on in a new file when a log of frames or signals has so many megabytes, at least 0.1.",
        ),
    ] = None
