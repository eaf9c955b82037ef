"""The command line: one entry for all commands, one place where errors become a line and an exit status.

Exit status 0: done. 1: the run failed or ended in a safe stop. 2: the command line, a cell or another file is wrong.
"""

import contextlib
import gc
import importlib
import importlib.metadata
import itertools
import logging
import os
import shutil
import signal
import sys
import threading
from collections.abc import Sequence

from cyclopts import App, CycloptsError, UnusedCliTokensError
from cyclopts.config import Env

from canarm_protocol.errors import CanarmError, ExitStatus
from canarm_protocol.shown import LONGEST_LINE, first_line, named_error, printable, printable_lines

from .compiled import how_it_runs
from .stopping import interrupt_on_terminate
from .usage import UsageError

FAILED = ExitStatus.FAILED
LEAST_COLUMNS, MOST_DIGITS = 20, 4
ENVIRONMENT_PREFIX = "CANARM_"
LOG_LEVEL = f"{ENVIRONMENT_PREFIX}LOG"


def version() -> str:
    """The version of the installed distribution, and whether it runs compiled."""
    return f"{importlib.metadata.version('canarm')} ({how_it_runs()})"


app = App(
    name="canarm",
    version=version,
    help="Hardware-in-the-loop bench for robot servo controllers on a virtual CAN bus.",
    help_epilogue=(
        "Every option can be given in the environment as well: --sync-timeout as CANARM_SYNC_TIMEOUT, and so on; an "
        "empty variable counts as none. "
        "Exit status: 0 done; 1 the run failed or was stopped; 2 the command line or a file is wrong."
    ),
    config=Env(ENVIRONMENT_PREFIX, command=False, show=False),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)
COMMANDS = {
    "demo": "Run emulator and controller against each other, with the dashboard on a terminal.",
    "emulator": "Emulate the robot: cards, electrics, arm and both buses.",
    "controller": "Control the robot: find the cards, run the law, stop safely.",
    "tui": "Watch a running bench in a dashboard.",
    "monitor": "Watch any CAN bus, decoded: frames, nodes, objects.",
    "jog": "Drive the cards by hand, where no controller runs.",
    "fault": "Break something on the signal path: list, inject, clear, trigger, status; matrix.",
    "reset": "Switch the robot of a running bench off and on again.",
    "runs": "The run folders that there are: list, show, convert, prune.",
    "replay": "A recorded run once more: on a bus, or checked byte for byte.",
    "report": "Runs as one HTML file; several are compared.",
    "study": "Many runs with settings from a grid or a sample, on all cores or a cluster.",
    "identify": "Masses, friction and torque constants of the robot, from what a run has measured.",
    "check": "Validate a cell file and show what it describes.",
    "new-cell": "Write a cell for an arm of your own: from its URDF file, or from a number of joints.",
    "export": "Describe a cell to other tools: EDS, DCF and bus.yml for CANopen masters, DBC for decoders.",
}
WITH_STOP_REQUEST = ("emulator", "controller")
"""Commands that open nothing before their own signal handler is installed."""
RUNS = ("demo", "emulator", "controller")
"""Commands that do their work whether or not their output is read."""
for _name, _help in COMMANDS.items():
    _module = _name.replace("-", "_")
    app.command(f"canarm.commands.{_module}:{_module}", name=_name, help=_help)
app.register_install_completion_command(add_to_startup=False)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave with its exit status."""
    status = run(sys.argv[1:] if arguments is None else arguments)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        status = _lose_stdout(error)
    arguments = sys.argv[1:] if arguments is None else arguments
    if getattr(sys.stdout, "has_lost_its_reader", False) and not set(arguments[:1]) & set(RUNS):
        status = status or FAILED
    if any(thread is not threading.main_thread() and not thread.daemon for thread in threading.enumerate()):
        _leave_threads_behind(status)
    if threading.current_thread() is threading.main_thread():
        signal.signal(
            signal.SIGINT, signal.SIG_IGN
        )  # while the interpreter ends, it would take the place of the status
    sys.exit(status)


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit status. Every error ends in a line on stderr, never in a traceback."""
    try:
        if list(arguments) == ["--version"]:
            print(version())  # the parser would load the formatting of help pages
            return 0
        _drop_empty_variables()
        _refuse_empty_folder(arguments)
        _fit_narrow_terminals()
        _import_command(arguments)
        _set_up_logging()
        result = app(arguments, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        command = " ".join(("canarm", *(error.command_chain or ())))
        said = f"{_without_long_words(str(error), arguments)}{_hint(error)}"
        return _complain(f"{said} See `{command} --help`.", ExitStatus.WRONG_INPUT)
    except CanarmError as error:
        return _complain(str(error), error.exit_status)
    except KeyboardInterrupt:
        return _complain("interrupted", FAILED)
    except BrokenPipeError as error:
        return _lose_stdout(error)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"{where}{error.strerror or first_line(error)}", FAILED)
    except Exception as error:
        logging.getLogger(__name__).debug("", exc_info=True)
        where = f"; {LOG_LEVEL}=debug shows where"
        return _complain(f"this should not happen: {named_error(error)}{where}", FAILED)
    return result if isinstance(result, int) else 0


