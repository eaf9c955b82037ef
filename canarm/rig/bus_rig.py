"""The test rig over real buses: emulator and controller as processes, asked the same questions as `Rig`.

A run cannot be paused, so faults are declared before it. What happened is read from
the run folder afterwards.
"""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from canarm_controller.bus.assessment import JointFigures
from canarm_controller.reference.trajectory import usual_motion
from canarm_controller.run.state import State
from canarm_emulator.robot.truth import Truth
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError, FaultError
from canarm_protocol.faults.bench_client import BenchClient
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript
from canarm_protocol.runs.run_folder import EMULATOR_FILES, SIGNALS_FOLDER
from canarm_protocol.shown import quoted
from canarm_protocol.transport.port import open_port

from ..bus_choice import VIRTUAL_BUSES, BusChoice
from ..child import START_S, Child, ended_too_early, offered_port, running
from ..open_cell import open_cell
from ..session import tick_count
from ..stopping import signals_held_back
from ..summary import Summary
from ..usage import UsageError
from .any_rig import AnyRig
from .arguments import as_text
from .recorded import RecordedHistory, fault_events, noticed, read_events, recorded_joints
from .rig_joint import Joints

HOST, BENCH_BUS = "127.0.0.1", "bench"
ANSWER_S = 60.0
"""How long the bench may take to answer: longer than any slow machine, so that no answer means a dead one."""
SLOWEST = 10.0
"""A run may take this many times its robot time, plus START_S."""
SYNC_TIMEOUT_S = 30.0
"""A busy machine must not look like a lost controller."""


