"""The test rig: emulated bench and controller in one process, in virtual time, without sockets.

The same two objects as in `canarm emulator` and `canarm controller`, joined by a list of frames.
"""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType

from canarm_controller.errors import ControllerError
from canarm_controller.laws.loading import law_name
from canarm_controller.reference.trajectory import trajectory_name, usual_motion
from canarm_controller.run.controller import Controller
from canarm_controller.run.recording import ControllerRecorder
from canarm_controller.run.state import State
from canarm_emulator.bench.bench import CycleTruth
from canarm_emulator.bench_node.assessor import Assessor
from canarm_emulator.faults.turns import SetStatus
from canarm_emulator.robot.carried import GRIP_LOST
from canarm_emulator.robot.truth import Truth
from canarm_emulator.serving.recording import Recorder
from canarm_protocol.canopen.frames import ERROR_FLAG
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_events import FaultEvent, event_details, event_name
from canarm_protocol.faults.script import FaultScript
from canarm_protocol.runs.run_folder import (
    CONTROLLER_FILES,
    EMULATOR_FILES,
    SUMMARY,
    create_run_folder,
    update_run_file,
)
from canarm_protocol.shown import named_error

from ..provenance import provenance
from ..recording import recording_failure
from ..session import make_bench, make_controller, tick_count
from ..summary import Summary, detections_as_plain
from ..usage import UsageError, value_text
from .any_rig import AnyRig
from .arguments import RigWarning, Unused, check_mechanics
from .branching import Branching
from .findings import Noticed
from .kept_frames import KeptFrames, StampedFrame
from .rig_cell import rig_cell
from .rig_faults import overdue
from .rig_history import Event, history_of
from .rig_joint import TRUE_SIGNALS, Joints, RigJoint
from .rig_object import Carrying, RigObject
from .turns import Turns

FRAMES_KEPT = 10_000
_STOPPING = State.STOPPING  # looking it up is slow


