"""One run of a demo: an emulator and a controller as separate processes, what they say, and the summary at the end.

Each run has a folder and processes of its own. The dashboard, options and their checks belong to the command.
"""

import contextlib
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from canarm_controller.bus.assessment import JointFigures
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import ExitStatus
from canarm_protocol.runs.run_folder import update_run_file
from canarm_protocol.runs.tentative import Tentative

from .child import START_S, Child, ended_too_early, offered_port, running
from .options import BENCH_BUS, ROBOT_BUS, ControlOptions, pace_text, wait_text
from .recording import BENCH, FAILED_RECORDING, PARQUET, Recording, recording_failure
from .serving import attach_flags
from .summary import Summary, after_emergency_stop

SLOWEST = 10.0
"""A run is given up after this many times its robot time, plus START_S."""
PASSED_ON = (ExitStatus.DONE, ExitStatus.WRONG_INPUT)
"""Exit statuses of the controller that are passed on; any other is a failed run."""


@dataclass(frozen=True)
class DemoPlan:
    """What a run is made of, checked: as on the command line, see `canarm demo`."""

    cell: Cell
    cell_name: str
    settings: Sequence[str]
    control: ControlOptions
    feedforward: str
    """What the controller has chosen unless it was given."""
    clock: str
    pace: float | None
    sync_timeout: float
    seconds: float
    seed: int
    truth: Sequence[str]
    wire: bool
    faults: Path | None
    serve: str
    host: str
    recording: Recording
    rotate: float | None