def _drop_empty_variables() -> None:
    """A variable that a script has set to nothing is not given, for us and for the processes that we start."""
    for name in [name for name, value in os.environ.items() if name.startswith(ENVIRONMENT_PREFIX) and not value]:
        del os.environ[name]


def _refuse_empty_folder(arguments: Sequence[str]) -> None:
    """Raise `UsageError` for an empty `--out`, which as a path would be the current folder."""
    if "--out=" in arguments or ("--out", "") in itertools.pairwise(arguments):
        raise UsageError("--out: its value is empty; name a folder, or leave --out out")


def _fit_narrow_terminals() -> None:
    """Help is set in a width that it can be set in: at one column or two, its layout would never end."""
    app.console = app.error_console = None
    given = os.environ.get("COLUMNS", "")
    if given.isdigit():
        columns = int(given) if given.isascii() and len(given) <= MOST_DIGITS else 0
    else:
        columns = shutil.get_terminal_size().columns
    if columns < LEAST_COLUMNS:
        from rich.console import Console

        wide = high = LEAST_COLUMNS  # without a height, too, it would read the environment
        app.console = Console(width=wide, height=high)
        app.error_console = Console(width=wide, height=high, stderr=True)


def _import_command(arguments: Sequence[str]) -> None:
    """Import what a command needs before signals become exceptions, which an import may swallow."""
    for name in ("_".join(arguments[:words]) for words in (1, 2)):
        if name in (*COMMANDS, "fault_matrix"):
            importlib.import_module(f"canarm.commands.{name.replace('-', '_')}")
    gc.enable()
    if not arguments or arguments[0] not in WITH_STOP_REQUEST:
        interrupt_on_terminate()


def _leave_threads_behind(status: int) -> None:
    # A control law may have started a thread that never ends; the interpreter would wait for it.
    with contextlib.suppress(OSError, ValueError):
        sys.stderr.flush()
    os._exit(status)


def _set_up_logging() -> None:
    level = os.environ.get(LOG_LEVEL, "error").upper()
    if level not in logging.getLevelNamesMapping():
        raise UsageError(f"{LOG_LEVEL}={level.lower()}: must be debug, info, warning, error or critical")
    logging.basicConfig(level=level, format="%(levelname)s %(name)s: %(message)s")


def _lose_stdout(error: OSError) -> int:
    """A reader that has left is no error; anything else is reported."""
    # Otherwise the interpreter would flush the buffer again at exit, and complain.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED if isinstance(error, BrokenPipeError) else _complain(f"stdout: {error.strerror}", FAILED)


def _without_long_words(text: str, arguments: Sequence[str]) -> str:
    """What the parser complains of on one line, in which it repeats arguments whole."""
    for word in arguments:
        text = text.replace(word, printable(word)) if len(word) > LONGEST_LINE else text
    return " ".join(text.split())


def _hint(error: CycloptsError) -> str:
    """Which option a word is the value of that stands alone, if that is plain."""
    if not isinstance(error, UnusedCliTokensError) or not error.unused_tokens:
        return ""
    from .misplaced import hint

    command = app
    for name in error.command_chain or ():
        command = command[name]
    known = {name for argument in command.assemble_argument_collection() for name in argument.names}
    return hint(error.unused_tokens, known)


def _complain(text: str, status: int) -> int:
    for line in printable_lines(text).splitlines():
        print(f"canarm: {line}", file=sys.stderr)
    return status


if __name__ == "__main__":
    main()
