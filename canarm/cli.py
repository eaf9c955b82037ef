"""The command line: one entry for all commands, one place where errors become a line and an exit status.

Status 0: done. 1: the run failed or ended in a safe stop. 2: the command line, a cell or another file given to it is wrong.
"""

import importlib.metadata
import logging
import os
import sys
from collections.abc import Sequence

from canarm_protocol.errors import BusError, CellError, ProtocolError
from cyclopts import App, CycloptsError

from .session import UsageError

FAILED, WRONG_USAGE, INTERRUPTED = 1, 2, 130

app = App(
    name="canarm",
    version=importlib.metadata.version("canarm"),
    help="Hardware-in-the-loop bench for robot servo controllers on a virtual CAN bus.",
    result_action="return_value",
)
for _name, _help in {
    "demo": "Run emulator and controller against each other, with the dashboard on a terminal.",
    "emulator": "Emulate the robot: cards, electrics, arm and both buses.",
    "controller": "Control the robot: find the cards, run the law, stop safely.",
    "tui": "Watch a running bench.",
    "check": "Validate a cell file and show what it describes.",
}.items():
    app.command(f"canarm.commands.{_name}:{_name}", name=_name, help=_help)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    logging.basicConfig(level=os.environ.get("CANARM_LOG", "ERROR").upper(), format="%(levelname)s %(name)s: %(message)s")
    try:
        sys.exit(run(sys.argv[1:] if arguments is None else arguments))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status. Every expected error ends in one line on stderr."""
    try:
        result = app(arguments, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return _complain(f"{error} See `canarm {' '.join(error.command_chain or ())} --help`.", WRONG_USAGE)
    except (UsageError, CellError) as error:
        return _complain(str(error), WRONG_USAGE)
    except BusError as error:
        return _complain(str(error), FAILED)
    except ProtocolError as error:
        return _complain(str(error), WRONG_USAGE)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    return result if isinstance(result, int) else 0


def _complain(text: str, status: int) -> int:
    for line in text.splitlines():
        print(f"canarm: {line}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