class Rig(Branching, Carrying, AnyRig):
    """A cell with its controller, ready to run in virtual time; use it in a `with` statement.

    `cell` is a name, a file or a `Cell`. `law`, `trajectory` and `feedforward` are as on the command line; `law` may be
    a class or a function of the `Cycle` too (`load_law`), `trajectory` a DataFrame, a dict of columns, an array
    (n, joints) in rad with a row per cycle, or a function of the time in s (`make_trajectory`). `truth` and `settings`
    are what `--truth` and `--set` take, `wire` is `--wire`, `faults` is a fault file, its text or a script
    (`inject_file`). `history_s` bounds the histories: older cycles are forgotten, and a question about them raises
    `UsageError`. `out` names a run folder. A rig that is finished, or
    discarded, without having run warns (`RigWarning`).

    Raises `CellError`, `TruthError`, `ControllerError` (`LawError`, `TrajectoryError`), `FaultError`, `RunFolderError`
    or `UsageError` (a `ValueError`) for bad arguments, and warns of a cell whose traffic its bit rate cannot carry.
    What goes wrong on the robot raises nothing: it ends in a safe stop, with `reason`.
    """

    _recorders: tuple[Recorder, ControllerRecorder] | None = None

    def _open(self, cell: str | Path | Cell, settings: Mapping[str, object] | None) -> None:
        self.cell = rig_cell(cell, settings)
        if self._trajectory is None:
            self._trajectory = usual_motion(self.cell)
        self._bench = make_bench(self.cell, self._true_settings, Clock.SYNC, self._seed, self._wire, "truth")
        self._controller = make_controller(self.cell, self._law, self._trajectory, self._feedforward, Clock.SYNC)
        self._assessor: Assessor = self._bench.assessor
        self._detections = self._controller.detections
        size = tick_count(self.cell, self._history_s, "history_s")
        controller = self._controller
        self._history = history_of(self.cell, size, self._assessor, lambda: controller.controlled_ticks)
        self._truth: CycleTruth | None = None
        self.events: list[Event] = []
        """Changes of the controller's state (with the reason of a stop) and of the truth; beginnings and ends of
        faults, and detections; oldest first.
        """
        self.never_begun: list[str] | None = None
        """After `finish`: sets that were injected and not cleared, but never began."""
        self._faulty: FaultError | None = None
        self._is_finished = False
        self._depth = 2
        self._frames = KeptFrames(FRAMES_KEPT)
        self.joints = Joints(
            (name, RigJoint(self._history, index, name, score.lsb_rad))
            for index, (name, score) in enumerate(zip(self.cell.joint_names, self._assessor.scores, strict=True))
        )
        carried = self.cell.object
        self._object = None if carried is None else RigObject(carried, size)
        self._state = State.IDLE
        self._folder: Path | None = None
        if self._out is not None:
            with self._out.named():
                self._record(self._out.path)
        self._bench.on_cycle = self._keep_truth
        self._bench.on_script = self._note_script
        self._bench.device.faults.on_event = self._note_fault
        self._controller.on_tick = self._on_tick
        self._turns = Turns()
        self._bench.start()
        self._exchange()
        self.unused = Unused(self)

    @property
    def controller(self) -> Controller:
        """The controller under test."""
        return self._controller

    @property
    def state(self) -> State:
        """The controller's state."""
        return self._controller.state

    @property
    def reason(self) -> str | None:
        """The reason if the run was stopped."""
        return self._controller.reason

    @property
    def approach_s(self) -> float:
        """Time from cycle 0 to the beginning of the trajectory: homing, and the move to the first pose of a file.

        While joints are being homed it is not known yet; then it is the time of their present move.
        """
        return self._controller.loop.trajectory.approach_s

    @property
    def frames(self) -> list[StampedFrame]:
        """The last `FRAMES_KEPT` frames of can0, oldest first."""
        return self._frames.stamped()

    @property
    def time_s(self) -> float:
        """Virtual time since the bench was switched on."""
        return self._bench.time_ns * 1e-9

    @property
    def fault_status(self) -> list[SetStatus]:
        """Every set that was injected and not cleared: name, state, number of activations."""
        return self._bench.faults.status()

    @property
    def torque_is_off(self) -> bool:
        """Whether truly no amplifier is commanded any current at this moment."""
        return not any(joint.command_a for joint in self._bench.world.state())

    def run(self, seconds: float) -> None:
        """Let virtual time pass. Returns early when the controller has stopped the robot; at once if it was stopped
        before.

        Raises `UsageError` for less than a cycle and after `finish`, `EmulatorError` when the integration of the true
        robot diverges, and `FaultError` if a fault fails because of its own mistake: it has then ended, and the
        run may go on. Ctrl-C in a law's code is raised after the safe stop.
        """
        __tracebackhide__ = True
        self._check_unfinished("run")
        goal = self._controller.controlled_ticks + tick_count(self.cell, seconds, "seconds")
        with self._turns.take("run"):
            self._used()
            self._run_to(goal)

    def _run_to(self, goal: int) -> None:
        __tracebackhide__ = True
        controller = self._controller
        if controller.state is State.IDLE:
            controller.begin(0)
        while not controller.is_finished and (
            controller.interruption is not None or (controller.controlled_ticks < goal and self._faulty is None)
        ):
            self._exchange()
        if controller.is_finished:
            self._exchange()
        self._note_state()
        interruption, controller.interruption = controller.interruption, None
        faulty, self._faulty = self._faulty, None
        if (error := interruption or faulty) is not None:
            raise error

    def change_truth(self, key: str, value: object) -> None:
        """Change the mechanics of the true robot from now on: `joint3.mass`, `joint2.viscous`, `joint2.coulomb`, …

        Raises `TruthError` for an unknown key, an impossible value, or a key that is not mechanics, and
        `UsageError` after `finish`.
        """
        __tracebackhide__ = True
        self._check_unfinished("change_truth")
        check_mechanics(self.cell, key)
        settings = {**self._true_settings, key: value_text(value)}
        self._bench.change_truth(Truth.from_settings(self.cell, settings, "change_truth"))
        self._true_settings = settings
        self.events.append(Event(self.time_s, "truth", f"{key} = {settings[key]}"))
        if self._recorders is not None:
            self._recorders[0].event(self._bench.time_ns, "truth", key=key, value=settings[key])

    def finish(self) -> Summary:
        """End the run as planned: torque off, cards stopped, files closed. Returns the summary; may be called again.

        `events` reports sets that never began. Afterwards the rig answers questions and refuses everything else.
        """
        self._turns.check("finish")
        self._used()
        controller = self._controller
        if not self._is_finished and controller.state is State.IDLE:
            warnings.warn("the rig is finished and has never run: it has tested nothing", RigWarning, self._depth)
        self._is_finished = True
        self._note_never_begun()
        controller.end()
        while not controller.is_finished:
            self._exchange()
        self._exchange()
        self._bench.settle()
        self._exchange()
        self._note_state()
        summary = self.summary()
        if self._recorders is not None and self._folder is not None:
            recorders, self._recorders = self._recorders, None
            for recorder in recorders:
                recorder.close()
            summary = replace(summary, broke_off=any(recorder.failure for recorder in recorders))
            write = partial(update_run_file, self._folder, SUMMARY, summary.as_json())
            if failure := recording_failure(self._folder, write):
                self._warn_unwritten(failure)
                summary = replace(summary, broke_off=True)
        return summary

    def summary(self) -> Summary:
        """The figures so far."""
        controller = self._controller
        return Summary(
            cell=self.cell.name,
            law=law_name(self._law),
            trajectory=trajectory_name(self._trajectory),
            feedforward=controller.loop.feedforward_kind,
            clock="sync",
            seed=self._seed,
            state=controller.state.name.lower(),
            reason=controller.reason,
            ticks=controller.controlled_ticks,
            missed=controller.missed,
            late=0,
            real_time_factor=None,
            approach_s=self.approach_s,
            joints={name: self._history.figures(index) for index, name in enumerate(self.joints)},
            out=None if self._out is None else str(self._out.given),
            faults=len(self.begun),
            detections=detections_as_plain(self.detections),
            object=self._bench.world.object_summary(),
        )

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._is_finished = True  # the error matters more than a warning
        self._depth = 3
        self.finish()

    def _exchange(self) -> None:
        """Carry what the controller sends to the bench and what the bench sends to the controller, once.

        After an interruption (Ctrl-C, a diverging integration) it cannot go on: the run has failed.
        """
        try:
            bench, controller = self._bench, self._controller
            if controller.outbox:
                frames, controller.outbox = controller.outbox, []
                for frame in frames:
                    bench.receive(frame, controller)
            elif controller.deadline_ns is not None:
                controller.time_out(controller.deadline_ns)
            bus = bench.bus
            records, bus.records = bus.records, []
            bench.node.records.clear()
            self._frames.take(records)
            if self._recorders is not None:
                self._recorders[0].frames(records)
            receive = controller.receive
            for time_ns, frame, origin in records:
                # As between the two processes: everybody hears all others, and error frames are no data.
                if origin is None or (origin is not controller and frame.can_id < ERROR_FLAG):
                    receive(frame, time_ns)
            if len(self._detections) > len(self.noticed):
                self._note_detections()
            if controller.state is not self._state:
                self._note_state()
        except BaseException as error:
            text = named_error(error)
            self._controller.lose(ControllerError(f"the run was broken off: {text}"))
            raise

    def _keep_truth(self, truth: CycleTruth) -> None:
        if self._controller.state >= _STOPPING:
            self._history.stopping(self._truth, truth)
        self._truth = truth
        if self._object is not None and truth.object is not None:
            for hand in self._object.keep(truth.time_ns * 1e-9, truth.object):
                self.events.append(Event(truth.time_ns * 1e-9, GRIP_LOST, hand))
        if self._recorders is not None:
            self._recorders[0].cycle(truth)

    def _on_tick(self) -> None:
        controller, truth = self._controller, self._truth
        assert truth is not None
        cycle = controller.loop.cycle
        tick, references_rad, measured_rad = cycle.tick, cycle.reference_rad, cycle.position_rad
        row = [truth.time_ns * 1e-9]
        for true, reference_rad, angle_rad in zip(truth.joints, references_rad, measured_rad, strict=True):
            row += true[:TRUE_SIGNALS]
            row.append(reference_rad)
            row.append(angle_rad)
        self._assessor.references(tick, references_rad)
        self._history.tick(controller.controlled_ticks - 1, row)
        if self._recorders is not None:
            self._recorders[1].tick()

    def _check_unfinished(self, call: str) -> None:
        __tracebackhide__ = True
        if self._is_finished:
            raise UsageError(f"{call}: the rig is finished; make a new one")

    def _accept(self, script: FaultScript) -> None:
        self._check_unfinished("faults")
        if self._controller.is_finished and script.clear is None:
            why = f": {self.reason}" if self.reason else ""
            raise FaultError(f"no fault can begin any more: the run has ended at {self.time_s:.4f} s{why}")
        for late in self._bench.faults.overdue(script):
            raise overdue(late, self._bench.faults.run_time_s or 0.0, self._bench.cycle)
        self._bench.inject(script)

    def _note_never_begun(self) -> None:
        if self.never_begun is None:
            waiting = {each.name for each in self.fault_status if not each.activations} if self._names else set()
            self.never_begun = [name for name in self._awaited if name in waiting]
            self.events += [Event(self.time_s, "fault never began", name) for name in self.never_begun]

    def _note_fault(self, event: FaultEvent) -> None:
        self.fault_events.append(event)
        what = "fault begins" if event.is_begin else "fault ends"
        failure = f": {event.failure}" if event.failure else ""
        self.events.append(Event(event.time_s, what, f"{event.label}{failure}"))
        if event.failure:
            self._faulty = FaultError(f"{event.label} {event.failure}")
        if self._recorders is not None:
            self._recorders[0].event(event.time_ns, event_name(event), **event_details(event))

    def _note_script(self, script: FaultScript) -> None:
        if self._recorders is not None:
            self._recorders[0].script(self._bench.time_ns, script)

    def _note_detections(self) -> None:
        for detection in self._controller.detections[len(self.noticed) :]:
            truth = self._truth
            is_now = truth is not None and truth.cycle == detection.tick
            time_ns = truth.time_ns if truth is not None and is_now else detection.tick * self.cell.bus.cycle_ns
            self.noticed.append(Noticed(time_ns * 1e-9, detection))
            self.events.append(Event(time_ns * 1e-9, f"detected {detection.detector}", detection.detail))

    def _note_state(self) -> None:
        controller = self._controller
        if controller.state is not self._state:
            self._state = controller.state
            self.events.append(Event(self.time_s, f"state {self._state.name}", controller.reason or ""))
            if self._recorders is not None:
                self._recorders[1].state(self._state)

    def _close_files(self) -> None:
        recorders, self._recorders = self._recorders, None
        for recorder in recorders or ():
            recorder.close()

    def _record(self, folder: Path) -> None:
        self._folder = create_run_folder(folder, made=self._made)
        for name in (*EMULATOR_FILES, *CONTROLLER_FILES):
            self._made.file(folder / name)
        self._recorders = (
            Recorder(folder, self.cell, self._warn_unwritten),
            ControllerRecorder(folder, self._controller, self._warn_unwritten),
        )
        self._controller.on_detection = self._recorders[1].detection
        update_run_file(folder, "cell", self.cell.model_dump(mode="json"))
        names = {"law": law_name(self._law), "trajectory": trajectory_name(self._trajectory), "seed": self._seed}
        update_run_file(folder, "rig", {**provenance(), **names, "truth": self._true_settings, "wire": self._wire})