class DemoRun:
    """A run of `plan`, recorded in `folder`; `made` takes back what was made for a run that does not begin."""

    def __init__(self, plan: DemoPlan, folder: Path, made: Tentative, with_dashboard: bool) -> None:
        self.plan, self.folder = plan, folder
        self.port = 0
        """On which the emulator serves its buses."""
        self.cause: str | None = None
        """Why it was interrupted, if it was."""
        self.complaints = ""
        """What the processes have said on stderr, known once it is closed."""
        self._is_closed = self._is_seed_known = False
        self._made, self._with_dashboard = made, with_dashboard
        self._emulator: Child | None = None
        self._controller: Child | None = None
        self._stack = contextlib.ExitStack()
        self._deadline_s = self._limit_s = math.inf

    def start(self, is_another: bool = False) -> None:
        """Start both processes; of another one than the first nothing is told, for a dashboard is on the terminal.

        Raises `BusError` or `UsageError` if one of them does not start.
        """
        plan = self.plan
        common = ["--cell", plan.cell_name, "--clock", plan.clock, "--out", str(self.folder), "--json"]
        common += ["--sync-timeout", wait_text(plan.sync_timeout), *_each("--set", plan.settings)]
        if plan.rotate is not None:
            common += ["--rotate", f"{plan.rotate:.9g}"]
        robot = ["--serve", plan.serve, "--seed", str(plan.seed), *_each("--truth", plan.truth)]
        robot += self._further(BENCH, PARQUET)
        if plan.wire:
            robot.append("--wire")
        if plan.faults is not None:
            robot += ["--faults", str(plan.faults)]
        self._emulator = self._begun("emulator", [*common, *robot])
        with self._made:
            self.port = offered_port(self._emulator)
        if not is_another:
            for bus in (ROBOT_BUS, BENCH_BUS):
                tell(f"to attach to {bus}: {attach_flags(bus, plan.host, self.port)}")
        self._controller = self._begun("controller", [*common, *self._further(PARQUET), *self._controller_arguments()])
        # With no time-out, a debugger may hold it for ever.
        if math.isfinite(plan.sync_timeout):
            self._limit_s = START_S + SLOWEST * plan.seconds / min(plan.pace or 1.0, 1.0)
        self._deadline_s = time.monotonic() + self._limit_s

    def _further(self, *kinds: str) -> list[str]:
        """What a process is to record besides its plain files, of what it can."""
        wanted = [each for each in kinds if each in self.plan.recording.formats]
        return ["--record", ",".join(wanted)] if wanted else []

    @property
    def is_over(self) -> bool:
        """Whether the controller has ended, or has to."""
        return self._controller is None or self._controller.status is not None or self.is_given_up

    @property
    def is_given_up(self) -> bool:
        """Whether time is up and the controller has not ended."""
        return self._controller is not None and self._controller.status is None and time.monotonic() > self._deadline_s

    def outcome(self) -> tuple[str, bool, list[str]] | None:
        """Verdict, whether all went well, and details, once the controller has ended."""
        controller = self._controller
        if controller is None or controller.status is None or not controller.wait(0.0):
            return None
        result = _result(controller)
        if result is None:
            return f"the controller ended with status {controller.status}", False, [str(self.folder)]
        summary = summary_of({**result, "seed": self.plan.seed, "out": str(self.folder)})
        if not self._is_seed_known:
            self._is_seed_known = True
            recording_failure(self.folder, lambda: update_run_file(self.folder, "summary", summary.as_json()))
        verdict, *details = summary.verdict_first()
        return verdict, controller.status == ExitStatus.DONE, details

    def wait(self) -> None:
        """Wait for the end of the controller, or of the time that it has."""
        if self._controller is None or self._controller.wait(max(self._deadline_s - time.monotonic(), 0.0)):
            return
        tell(f"the controller has not ended within {self._limit_s:g} s and is given up")
        self._controller.end()

    def interrupt(self, cause: str) -> None:
        """Stop the robot safely."""
        self.cause = cause
        if self._controller is not None:
            self._controller.end(cause)

    def close(self) -> None:
        """End both processes. May be called again."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._emulator is not None:
            self.complaints = "".join(child.complaints for child in (self._emulator, self._controller) if child)
            if self.cause is None and self._emulator.status is not None:
                self.complaints += f"canarm: the emulator has ended with status {self._emulator.status}\n"
        self._stack.close()

    def report(self, as_json: bool, say: Callable[[str], None]) -> int:
        """Complete the record, say the summary, and return the exit status. Raises `BusError` or `UsageError`."""
        print(self.complaints, end="", file=sys.stderr)
        plan, emulator, controller = self.plan, self._emulator, self._controller
        for name in _of_summary(emulator, "faults_never_begun") or ():
            tell(f"fault never began: {name}")
        known = {"seed": plan.seed, "faults": _of_summary(emulator, "faults"), "out": str(self.folder)}
        if FAILED_RECORDING in f"{self.complaints}{_of_summary(emulator, 'reason')}":
            known["broke_off"] = True
        result, stopped_in = _result(controller), _of_summary(emulator, "emergency_stop_cycle")
        if result is not None and stopped_in is not None and result.get("state") == "failed":
            known["reason"] = after_emergency_stop(stopped_in * plan.cell.bus.cycle_s, result.get("reason"))
        if plan.cell.object is not None:
            known["object"] = _of_summary(emulator, "object")
        if self.cause is not None and result is None:
            known |= {"feedforward": plan.feedforward, "clock": plan.clock, "reason": f"interrupted: {self.cause}"}
            return _report(None, _unbegun(plan.cell, plan.control, known), self.folder, as_json, say)
        status = _report(controller, known, self.folder, as_json, say)
        if plan.recording.at_the_end:
            from .runs.converting import convert_all  # brings half of canarm

            if not convert_all(self.folder, plan.recording.at_the_end, tell):
                return status or ExitStatus.FAILED
        return status

    def _begun(self, command: str, arguments: Sequence[str]) -> Child:
        return self._stack.enter_context(running(command, arguments, quiet=self._with_dashboard))

    def _controller_arguments(self) -> list[str]:
        plan, control = self.plan, self.plan.control
        arguments = ["--connect", f"{plan.host}:{self.port}", "--seconds", str(plan.seconds)]
        arguments += ["--law", control.law, "--trajectory", control.motion(plan.cell)]
        if control.feedforward is not None:
            arguments += ["--feedforward", control.feedforward]
        if plan.pace is not None:
            arguments += ["--pace", pace_text(plan.pace)]
        if not self._with_dashboard:
            arguments.append("--progress")
        return arguments


def _each(option: str, words: Sequence[str]) -> list[str]:
    return [argument for word in words for argument in (option, word)]


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
    summary = summary_of({**(result or {}), **known})
    failure = recording_failure(folder, lambda: update_run_file(folder, "summary", summary.as_json()))
    if failure is not None:
        summary = replace(summary, broke_off=True)
    say(json.dumps(summary.as_json()) if as_json else summary.as_text())
    if failure is not None:
        tell(failure)
    if failure is not None or controller is None:
        return ExitStatus.FAILED
    assert controller.status is not None
    return controller.status if controller.status in PASSED_ON else ExitStatus.FAILED


def summary_of(result: Mapping[str, Any]) -> Summary:
    """The summary that a controller has printed, as a value."""
    joints = {name: JointFigures(**figures) for name, figures in result["joints"].items()}
    return Summary(**{**result, "joints": joints, "detections": tuple(result["detections"])})


def tell(text: str) -> None:
    """A line on stderr."""
    print(f"canarm: {text}", file=sys.stderr, flush=True)
