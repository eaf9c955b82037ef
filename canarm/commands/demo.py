"""`canarm demo`: emulator, controller and dashboard as separate processes, and a summary at the end."""

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from canarm_controller.bus.assessment import JointFigures
from canarm_controller.run.controller import Controller
from canarm_emulator.robot.truth import Truth as TrueRobot
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import ExitStatus
from canarm_protocol.runs.run_folder import create_run_folder, new_run_folder, update_run_file
from canarm_protocol.runs.tentative import Tentative

from ..child import START_S, Child, ended_too_early, offered_port, running
from ..fault_file import load_faults
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
    pace_text,
    parse_address,
    wait_text,
)
from ..output_options import OutputOptions
from ..recording import PARQUET, parse_recording, recording_failure
from ..runs.converting import convert_all
from ..serving import attach_flags, is_remote
from ..session import make_bench, make_controller, tick_count, traffic_warning
from ..stdout import keep_stdout
from ..stopping import cause_of, ignore_hangups
from ..summary import Summary
from ..usage import UsageError, parse_settings

SLOWEST = 10.0
"""A run is given up after this many times its robot time, plus START_S."""
PACE_HELP = (
    "Lockstep: virtual time passes at most X times as fast as the wall clock; max does not wait. "
    "1 on a terminal, else max."
)
PASSED_ON = (ExitStatus.DONE, ExitStatus.WRONG_INPUT)
"""Exit statuses of the controller that are passed on; any other is a failed run."""


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
) -> int:
    """Run emulator and controller against each other over the virtual bus; with the dashboard on a terminal.

    Time stands still until every part of a cycle is done (lockstep), so a busy machine makes it slower, never wrong.
    Ends with a summary. The run is recorded in --out, or in a new folder below runs/. Ctrl-C stops the robot safely,
    and so does leaving the dashboard (q), which stays when the run is over and shows how it went.
    """
    nominal = cell.load()
    settings = truth or []
    host = _served_host(serve)
    is_terminal = _is_terminal()
    with_dashboard = not no_tui and not output.json and is_terminal
    check_pace(clock, pace)
    if clock == "sync" and pace is None:
        pace = 1.0 if is_terminal else math.inf
    say = keep_stdout()
    built = _check(nominal, control, clock, seconds, settings)
    if faults is not None:
        load_faults(faults, make_bench(nominal, parse_settings("--truth", settings), Clock[clock.upper()], seed, wire))
    warning = traffic_warning(nominal, cell.cell)
    if warning is not None:
        _tell(warning)
    recording = parse_recording(output.record, output.rotate, output.out or Path(), _tell)
    made = Tentative()
    folder = create_run_folder(output.out, made=made) if output.out is not None else new_run_folder(made=made)
    common = ["--cell", cell.cell, "--clock", clock, "--out", str(folder), "--json"]
    common += ["--sync-timeout", wait_text(sync_timeout)]
    common += _each("--set", cell.settings)
    robot = ["--serve", serve, "--seed", str(seed), *_each("--truth", settings)]
    if output.rotate is not None:
        common += ["--rotate", str(output.rotate)]
    if PARQUET in recording.formats:
        common += ["--record", PARQUET]
    if wire:
        robot.append("--wire")
    if faults is not None:
        robot += ["--faults", str(faults)]
    emulator: Child | None = None
    controller: Child | None = None
    cause: str | None = None
    with contextlib.ExitStack() as stack:
        try:
            emulator = stack.enter_context(running("emulator", [*common, *robot], quiet=with_dashboard))
            with made:
                port = offered_port(emulator)
            arguments = [*common, *_controller_arguments(nominal, control, f"{host}:{port}", seconds)]
            if pace is not None:
                arguments += ["--pace", pace_text(pace)]
            if not with_dashboard:
                arguments.append("--progress")
            for bus in (ROBOT_BUS, BENCH_BUS):
                _tell(f"to attach to {bus}: {attach_flags(bus, host, port)}")
            controller = stack.enter_context(running("controller", arguments, quiet=with_dashboard))
            # With no time-out, a debugger may hold it for ever.
            limit_s = START_S + SLOWEST * seconds / min(pace or 1.0, 1.0) if math.isfinite(sync_timeout) else math.inf
            deadline_s = time.monotonic() + limit_s
            if with_dashboard:
                _watch(nominal, host, port, controller, deadline_s, folder)
            if not controller.wait(max(deadline_s - time.monotonic(), 0.0)):
                _tell(f"the controller has not ended within {limit_s:g} s and is given up")
                controller.end()
        except KeyboardInterrupt as interrupt:
            ignore_hangups()
            cause = cause_of(interrupt)
            _tell("stopping")
            if controller is not None:
                controller.end(cause)
        complaints = "".join(child.complaints for child in (emulator, controller) if child is not None)
        if cause is None and emulator is not None and emulator.status is not None:
            complaints += f"canarm: the emulator has ended with status {emulator.status}\n"
    print(complaints, end="", file=sys.stderr)
    for name in _of_summary(emulator, "faults_never_begun") or ():
        _tell(f"fault never began: {name}")
    known = {"seed": seed, "faults": _of_summary(emulator, "faults"), "out": str(folder)}
    if nominal.object is not None:
        known["object"] = _of_summary(emulator, "object")
    if cause is not None and _result(controller) is None:
        known |= {"feedforward": built.loop.feedforward_kind, "clock": clock, "reason": f"interrupted: {cause}"}
        return _report(None, _unbegun(nominal, control, known), folder, output.json, say)
    status = _report(controller, known, folder, output.json, say)
    return status if convert_all(folder, recording.at_the_end, _tell) else status or ExitStatus.FAILED


