"""`canarm identify`: masses, friction and torque constants of the robot, from what a run has measured."""

import json
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.errors import ExitStatus
from canarm_protocol.shown import printable, quoted

from ..identify.identification import identified
from ..identify.physical import USUAL, Kind
from ..options import Flag, named_file
from ..runs.run import Run
from ..usage import UsageError

ALL = "all"
USUALLY = ",".join(kind.value for kind in USUAL)


def identify(
    run: Annotated[Path, Parameter(name="RUN", converter=named_file, help="A run folder.")],
    /,
    *,
    free: Annotated[
        str,
        Parameter(
            metavar="KIND,…",
            help="What is estimated: masses, centres, coulomb, viscous, torque-constants, or all; the rest is as in "
            "the cell of the run.",
        ),
    ] = USUALLY,
    json_: Annotated[Flag, Parameter(name="--json", help="As one JSON object.")] = False,
) -> int:
    """Estimate what the robot is like from a run's measurements, with 95 % intervals, and print lines for its cell.

    Least squares on the arm's regressor. Nothing of the run's truth is read. `--trajectory excite` is a motion made
    for it: canarm demo --trajectory excite --seconds 10 --out RUN.
    """
    kinds = _kinds(free)
    opened = Run(run)
    found = identified(opened, kinds)
    for text in opened.complaints:
        print(f"canarm: {printable(str(run))}: {text}", file=sys.stderr)
    if opened.faults:
        print("canarm: faults acted in this run: what they did to its signals is in the figures", file=sys.stderr)
    print(json.dumps(found.as_plain()) if json_ else "\n".join(found.lines()))
    return ExitStatus.DONE


def _kinds(free: str) -> tuple[Kind, ...]:
    known = [kind.value for kind in Kind]
    words = [word.strip() for word in free.split(",")]
    if words == [ALL]:
        return tuple(Kind)
    for word in words:
        if word not in known:
            raise UsageError(f"--free {quoted(word)}: must be {', '.join(known)}, or all{nearest(word, known)}")
    return tuple(kind for kind in Kind if kind.value in words)
