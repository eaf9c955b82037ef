"""The test rig: emulated bench and controller in one process, in virtual time, without sockets.

The same two objects as in `canarm emulator` and `canarm controller`, joined by a wire that is a list.
"""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from canarm_controller.controller import Controller, State
from canarm_controller.errors import ControllerError
from canarm_controller.recording import ControllerRecorder
from canarm_emulator.assessor import Assessor
from canarm_emulator.bench import CycleTruth, Record
from canarm_emulator.errors import TruthError
from canarm_emulator.recording import Recorder
from canarm_emulator.truth import Truth
from canarm_protocol.cell import Cell
from canarm_protocol.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.frames import Frame
from canarm_protocol.run_folder import create_run_folder, update_run_file

from .session import DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY, make_bench, make_controller, provenance, tick_count
from .summary import JointFigures, Summary
from .usage import UsageError

Floats = NDArray[np.float64]

FRAMES_KEPT = 10_000
_SIGNALS = ("true_angle_rad", "true_speed_rad_s", "current_a", "command_a", "reference_rad", "measured_rad")
_TRUE_SIGNALS = 4
"""The first fields of `canarm_emulator.world.JointState`, in its order."""
_MECHANICS = (".mass", ".viscous", ".coulomb", ".rotor_inertia", ".wire_stiffness")


class Event(NamedTuple):
    """Something that happened: virtual time in s, what, and its details."""

    time_s: float
    event: str
    detail: str


class StampedFrame(NamedTuple):
    """A frame of the robot's bus with its virtual time."""

    time_ns: int
    frame: Frame


@dataclass(frozen=True)
class _History:
    """The last controlled cycles of a run in a ring: one row a cycle, `_SIGNALS` of every joint."""

    rows: Floats

    def column(self, joint: int, signal: str, cycles: int) -> Floats:
        """One signal, oldest first."""
        values = self.rows[:, joint * len(_SIGNALS) + _SIGNALS.index(signal)]
        size = len(values)
        if cycles <= size:
            return values[:cycles].copy()
        return np.roll(values, -(cycles % size))


class RigJoint:
    """Histories and figures of one joint.

    Histories are numpy arrays with one value a controlled cycle, oldest first, all of one length and of the same
    cycles; a stop adds none. They are copies: what was read stays as it was when the run goes on.
    """

    def __init__(self, rig: "Rig", index: int) -> None:
        self._rig, self._index = rig, index

    @property
    def true_angle_rad(self) -> Floats:
        """True joint angle at each SYNC."""
        return self._rig._column(self._index, "true_angle_rad")

    @property
    def true_speed_rad_s(self) -> Floats:
        """True joint speed at each SYNC."""
        return self._rig._column(self._index, "true_speed_rad_s")

    @property
    def current_a(self) -> Floats:
        """Motor current at each SYNC, signed."""
        return self._rig._column(self._index, "current_a")

    @property
    def command_a(self) -> Floats:
        """What the amplifier is asked for from each SYNC on, signed."""
        return self._rig._column(self._index, "command_a")

    @property
    def reference_rad(self) -> Floats:
        """The controller's reference for each SYNC."""
        return self._rig._column(self._index, "reference_rad")

    @property
    def measured_rad(self) -> Floats:
        """The joint angle as the controller measured it in each cycle; the last one where a measurement was missing."""
        return self._rig._column(self._index, "measured_rad")

    @property
    def rms_error_lsb(self) -> float:
        """RMS of true minus reference angle in steps of the position sensor, first 1024 cycles left out; NaN before."""
        return self._figure("rms_lsb")

    @property
    def max_error_lsb(self) -> float:
        """Greatest true minus reference angle, as `rms_error_lsb`."""
        return self._figure("max_lsb")

    @property
    def peak_current_a(self) -> float:
        """Greatest motor current of the run, A."""
        return self._rig._assessor.scores[self._index].peak_current_a

    @property
    def saturated_cycles(self) -> int:
        """Cycles in which the amplifier was at its limit."""
        return self._rig._assessor.scores[self._index].saturated_cycles

    @property
    def speed_ripple(self) -> float:
        """Standard deviation over mean of the true speed while the reference's is constant; NaN if it never is."""
        return self._rig._assessor.scores[self._index].speed_ripple or math.nan

    def _figure(self, name: str) -> float:
        score = self._rig._assessor.scores[self._index]
        return float(getattr(score, name)) if score.samples else math.nan


