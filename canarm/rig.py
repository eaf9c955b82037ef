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
from canarm_controller.controller import Controller, State
from canarm_controller.recording import ControllerRecorder
from canarm_emulator.assessor import Assessor
from canarm_emulator.bench import CycleTruth
from canarm_emulator.errors import TruthError
from canarm_emulator.recording import Recorder
from canarm_emulator.truth import Truth
from canarm_protocol.cell import Cell
from canarm_protocol.clock import Clock
from canarm_protocol.cell_file import load_cell
from canarm_protocol.frames import Frame
from canarm_protocol.run_folder import create_run_folder, update_run_file
from numpy.typing import NDArray

from .session import DEFAULT_CELL, DEFAULT_LAW, DEFAULT_TRAJECTORY, make_bench, make_controller, provenance, tick_count
from .summary import JointFigures, Summary

Floats = NDArray[np.float64]

FRAMES_KEPT = 10_000
_SIGNALS = ("true_angle_rad", "true_speed_rad_s", "current_a", "command_a", "reference_rad", "measured_rad")
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
    """The last cycles of a run in a ring: one row a cycle, `_SIGNALS` of every joint."""

    rows: Floats
    joints: int

    def column(self, joint: int, signal: str, cycles: int) -> Floats:
        """One signal, oldest first."""
        values = self.rows[:, joint * len(_SIGNALS) + _SIGNALS.index(signal)]
        size = len(values)
        if cycles <= size:
            return values[:cycles].copy()
        return np.roll(values, -(cycles % size))


class RigJoint:
    """Histories (numpy arrays, one value a cycle, oldest first) and figures of one joint."""

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
        """Motor current, signed."""
        return self._rig._column(self._index, "current_a")

    @property
    def command_a(self) -> Floats:
        """What the amplifier was asked for, signed."""
        return self._rig._column(self._index, "command_a")

    @property
    def reference_rad(self) -> Floats:
        """The controller's reference."""
        return self._rig._column(self._index, "reference_rad")

    @property
    def measured_rad(self) -> Floats:
        """The joint angle as the controller measured it."""
        return self._rig._column(self._index, "measured_rad")

    @property
    def rms_error_lsb(self) -> float:
        """RMS of true minus reference angle in steps of the position sensor, first 1024 cycles left out; NaN before that."""
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
        """Standard deviation over mean of the true speed where the reference runs at constant speed; NaN if it never does."""
        return self._rig._assessor.scores[self._index].speed_ripple or math.nan

    def _figure(self, name: str) -> float:
        score = self._rig._assessor.scores[self._index]
        return float(getattr(score, name)) if score.samples else math.nan


class Rig:
    """A cell with its controller, ready to run in virtual time; use it in a `with` statement.

    `cell` is a name, a file or a `Cell`; `law`, `trajectory` and `feedforward` are as on the command line; `truth` and `settings`
    are what `--truth` and `--set` take. `history_s` bounds the histories (older cycles are forgotten). `out` names a run folder.

    Raises `CellError`, `TruthError`, `LawError`, `TrajectoryError` or `ControllerError` for what cannot be.
    """

    def __init__(
        self,
        cell: str | Cell = DEFAULT_CELL,
        law: str = DEFAULT_LAW,
        trajectory: str = DEFAULT_TRAJECTORY,
        *,
        feedforward: str | None = None,
        seed: int = 0,
        truth: Mapping[str, object] | None = None,
        settings: Mapping[str, object] | None = None,
        history_s: float = 60.0,
        out: Path | str | None = None,
    ) -> None:
        as_text = {key: str(value) for key, value in (settings or {}).items()}
        self.cell = cell if isinstance(cell, Cell) else load_cell(cell, as_text)
        self._names = {"law": law, "trajectory": trajectory, "seed": seed}
        self._true_settings = {key: str(value) for key, value in (truth or {}).items()}
        self._bench = make_bench(self.cell, self._true_settings, Clock.SYNC, seed)
        self._controller = make_controller(self.cell, law, trajectory, feedforward, Clock.SYNC)
        self._assessor: Assessor = self._bench.assessor
        size = max(1, round(history_s / self.cell.bus.cycle_s))
        self._history = _History(np.zeros((size, len(_SIGNALS) * len(self.cell.joints))), len(self.cell.joints))
        self._truth: CycleTruth | None = None
        self.events: list[Event] = []
        self.frames: deque[StampedFrame] = deque(maxlen=FRAMES_KEPT)
        """The last frames of can0, oldest first."""
        self.joints = {name: RigJoint(self, index) for index, name in enumerate(self.cell.joint_names)}
        self._state = State.IDLE
        self._folder: Path | None = None
        self._recorders: tuple[Recorder, ControllerRecorder] | None = None
        if out is not None:
            self._record(create_run_folder(Path(out)), seed)
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
    def time_s(self) -> float:
        """Virtual time since the bench was switched on."""
        return self._bench.time_ns * 1e-9

    def run(self, seconds: float) -> None:
        """Let virtual time pass. Returns early when the controller has stopped the robot."""
        controller = self._controller
        if controller.state is State.IDLE:
            controller.begin(0)
        goal = controller.controlled_ticks + tick_count(self.cell, seconds)
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
        self._true_settings[key] = str(value)
        self._bench.world.change(Truth.from_settings(self.cell, self._true_settings))
        self.events.append(Event(self.time_s, "truth", f"{key} = {value}"))

    def finish(self) -> Summary:
        """End the run as planned: torque off, cards stopped, files closed. Returns the summary; may be called again."""
        controller = self._controller
        controller.end()
        while not controller.is_finished and controller.state is not State.IDLE:
            self._exchange()
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
            law=str(self._names["law"]),
            trajectory=str(self._names["trajectory"]),
            feedforward=controller.loop.feedforward_kind,
            clock="sync",
            seed=int(self._names["seed"]),
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

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.finish()

    def _exchange(self) -> None:
        """Carry what the controller sends to the bench and what the bench sends to the controller, once."""
        bench, controller = self._bench, self._controller
        if controller.outbox:
            frames, controller.outbox = controller.outbox, []
            for frame in frames:
                bench.receive(frame, controller)
        elif controller.deadline_ns is not None:
            controller.time_out(controller.deadline_ns)
        records, bench.records = bench.records, []
        bench.bench_records.clear()
        log = self._recorders[0].frame if self._recorders is not None else None
        for record in records:
            if log is not None:
                log(record)
            self.frames.append(StampedFrame(record.time_ns, record.frame))
            if record.origin is None:
                controller.receive(record.frame, record.time_ns)
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
            row += (
                true.angle_rad,
                true.speed_rad_s,
                true.current_a,
                true.command_a,
                reference,
                cycle.position_rad[joint],
            )
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

    def _record(self, folder: Path, seed: int) -> None:
        self._folder = folder
        self._recorders = (Recorder(folder, self.cell), ControllerRecorder(folder, self._controller))
        update_run_file(folder, "cell", self.cell.model_dump(mode="json"))
        update_run_file(folder, "rig", {**provenance(), **self._names, "truth": self._true_settings})
