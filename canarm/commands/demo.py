"""`canarm demo`: emulator, controller and dashboard as separate processes, and a summary at the end."""

import contextlib
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from ..demo_run import DemoPlan, tell
from ..demo_runs import DemoRuns
from ..handed_runs import handing_over
from ..options import (
    BENCH_BUS,
    DEFAULT_HOST,
    DEFAULT_SYNC_TIMEOUT_S,
    ROBOT_BUS,
    Address,
    CellOptions,
    ClockName,
    ControlOptions,
    FaultFile,
    Flag,
    Pace,
    Seconds,
    Seed,
    SyncTimeout,
    Truth,
    Wire,
    check_pace,
    parse_address,
)
from ..output_options import OutputOptions
from ..recording import parse_recording
from ..serving import is_remote
from ..session import make_bench, make_controller, tick_count, traffic_warning
from ..stdout import keep_stdout
from ..stopping import cause_of, ignore_hangups
from ..usage import UsageError, parse_settings
from ..web import DEFAULT_PORT, Web, WebPort, check_web, serve_web

if TYPE_CHECKING:
    from canarm_controller.run.controller import Controller

PACE_HELP = (
    "Lockstep: virtual time passes at most X times as fast as the wall clock; max does not wait. "
    "1 on a terminal, else max."
)


def demo(
    *,
    cell: CellOptions = CellOptions(),
    control: ControlOptions = ControlOptions(),
    clock: ClockName = "sync",
    pace: Annotated[Pace | None, Parameter(show_default=False, help=PACE_HELP)] = None,
    sync_timeout: SyncTimeout = DEFAULT_SYNC_TIMEOUT_S,
    seconds: Annotated[Seconds, Parameter(help="Length of the run in robot time.")] = 10.24,
    seed: Seed = 0,
    truth: Truth | None = None,
    wire: Wire = False,
    faults: FaultFile = None,
    serve: Annotated[
        Address,
        Parameter(
            help="Where to serve the virtual buses, on this machine, for others to attach; port 0 is any free one."
        ),
    ] = f"{DEFAULT_HOST}:0",
    output: OutputOptions = OutputOptions(),
    no_tui: Annotated[Flag, Parameter(help="No dashboard, even on a terminal.")] = False,
    web: Web = False,
    web_port: WebPort = DEFAULT_PORT,
) -> int:
    """Run emulator and controller against each other over the virtual bus; with the dashboard on a terminal.

    Time stands still until every part of a cycle is done (lockstep), so a busy machine makes it slower, never wrong.
    Ends with a summary. The run is recorded in --out, or in a new folder below runs/. Ctrl-C stops the robot safely.
    The dashboard stays when the run is over and shows how it went; r runs again, with another law, motion, seed or pace
    if you like. q leaves it, and what runs goes on to its end; Q leaves it and stops what runs. With --web it is in a
    browser on this machine instead, until Ctrl-C, and r runs again there as well.
    """
    nominal = cell.load()
    settings = truth or []
    host = _served_host(serve)
    is_terminal = _is_terminal()
    with_dashboard = web or (not no_tui and not output.json and is_terminal)
    check_pace(clock, pace)
    if clock == "sync" and pace is None:
        pace = 1.0 if is_terminal or web else math.inf
    if web:
        check_web()
    say = keep_stdout()
    built = _check(nominal, control, clock, seconds, settings)
    if faults is not None:
        from ..fault_file import load_faults

        load_faults(faults, make_bench(nominal, parse_settings("--truth", settings), Clock[clock.upper()], seed, wire))
    warning = traffic_warning(nominal, cell.cell)
    if warning is not None:
        tell(warning)
    recording = parse_recording(output.record, output.rotate, output.out or Path(), tell)
    plan = DemoPlan(
        *(nominal, cell.cell, cell.settings, control, built.loop.feedforward_kind, clock, pace, sync_timeout, seconds),
        *(seed, settings, wire, faults, serve, host, recording, output.rotate),
    )
    runs = DemoRuns(plan, output.out, with_dashboard)
    try:
        runs.run.start()
        if web:
            _serve(runs, web_port)
        elif with_dashboard:
            _watch(runs)
        runs.run.wait()
    except KeyboardInterrupt as interrupt:
        ignore_hangups()
        tell("stopping")
        runs.run.interrupt(cause_of(interrupt))
    finally:
        runs.close()
    return runs.report(output.json, say)


def _is_terminal() -> bool:
    """Whether stdin, stdout and stderr are a terminal."""
    return all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr))


def _check(cell: Cell, control: ControlOptions, clock: str, seconds: float, truth: Sequence[str]) -> "Controller":
    """Check the command line before any process starts; returns the controller that it describes.

    A law's file is run by that, and may change the working folder: it does so again in the process of the controller.
    """
    tick_count(cell, seconds)
    if truth:
        from canarm_emulator.robot.truth import Truth as TrueRobot

        TrueRobot.from_settings(cell, parse_settings("--truth", truth))
    with contextlib.chdir(Path.cwd()):
        return make_controller(cell, control.law, control.motion(cell), control.feedforward, Clock[clock.upper()])


def _served_host(serve: str) -> str:
    """The host of `--serve`. Raises `UsageError` if other machines can reach it."""
    host, _ = parse_address("--serve", serve, any_port=True)
    is_open = False
    with contextlib.suppress(ValueError):  # the emulator looks names up
        is_open = is_remote(host)
    if is_open:
        raise UsageError(f"--serve {serve}: a demo is for this machine; canarm emulator has --allow-remote")
    return host


def _serve(runs: DemoRuns, port: int) -> None:
    """The dashboard in a browser, until SIGINT or SIGTERM; raises `KeyboardInterrupt` if the run is not over then."""
    plan = runs.run.plan
    words = ["tui", "--cell", plan.cell_name, *(word for each in plan.settings for word in ("--set", each))]
    with tempfile.TemporaryDirectory() as folder, handing_over(runs, Path(folder), tell):
        serve_web([*words, "--demo", folder], port, "canarm demo")
    if not runs.run.is_over:
        raise KeyboardInterrupt


def _watch(runs: DemoRuns) -> None:
    """The dashboard in this process, until its user leaves it, or time is up and the run is not over.

    Raises `KeyboardInterrupt`, with how, if its user has stopped what runs before it was over.
    """
    from canarm_tui.bus.address import BusAddress
    from canarm_tui.entry import run_dashboard
    from canarm_tui.errors import BrokenError
    from canarm_tui.outcome import Outcome
    from canarm_tui.run_controls import LEFT

    from ..jogging.after_run import port_after_run
    from ..jogging.hand import HandInThread

    def outcome() -> Outcome | None:
        found = runs.run.outcome()
        return None if found is None else Outcome(*found)

    left: list[str] = []
    cell = runs.run.plan.cell
    robot, bench = (BusAddress("canarm", bus, runs.where) for bus in (ROBOT_BUS, BENCH_BUS))
    try:
        run_dashboard(
            cell,
            "canarm",
            BENCH_BUS,
            runs.where,
            until=lambda: runs.run.is_given_up,
            on_left=left.append,
            outcome_of=outcome,
            robot_bus=robot,
            again=runs,
            hand=HandInThread(cell, port_after_run(cell, lambda: runs.run.is_over, robot.open, bench.open)),
        )
    except BrokenError as error:
        tell(str(error))  # the robot needs no dashboard
        left.append(LEFT)
    if runs.run.is_over:
        return
    if left != [LEFT]:
        raise KeyboardInterrupt(*left)
    tell("the run goes on without the dashboard; Ctrl-C stops it")
