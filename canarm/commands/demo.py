"""`canarm demo`: emulator, controller and dashboard as separate processes, and a summary at the end."""

import json
import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Annotated

from canarm_controller.errors import ControllerError
from canarm_emulator.errors import TruthError
from canarm_emulator.truth import Truth
from canarm_protocol.cell import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError
from canarm_protocol.run_folder import create_run_folder, new_run_folder, update_run_file
from cyclopts import Parameter

from ..options import CellOptions, ClockName, ControlOptions, OutputOptions, Words
from ..session import UsageError, make_controller, parse_settings, tick_count
from ..summary import JointFigures, Summary

START_S = 30.0
"""How long the emulator may take to offer its bus: a cold start reads a physics engine from disk."""
END_S = 10.0
STARTUP_ALLOWANCE_S = 60.0


def demo(
    *,
    cell: CellOptions = CellOptions(),
    control: ControlOptions = ControlOptions(),
    output: OutputOptions = OutputOptions(),
    clock: Annotated[ClockName, Parameter(help="What drives time: the wall clock, or SYNC (lockstep).")] = "wall",
    seconds: Annotated[float, Parameter(help="Length of the run in seconds of robot time.")] = 10.24,
    seed: Annotated[int, Parameter(help="Seed of the sensor noise.")] = 0,
    truth: Annotated[
        Words | None, Parameter(help="KEY=VALUE: what differs from nominal in the true robot; may be repeated.")
    ] = None,
    no_tui: Annotated[bool, Parameter(negative=(), help="No dashboard, even on a terminal.")] = False,
) -> int:
    """Run emulator and controller against each other over the virtual bus; with the dashboard on a terminal.

    Ends with a summary. The run is recorded in --out, or in a new folder below runs/.
    """
    nominal = cell.load()
    settings = truth or []
    _check(nominal, control, clock, seconds, settings)
    if seed < 0:
        raise UsageError(f"--seed {seed}: must not be negative")
    folder = create_run_folder(output.out) if output.out is not None else new_run_folder()
    with_dashboard = not no_tui and not output.json and sys.stdin.isatty() and sys.stdout.isatty()
    common = ["--cell", cell.cell, "--clock", clock, "--out", str(folder), "--json", "--with-parent"]
    common += [word for setting in cell.settings for word in ("--set", setting)]
    emulator = _Child(
        "emulator",
        [*common, "--serve", "127.0.0.1:0", "--seed", str(seed), *[w for s in settings for w in ("--truth", s)]],
    )
    controller: _Child | None = None
    try:
        port = _port_of(emulator)
        arguments = [*common, "--connect", f"127.0.0.1:{port}", "--seconds", str(seconds)]
        arguments += ["--law", control.law, "--trajectory", control.trajectory]
        if control.feedforward is not None:
            arguments += ["--feedforward", control.feedforward]
        controller = _Child("controller", arguments if with_dashboard else [*arguments, "--progress"], quiet=with_dashboard)
        if with_dashboard:
            _show_dashboard(nominal, port, controller)
        result = _wait(controller, seconds)
    finally:
        for child in (controller, emulator):
            if child is not None:
                child.end()
    summary = _summary(result, seed, str(folder))
    update_run_file(folder, "summary", summary.as_json())
    print(json.dumps(summary.as_json()) if output.json else summary.as_text(), flush=True)
    if controller.errors:
        print(controller.errors, end="", file=sys.stderr)
    return controller.process.returncode


class _Child:
    """One of our own commands as a process in a session of its own, so that Ctrl-C reaches it in the right order."""

    def __init__(self, command: str, arguments: Sequence[str], quiet: bool = False) -> None:
        self.errors = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "canarm", command, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE if quiet else None,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )

    def end(self) -> str:
        """Ask the process to end, insist when it does not, and return what it printed."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.collect(END_S)

    def collect(self, limit_s: float) -> str:
        """Wait for the process's end; killed after `limit_s`."""
        try:
            printed, errors = self.process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            printed, errors = self.process.communicate()
        except ValueError:
            return ""
        self.errors = (errors or b"").decode(errors="replace")
        return printed.decode(errors="replace")


def _check(cell: Cell, control: ControlOptions, clock: str, seconds: float, truth: Sequence[str]) -> None:
    """Find what is wrong with the command line before any process starts."""
    tick_count(cell, seconds)
    try:
        Truth.from_settings(cell, parse_settings("--truth", truth))
        make_controller(cell, control.law, control.trajectory, control.feedforward, Clock[clock.upper()])
    except (TruthError, ControllerError) as error:
        raise UsageError(str(error)) from None


def _port_of(emulator: _Child) -> int:
    """The port on which the emulator offers its buses, from the line in which it says so."""
    assert emulator.process.stdout is not None
    fd = emulator.process.stdout.fileno()
    deadline, printed = time.monotonic() + START_S, b""
    while (left_s := deadline - time.monotonic()) > 0.0:
        if not select.select([fd], [], [], left_s)[0]:
            break
        data = os.read(fd, 4096)
        printed += data
        found = re.search(rb"^bench .*port=(\d+)$", printed, re.MULTILINE)
        if found:
            return int(found.group(1))
        if not data:
            status = emulator.process.wait(END_S)
            raise BusError(f"the emulator ended with status {status} before it offered its bus")
    raise BusError(f"the emulator did not offer its bus within {START_S:g} s")


def _wait(controller: _Child, seconds: float) -> dict[str, object]:
    """The controller's summary; Ctrl-C is passed on to it as a safe stop."""
    limit_s = STARTUP_ALLOWANCE_S + 3.0 * seconds
    try:
        printed = controller.collect(limit_s)
    except KeyboardInterrupt:
        printed = controller.end()
    lines = printed.strip().splitlines()
    try:
        return dict(json.loads(lines[-1]))
    except (IndexError, ValueError):
        status = controller.process.returncode
        raise BusError(f"the controller ended with status {status} and without a summary") from None


def _show_dashboard(cell: Cell, port: int, controller: _Child) -> None:
    """The dashboard in this process, until the controller has ended or the user leaves it."""
    from canarm_tui.app import run_dashboard

    run_dashboard(
        cell,
        "canarm",
        "bench",
        {"host": "127.0.0.1", "port": port},
        until=lambda: controller.process.poll() is not None,
    )


def _summary(result: dict[str, object], seed: int, folder: str) -> Summary:
    joints = {name: JointFigures(**figures) for name, figures in dict(result["joints"]).items()}  # type: ignore[call-overload]
    return Summary(**{**result, "joints": joints, "seed": seed, "out": folder})  # type: ignore[arg-type]


