"""How many processes a command may take: the option, and what it is unless given."""

import os
from typing import Annotated

from cyclopts import Parameter

from ..number_checks import at_least_one
from ..options import whole_number

Jobs = Annotated[
    int | None,
    Parameter(
        converter=whole_number, validator=at_least_one, metavar="NUMBER", help="Processes; one a core unless given."
    ),
]


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
