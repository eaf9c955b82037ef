"""`canarm tui`: the dashboard."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import ExitStatus
from canarm_protocol.runs.run_folder import RunFolderError
from canarm_tui.bus.address import BusAddress
from canarm_tui.entry import run_dashboard, show_record
from canarm_tui.record import Record

from ..handed_runs import HandedRuns
from ..jogging.after_run import port_after_run
from ..jogging.hand import HandInThread
from ..options import (
    BENCH_BUS,
    DEFAULT_ADDRESS,
    ROBOT_BUS,
    Address,
    BenchBusOptions,
    BusOptions,
    CellOptions,
    NamedBus,
    named_file,
    parse_address,
)
from ..usage import UsageError
from ..web import DEFAULT_PORT, Web, WebPort, serve_web


def tui(
    run: Annotated[
        Path | None,
        Parameter(name="RUN", converter=named_file, help="A run folder, which is played instead of watching a bench."),
    ] = None,
    /,
    *,
    cell: CellOptions = CellOptions(),
    connect: Annotated[
        Address,
        Parameter(help="Where an emulator serves the virtual buses; used for a bus that is not named otherwise."),
    ] = DEFAULT_ADDRESS,
    bus: BusOptions = BusOptions(),
    bench: BenchBusOptions = BenchBusOptions(),
    web: Web = False,
    web_port: WebPort = DEFAULT_PORT,
    demo: Annotated[Path | None, Parameter(show=False)] = None,
) -> int:
    """Watch a running bench in a dashboard: link, rate, late cycles, joints, error traces, faults, frames of the bus.

    A bus that is missing or lost is shown, and tried again. f injects a fault, x clears faults, e is the emergency
    stop, R switches the robot off and on again, q or Ctrl-C quits; bench and controller go on.
    A recorded RUN plays in the same views: space stops and goes on, n goes to the next event, [ and ] skip.
    --web serves the same to a browser on this machine.
    """
    if run is not None:
        record = _record(run, cell.load, connect, bus, bench)
        named_cell = ["--cell", cell.cell, *(word for each in cell.settings for word in ("--set", each))]
        if web:
            serve_web(["tui", str(run.absolute()), *named_cell], web_port, f"canarm tui {run.name}")
            return ExitStatus.DONE
        return show_record(record)
    nominal = cell.load()
    host, port = parse_address("--connect", connect)
    if web:
        words = ["tui", "--cell", cell.cell, *(word for each in cell.settings for word in ("--set", each))]
        serve_web([*words, "--connect", connect, *_words(bus), *_words(bench)], web_port, "canarm tui")
        return ExitStatus.DONE
    runs = None if demo is None else HandedRuns(demo)
    here: Mapping[str, Any] = {"host": host, "port": port} if runs is None else runs.where
    robot_bus, bench_bus = bus.named(), bench.named()
    if robot_bus is None and bench_bus is None:
        robot_bus = NamedBus("canarm", ROBOT_BUS, here)
    named = bench_bus or NamedBus("canarm", BENCH_BUS, here)
    robot = None if robot_bus is None else BusAddress(robot_bus.interface, robot_bus.channel, robot_bus.options)
    hand = None
    if robot is not None:
        bench_of_run = BusAddress(named.interface, named.channel, named.options)
        hand = HandInThread(
            nominal,
            robot.open
            if runs is None
            else port_after_run(nominal, lambda: runs.outcome() is not None, robot.open, bench_of_run.open),
        )
    return run_dashboard(
        *(nominal, named.interface, named.channel, named.options),
        outcome_of=None if runs is None else runs.outcome,
        robot_bus=robot,
        again=runs,
        hand=hand,
    )


def _record(path: Path, cell: Callable[[], Cell], connect: str, *buses: BusOptions | BenchBusOptions) -> Record:
    from ..runs.record_of import record_of
    from ..runs.run import Run

    if connect != DEFAULT_ADDRESS or any(each.named() is not None for each in buses):
        raise UsageError("tui RUN: a recorded run is played, and no bus is opened; leave the options of a bus out")
    run = Run(path)
    record = record_of(run, cell)
    if not len(record.history.cycles):
        raise RunFolderError(f"{path}: has no signals that could be played; canarm runs show {path} has the rest")
    return record


def _words(options: BusOptions | BenchBusOptions) -> list[str]:
    """The options that were given, as on the command line."""
    words = []
    for each in fields(options):
        value = getattr(options, each.name)
        if value:
            words += [f"--{each.name.replace('_', '-')}", *(value if isinstance(value, list) else [value])]
    return words