def _each(option: str, words: Sequence[str]) -> list[str]:
    return [argument for word in words for argument in (option, word)]


def _is_terminal() -> bool:
    """Whether stdin, stdout and stderr are a terminal."""
    return all(stream is not None and stream.isatty() for stream in (sys.stdin, sys.stdout, sys.stderr))


def _controller_arguments(cell: Cell, control: ControlOptions, address: str, seconds: float) -> list[str]:
    arguments = ["--connect", address, "--seconds", str(seconds)]
    arguments += ["--law", control.law, "--trajectory", control.motion(cell)]
    if control.feedforward is not None:
        arguments += ["--feedforward", control.feedforward]
    return arguments


def _check(cell: Cell, control: ControlOptions, clock: str, seconds: float, truth: Sequence[str]) -> Controller:
    """Check the command line before any process starts; returns the controller that it describes."""
    tick_count(cell, seconds)
    TrueRobot.from_settings(cell, parse_settings("--truth", truth))
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


def _watch(cell: Cell, host: str, port: int, controller: Child, deadline_s: float, folder: Path) -> None:
    """The dashboard in this process, until its user leaves it, or time is up and the run is not over.

    Raises `KeyboardInterrupt`, with how, if its user has left it before the run was over.
    """
    from canarm_tui.app import run_dashboard
    from canarm_tui.bus.address import BusAddress
    from canarm_tui.outcome import Outcome

    def is_given_up() -> bool:
        return controller.status is None and time.monotonic() > deadline_s

    def outcome() -> Outcome | None:
        if controller.status is None or not controller.wait(0.0):
            return None
        result = _result(controller)
        if result is None:
            return Outcome(f"the controller ended with status {controller.status}", False, [str(folder)])
        verdict, *details = _summary({**result, "out": str(folder)}).as_text().splitlines()
        return Outcome(verdict, controller.status == ExitStatus.DONE, details)

    left: list[str] = []
    where = {"host": host, "port": port}
    run_dashboard(
        cell,
        "canarm",
        BENCH_BUS,
        where,
        until=is_given_up,
        on_left=left.append,
        outcome_of=outcome,
        robot_bus=BusAddress("canarm", ROBOT_BUS, where),
    )
    if controller.status is None and not is_given_up():
        raise KeyboardInterrupt(*left)


def _of_summary(emulator: Child | None, key: str) -> Any:
    """A figure of the emulator's summary; None if there is no summary."""
    return (_result(emulator) or {}).get(key)


def _result(child: Child | None) -> dict[str, Any] | None:
    """The summary that a process has printed; None without one."""
    with contextlib.suppress(IndexError, ValueError, TypeError):
        return None if child is None else dict(json.loads(child.printed.splitlines()[-1]))
    return None


def _unbegun(cell: Cell, control: ControlOptions, known: Mapping[str, Any]) -> dict[str, Any]:
    """The summary of a run that was interrupted before a controller could give one."""
    options = {"cell": cell.name, "law": control.law, "trajectory": control.motion(cell), "state": "interrupted"}
    figures: dict[str, Any] = {
        "ticks": 0,
        "missed": 0,
        "late": 0,
        "real_time_factor": None,
        "joints": {},
        "detections": (),
    }
    return {**options, **figures, **known}


def _report(
    controller: Child | None, known: Mapping[str, Any], folder: Path, as_json: bool, say: Callable[[str], None]
) -> int:
    """Print the summary of the run, complete its record, and return the exit status.

    `known` is what the controller does not know, or all there is without one.
    """
    result = _result(controller)
    if controller is not None and result is None:
        text = f"the controller ended with status {controller.status} and without a summary"
        raise ended_too_early(controller, text)
    summary = _summary({**(result or {}), **known})
    failure = recording_failure(folder, lambda: update_run_file(folder, "summary", summary.as_json()))
    say(json.dumps(summary.as_json()) if as_json else summary.as_text())
    if failure is not None:
        _tell(failure)
    if failure is not None or controller is None:
        return ExitStatus.FAILED
    assert controller.status is not None
    return controller.status if controller.status in PASSED_ON else ExitStatus.FAILED


def _summary(result: Mapping[str, Any]) -> Summary:
    joints = {name: JointFigures(**figures) for name, figures in result["joints"].items()}
    return Summary(**{**result, "joints": joints, "detections": tuple(result["detections"])})


def _tell(text: str) -> None:
    print(f"canarm: {text}", file=sys.stderr, flush=True)
