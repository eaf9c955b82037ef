"""`canarm jog`: drive the cards by hand, where no controller runs."""

import contextlib
import importlib
import signal
import sys
from collections.abc import Iterator
from types import FrameType
from typing import Annotated

from cyclopts import Parameter

from canarm_controller.errors import ControllerError
from canarm_controller.run.runner import LISTEN_NS
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock

from ..jogging.driver import Driver
from ..jogging.jog import Jog
from ..jogging.parsing import Command, Parser, Quit
from ..options import (
    DEFAULT_ADDRESS,
    ROBOT_BUS,
    Address,
    BusOptions,
    CellOptions,
    ClockName,
    MoreBusWords,
    NamedBus,
    check_clock,
    parse_address,
)
from ..usage import UsageError

FAILED, WRONG = 1, 2
PROMPT = "canarm> "


def jog(
    *bus_options: MoreBusWords,
    cell: CellOptions = CellOptions(),
    connect: Annotated[
        Address, Parameter(help="Where an emulator serves the virtual buses; used unless -i names another bus.")
    ] = DEFAULT_ADDRESS,
    bus: BusOptions = BusOptions(),
    clock: ClockName = "wall",
    do: Annotated[
        str | None,
        Parameter(
            metavar="COMMANDS",
            show_default=False,
            help="Carry these out and end, as --do 'current joint2 0.3; step 10; read'; else they come from stdin.",
        ),
    ] = None,
) -> int:
    """Drive the cards by hand: set an output, step a cycle, read the inputs. `help` at the prompt lists the commands.

    At a terminal a wrong line changes nothing. From a pipe and with --do the first error ends the session. In every
    case the cards are left safe.
    """
    nominal = cell.load()
    robot_bus = bus.named(bus_options)
    check_clock(clock, robot_bus)
    if robot_bus is None:
        host, port_number = parse_address("--connect", connect)
        robot_bus = NamedBus("canarm", ROBOT_BUS, {"host": host, "port": port_number})
    nodes = card_nodes(nominal)
    parser = Parser(nominal, nodes)
    given = None if do is None else parser.parse_all(do)
    master = Jog(nominal, nodes, Clock[clock.upper()])
    with robot_bus.open() as port:
        driver = Driver(master, port)
        try:
            return _session(driver, master, parser, given)
        finally:
            driver.end()


def _session(driver: Driver, master: Jog, parser: Parser, given: list[Command] | None) -> int:
    """Carry out the given commands, or those from stdin; the exit status. Raises `ControllerError`, `BusError`."""
    driver.carry_out(master.begin(LISTEN_NS))
    if given is not None:
        _carry_out(driver, master, given)
        driver.look()
        return 0
    is_patient = sys.stdin.isatty()
    done = 0
    for line in _lines(driver, is_patient):
        try:
            commands = parser.parse_all(line)
            with _interruptible(master) if is_patient else contextlib.nullcontext():
                is_wanted = _carry_out(driver, master, commands)
            if not is_wanted:
                break
        except UsageError as error:
            if not is_patient:
                raise UsageError(f"{error}; {_told(done)} carried out") from None
            _complain(str(error))
        except ControllerError as error:
            if not is_patient:
                raise
            _complain(str(error))
            if master.is_over:
                return FAILED
        else:
            done += len(commands)
    driver.look()
    return 0


def _carry_out(driver: Driver, master: Jog, commands: list[Command]) -> bool:
    """Carry out `commands`; False after `quit`."""
    for command in commands:
        if isinstance(command, Quit):
            return False
        for line in driver.carry_out(master.run(command)):
            print(line, flush=True)
    return True


def _told(done: int) -> str:
    if done == 1:
        return "the command before it was"
    return f"the {done} commands before it were" if done else "nothing was"


@contextlib.contextmanager
def _interruptible(master: Jog) -> Iterator[None]:
    """Ctrl-C ends a running step; without one, or pressed again, it ends the session."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        if master.is_interrupted or not master.is_stepping:
            raise KeyboardInterrupt
        master.interrupt()

    before = signal.signal(signal.SIGINT, on_signal)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _lines(driver: Driver, is_terminal: bool) -> Iterator[str]:
    """Lines from stdin until its end; the bus is kept alive meanwhile."""
    if is_terminal:
        with contextlib.suppress(ImportError):  # history and editing, where the platform has them
            importlib.import_module("readline")
        print("cards are in OPERATIONAL, outputs off; help lists the commands", flush=True)
    while True:
        try:
            line = driver.ask_user(lambda: input(PROMPT if is_terminal else ""))
        except EOFError:
            return
        yield line


def _complain(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)
