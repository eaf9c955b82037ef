"""The dashboard as the front door starts it: on a bus, or of a recorded run, on the terminal or in a page."""

from collections.abc import Callable, Mapping
from typing import Any

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort

from .app import DashboardApp
from .bus.address import BusAddress
from .bus.hand import Hand
from .bus.watch import robot_watch
from .outcome import Outcome
from .record import Record
from .remembered import config_file
from .run_again import Again
from .terminal import check_terminal, ending_signals, run_app


def run_dashboard(
    cell: Cell,
    interface: str,
    channel: str | None,
    bus_options: Mapping[str, Any],
    on_start: Callable[[], None] | None = None,
    until: Callable[[], bool] | None = None,
    on_left: Callable[[str], None] | None = None,
    outcome_of: Callable[[], Outcome | None] | None = None,
    robot_bus: BusAddress | None = None,
    again: Again | None = None,
    hand: Hand | None = None,
) -> int:
    """Show the bench bus `-i interface -c channel key=value …` until the user quits; return an exit status, 0 = quit.

    `on_start` is called once, when the first screen is up; `until` often, and the dashboard ends when it is true.
    `on_left` is told at the end how the user has left it, in a few words. `outcome_of` returns how the run has ended,
    once it has, and without it the bench is asked; the dashboard shows it and stays. `robot_bus` is watched from the
    beginning or, if too much comes on it, from when a view of it is first chosen; `hand` drives its cards when the user
    asks for it.
    A missing or lost bus is shown and tried again. SIGINT, SIGTERM and SIGHUP end the dashboard and leave the terminal
    as it was. Raises `TerminalError` if stdin or stderr, on which the dashboard is drawn, is no terminal, and
    `BrokenError` if an error has ended it that nobody has foreseen.
    """
    check_terminal()
    bench = BusAddress(interface, channel, bus_options)
    watch = robot_watch(cell, robot_bus)
    if robot_bus is not None:
        watch.listen()
    app = DashboardApp(
        cell,
        bench.open,
        where=bench.where,
        on_start=on_start,
        until=until,
        outcome_of=outcome_of,
        signals=ending_signals(),
        bus=watch,
        again=again,
        config=config_file(),
        hand=hand,
    )
    status = run_app(app)
    if on_left is not None:
        on_left(app.left_by)
    return status


def show_record(record: Record) -> int:
    """Play a recorded run until the user quits; return an exit status. Raises `TerminalError`."""
    check_terminal()

    def refuse() -> BusPort:
        raise BusError(f"{record.where}: a recorded run has no bus")

    return run_app(DashboardApp(record.cell, refuse, record=record, signals=ending_signals(), config=config_file()))