class Rig:
    """A cell with its controller, ready to run in virtual time; use it in a `with` statement.

    `cell` is a name, a file or a `Cell`; `law`, `trajectory` and `feedforward` are as on the command line; `truth` and
    `settings` are what `--truth` and `--set` take, `wire` is `--wire`. `history_s` bounds the histories (older cycles
    are forgotten). `out`
    names a run folder.

    Raises `CellError`, `TruthError`, `ControllerError` (`LawError`, `TrajectoryError`), `RunFolderError` or
    `UsageError` (a `ValueError`) for what cannot be. What goes wrong on the robot raises nothing: it ends in a safe
    stop, with `reason`.
    """

    def __init__(
        self,
        cell: str | Path | Cell = DEFAULT_CELL,
        law: str = DEFAULT_LAW,
        trajectory: str = DEFAULT_TRAJECTORY,
        *,
        feedforward: str | None = None,
        seed: int = 0,
        wire: bool = False,
        truth: Mapping[str, object] | None = None,
        settings: Mapping[str, object] | None = None,
        history_s: float = 60.0,
        out: Path | str | None = None,
    ) -> None:
        if isinstance(cell, Cell) and settings:
            raise UsageError("settings: go with the name or file of a cell; lay them over this one with load_cell()")
        if seed < 0:
            raise UsageError(f"seed {seed}: must not be negative")
        as_text = {key: str(value) for key, value in (settings or {}).items()}
        self.cell = cell if isinstance(cell, Cell) else load_cell(str(cell), as_text)
        self._law, self._trajectory, self._seed = law, trajectory, seed
        self._true_settings = {key: _truth_text(value) for key, value in (truth or {}).items()}
        self._bench = make_bench(self.cell, self._true_settings, Clock.SYNC, seed, wire)
        self._controller = make_controller(self.cell, law, trajectory, feedforward, Clock.SYNC)
        self._assessor: Assessor = self._bench.assessor
        size = tick_count(self.cell, history_s, "history_s")
        self._history = _History(np.zeros((size, len(_SIGNALS) * len(self.cell.joints))))
        self._truth: CycleTruth | None = None
        self.events: list[Event] = []
        """Changes of the controller's state, with the reason of a stop, and of the truth; oldest first."""
        self._records: deque[Record] = deque(maxlen=FRAMES_KEPT)
        self.joints = {name: RigJoint(self, index) for index, name in enumerate(self.cell.joint_names)}
        self._state = State.IDLE
        self._folder: Path | None = None
        self._recorders: tuple[Recorder, ControllerRecorder] | None = None
        if out is not None:
            self._record(create_run_folder(Path(out)))
        self._bench.on_cycle = self._keep_truth
        self._controller.on_tick = self._on_tick
        self._bench.start()
        self._exchange()

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
        """Why the run was stopped, if it was."""
        return self._controller.reason

    @property
    def frames(self) -> list[StampedFrame]:
        """The last `FRAMES_KEPT` frames of can0, oldest first."""
        return [StampedFrame(record.time_ns, record.frame) for record in self._records]

    @property
    def time_s(self) -> float:
        """Virtual time since the bench was switched on."""
        return self._bench.time_ns * 1e-9

    def run(self, seconds: float) -> None:
        """Let virtual time pass. Returns early when the controller has stopped the robot, at once if it had before.

        Raises `UsageError` for less than a cycle, `EmulatorError` when the integration of the true robot diverges.
        """
        controller = self._controller
        goal = controller.controlled_ticks + tick_count(self.cell, seconds, "seconds")
        if controller.state is State.IDLE:
            controller.begin(0)
        while controller.controlled_ticks < goal and not controller.is_finished:
            self._exchange()
        if controller.is_finished:
            self._exchange()
        self._note_state()

    def change_truth(self, key: str, value: object) -> None:
        """Change the mechanics of the true robot from now on: `joint3.mass`, `joint2.viscous`, `joint2.coulomb`, …

        Raises `TruthError` for a key that is none, a value that cannot be, or a key that is not mechanics.
        """
        if not key.endswith(_MECHANICS):
            raise TruthError(f"{key}: cannot change during a run; these can: {', '.join(_MECHANICS)} of a joint")
        settings = {**self._true_settings, key: _truth_text(value)}
        self._bench.world.change(Truth.from_settings(self.cell, settings))
        self._true_settings = settings
        self.events.append(Event(self.time_s, "truth", f"{key} = {settings[key]}"))
        if self._recorders is not None:
            self._recorders[0].event(self._bench.time_ns, "truth", key=key, value=settings[key])

    def finish(self) -> Summary:
        """End the run as planned: torque off, cards stopped, files closed. Returns the summary; may be called again."""
        controller = self._controller
        controller.end()
        while not controller.is_finished:
            self._exchange()
        self._exchange()
        self._bench.settle()
        self._exchange()
        self._note_state()
        summary = self.summary()
        if self._recorders is not None and self._folder is not None:
            for recorder in self._recorders:
                recorder.close()
            self._recorders = None
            update_run_file(self._folder, "summary", summary.as_json())
        return summary

    def summary(self) -> Summary:
        """The figures so far."""
        controller = self._controller
        return Summary(
            cell=self.cell.name,
            law=self._law,
            trajectory=self._trajectory,
            feedforward=controller.loop.feedforward_kind,
            clock="sync",
            seed=self._seed,
            state=controller.state.name.lower(),
            reason=controller.reason,
            ticks=controller.controlled_ticks,
            missed=controller.missed,
            late=0,
            real_time_factor=None,
            joints={
                name: JointFigures(
                    rms_lsb=None if math.isnan(joint.rms_error_lsb) else joint.rms_error_lsb,
                    max_lsb=None if math.isnan(joint.max_error_lsb) else joint.max_error_lsb,
                    peak_current_a=joint.peak_current_a,
                    saturated_cycles=joint.saturated_cycles,
                    speed_ripple=None if math.isnan(joint.speed_ripple) else joint.speed_ripple,
                )
                for name, joint in self.joints.items()
            },
            out=None if self._folder is None else str(self._folder),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.finish()

    def _exchange(self) -> None:
        """Carry what the controller sends to the bench and what the bench sends to the controller, once.

        What breaks off in the middle (Ctrl-C, an integration that diverges) cannot go on: the run has failed.
        """
        try:
            self._carry()
        except BaseException as error:
            text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")
            self._controller.lose(ControllerError(f"the run was broken off: {text}"))
            raise

    def _carry(self) -> None:
        bench, controller = self._bench, self._controller
        if controller.outbox:
            frames, controller.outbox = controller.outbox, []
            for frame in frames:
                bench.receive(frame, controller)
        elif controller.deadline_ns is not None:
            controller.time_out(controller.deadline_ns)
        records, bench.records = bench.records, []
        bench.bench_records.clear()
        self._records += records
        if self._recorders is not None:
            log = self._recorders[0].frame
            for record in records:
                log(record)
        receive = controller.receive
        for time_ns, frame, origin in records:
            if origin is None:
                receive(frame, time_ns)
        if controller.state is not self._state:
            self._note_state()

    def _keep_truth(self, truth: CycleTruth) -> None:
        self._truth = truth
        if self._recorders is not None:
            self._recorders[0].cycle(truth)

    def _on_tick(self) -> None:
        cycle, truth = self._controller.loop.cycle, self._truth
        assert truth is not None
        row: list[float] = []
        for joint, true in enumerate(truth.joints):
            reference = cycle.reference_rad[joint]
            row += (*true[:_TRUE_SIGNALS], reference, cycle.position_rad[joint])
            self._assessor.reference(cycle.tick, joint, reference)
        rows = self._history.rows
        rows[(self._controller.controlled_ticks - 1) % len(rows)] = row
        if self._recorders is not None:
            self._recorders[1].tick()

    def _column(self, joint: int, signal: str) -> Floats:
        return self._history.column(joint, signal, self._controller.controlled_ticks)

    def _note_state(self) -> None:
        controller = self._controller
        if controller.state is not self._state:
            self._state = controller.state
            self.events.append(Event(self.time_s, f"state {self._state.name}", controller.reason or ""))
            if self._recorders is not None:
                self._recorders[1].state(self._state)

    def _record(self, folder: Path) -> None:
        self._folder = folder
        self._recorders = (Recorder(folder, self.cell), ControllerRecorder(folder, self._controller))
        update_run_file(folder, "cell", self.cell.model_dump(mode="json"))
        names = {"law": self._law, "trajectory": self._trajectory, "seed": self._seed}
        update_run_file(folder, "rig", {**provenance(), **names, "truth": self._true_settings})


def _truth_text(value: object) -> str:
    """A value as `--truth` takes it; a switch is 0 or 1 there."""
    return str(int(value) if isinstance(value, bool) else value)
