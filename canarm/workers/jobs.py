"""How many processes a command may take: the option, and what it is unless given."""

import os
from typing import Annotated

from cyclopts import Parameter

from ..options import whole_number


def _at_least_one(type_: object, value: int | None) -> None:
    if value is not None and value < 1:
        raise ValueError("must be 1 or more.")


Jobs = Annotated[
    int | None,
    Parameter(
        converter=whole_number, validator=_at_least_one, metavar="NUMBER", help="Processes; one a core unless given."
    ),
]


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