class BusRig(AnyRig):
    """As `canarm.Rig`, in lockstep, with `run` once. `cell`, `law` and `trajectory` must be names or files. `out` must
    name the run folder, which keeps every cycle: `history_s` bounds nothing here.

    Raises `UsageError` for what a command line refuses, and for what a bus does not offer; `BusError` if a
    process does not start or end.
    """

    bus: BusChoice = VIRTUAL_BUSES
    """The buses of its runs; see `over`."""

    _emulator: Child | None = None

    @classmethod
    def over(cls, bus: BusChoice) -> type["BusRig"]:
        """The class of rigs over `bus`."""
        return type(cls.__name__, (cls,), {"bus": bus})

    def _open(self, cell: str | Path | Cell, settings: Mapping[str, object] | None) -> None:
        name, self._law_word = _word("cell", cell), _word("law", self._law)
        if self._out is None:
            raise UsageError("out: over a bus there is always a run folder; name it")
        given = as_text("settings", settings)
        self.cell = open_cell(name, given, option="settings")
        motion = usual_motion(self.cell) if self._trajectory is None else self._trajectory
        self._trajectory_word = _word("trajectory", motion)
        Truth.from_settings(self.cell, self._true_settings, "truth")
        self.folder = self._out.path
        self.reason: str | None = None
        self._result: dict[str, Any] | None = None
        self._is_finished = False
        self._common = ["--cell", name, "--clock", "sync", "--out", str(self.folder), "--json"]
        self._common += [word for key, value in given.items() for word in ("--set", f"{key}={value}")]
        robot = ["--serve", f"{HOST}:0", "--seed", str(self._seed), "--sync-timeout", str(SYNC_TIMEOUT_S)]
        robot += [word for key, value in self._true_settings.items() for word in ("--truth", f"{key}={value}")]
        with contextlib.suppress(OSError):  # the emulator will say what is wrong with it
            self._made.folder(self.folder / SIGNALS_FOLDER)
        for file in EMULATOR_FILES:
            self._made.file(self.folder / file)
        with signals_held_back():
            self._emulator = Child(
                "emulator", [*self._common, *robot, *self.bus.flags, *(["--wire"] * self._wire)], quiet=True
            )
        self._port = offered_port(self._emulator)
        self.joints = self._read({})

    @property
    def state(self) -> State:
        """The controller's state. A run that ended as planned is RUNNING until `finish`, as in `Rig`."""
        if self._result is None:
            return State.DONE if self._is_finished else State.IDLE
        if self._result["state"] != "done":
            return State.FAILED
        return State.DONE if self._is_finished else State.RUNNING

    @property
    def torque_is_off(self) -> bool:
        """Whether truly no amplifier was commanded any current at the end of the run or of the stop."""
        if self._result is None:
            return True
        if self.state is State.FAILED or self._is_finished:
            commands = [joint.span("command_a").value for joint in self.joints.values()]
        else:
            commands = [joint.command_a for joint in self.joints.values()]
        return not any(values[-1] for values in commands if len(values))

    def run(self, seconds: float) -> None:
        """Run once. Returns early if the controller stops the robot; raises `FaultError` as `Rig.run`."""
        __tracebackhide__ = True
        tick_count(self.cell, seconds, "seconds")
        if self._result is not None or self._is_finished:
            raise UsageError("run: over a bus a rig runs once; declare faults before it, with at=, cycle= or when=")
        words = ["--connect", f"{HOST}:{self._port}"] if self.bus.channels is None else self.bus.flags
        words += ["--law", self._law_word, "--trajectory", self._trajectory_word, "--seconds", repr(float(seconds))]
        words += ["--feedforward", self._feedforward] if self._feedforward is not None else []
        with running("controller", [*self._common, *words], quiet=True) as controller:
            if not controller.wait(START_S + SLOWEST * seconds):
                raise BusError(f"the controller has not ended within {START_S + SLOWEST * seconds:g} s")
            self._result = _last_object(controller)
        self._close_files()
        self.reason = self._result["reason"]
        figures = {name: JointFigures(**each) for name, each in self._result["joints"].items()}
        self.joints = self._read(figures)
        events = read_events(self.folder)
        self.fault_events = fault_events(events)
        self.noticed = noticed(events)
        for event in self.fault_events:
            if event.failure:
                raise FaultError(f"{event.tap} {event.fault} {event.failure}")

    @property
    def never_begun(self) -> list[str]:
        """Sets that were injected and not cleared, but never began."""
        begun = {each.set_name for each in self.fault_events if each.is_begin}
        return [name for name in self._awaited if name not in begun]

    def summary(self) -> Summary:
        """The figures of the run. Raises `UsageError` before it."""
        if self._result is None:
            raise UsageError("summary: over a bus there is one after run()")
        joints = {name: JointFigures(**each) for name, each in self._result["joints"].items()}
        return Summary(**{**self._result, "joints": joints, "seed": self._seed, "faults": len(self.begun)})

    def finish(self) -> None:
        """End the processes. May be called again."""
        self._is_finished = True
        self._close_files()

    def _close_files(self) -> None:
        if self._emulator is not None:
            self._emulator.end()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def __getattr__(self, name: str) -> Any:
        if name in ("controller", "change_truth", "frames", "events", "fault_status", "time_s"):
            raise UsageError(f"{name}: not to be had over a bus; such a test runs without --canarm-bus")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {quoted(name)}")

    def _accept(self, script: FaultScript) -> None:
        if self._is_finished:
            raise UsageError("faults: the rig is finished; make a new one")
        if self._result is not None:
            raise UsageError("faults: over a bus they are declared before run(), with at=, cycle= or when=")
        if self.bus.channels is None:
            port = open_port("canarm", BENCH_BUS, host=HOST, port=self._port)
        else:
            port = open_port("socketcan", self.bus.channels[1])
        with port, BenchClient(port, self.cell, ANSWER_S) as client:
            client.inject(as_toml(script))

    def _read(self, figures: Mapping[str, JointFigures]) -> Joints:
        history = RecordedHistory(self.cell, self.folder, figures)
        return recorded_joints(self.cell, history)


def _word(argument: str, value: object) -> str:
    """An argument as a command line spells it."""
    if not isinstance(value, str | Path):
        raise UsageError(f"{argument}: over a bus it must be a name or a file, for the processes to read")
    return str(value)


def _last_object(controller: Child) -> dict[str, Any]:
    try:
        return dict(json.loads(controller.printed.splitlines()[-1]))
    except (IndexError, ValueError):
        text = " ".join(controller.complaints.split()) or f"the controller has ended with status {controller.status}"
        raise ended_too_early(controller, text) from None
