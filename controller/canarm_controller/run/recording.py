"""A controller's files in a run folder: reference, measurement, command and the law's internals; events."""

from collections.abc import Callable
from itertools import chain
from operator import itemgetter, truediv
from pathlib import Path

from canarm_protocol.clock import Clock
from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.runs.run_folder import EVENTS_FILE, SIGNALS_FOLDER, EventLog, Rotation, SignalLog
from canarm_protocol.runs.unwritten import UNWRITABLE, Unwritten

from ..supervision.detection import Detection
from .controller import Controller
from .state import State

SIGNALS_FILE, MEMORY_FILE = "controller.csv", "memory.bin"
JOINT_COLUMNS = (
    "reference_rad",
    "reference_rad_s",
    "measured_rad",
    "measured_rad_s",
    "measured_a",
    "command_a",
    "feedforward_nm",
)
"""The columns of each joint, before those of the law's internal values."""


class ControllerRecorder:
    """Writes the files of one run; `tick` and `state` are given to the controller and its runner to call.

    `now_ns` is the clock of the times that the controller is handed on the wall clock. `on_failure` is told, once, why
    nothing more is written: the run goes on. `signals` says when their file is parted.
    """

    def __init__(
        self,
        folder: Path,
        controller: Controller,
        on_failure: Callable[[str], None] = lambda text: None,
        now_ns: Callable[[], int] = lambda: 0,
        signals: Rotation | None = None,
    ) -> None:
        self._controller, self._folder, self._now_ns = controller, folder, now_ns
        self._unwritten = Unwritten(folder, on_failure)
        names = controller.cell.joint_names
        kinds = (*JOINT_COLUMNS, *controller.loop.internal_names)
        columns = [f"{name}.{column}" for name in names for column in kinds]
        count = len(names)
        self._by_joint = itemgetter(*(kind * count + joint for joint in range(count) for kind in range(len(kinds))))
        """Puts values that are in the order of kinds into that of the columns."""
        self._signals = SignalLog(folder / SIGNALS_FOLDER / SIGNALS_FILE, columns, signals)
        self._events = EventLog(folder / EVENTS_FILE, "controller")
        self._begun_ns: int | None = None
        self._tell_others = controller.on_detection
        controller.on_detection = self.detection
        self._is_lockstep, self._period_ns = controller.clock is Clock.SYNC, controller.cell.bus.cycle_ns
        if self._is_lockstep:
            self._begin(0)

    @property
    def failure(self) -> str | None:
        """Why the record ends before the run, if it does."""
        return self._unwritten.why

    def tick(self) -> None:
        """Append the tick that has just been controlled. Raises `LawError`."""
        loop = self._controller.loop
        cycle, internals = loop.cycle, loop.internals().values()
        if self._unwritten.why is not None:
            return
        values = (
            *cycle.reference_rad,
            *cycle.reference_rad_s,
            *cycle.position_rad,
            *cycle.velocity_rad_s,
            *cycle.current_a,
            *map(truediv, cycle.applied_nm, loop.arm.torque_per_ampere),
            *cycle.feedforward_nm,
            *chain.from_iterable(internals),
        )
        # In lockstep the record comes after the next SYNC has been opened.
        time_ns = cycle.tick * self._period_ns if self._is_lockstep else self._controller.run_ns
        try:
            self._signals.write(cycle.tick, time_ns, self._by_joint(values))
        except UNWRITABLE as error:
            self._unwritten.note(error)

    def state(self, state: State) -> None:
        """Append a change of state, with its reason when there is one."""
        controller = self._controller
        reason = {} if controller.reason is None else {"reason": controller.reason}
        verdict = {} if controller.verdict is None else {"detector": controller.verdict.detector}
        self._event("state", cycle=controller.tick, state=state.name, **reason, **verdict)
        if state is State.RUNNING:
            with self._unwritten:
                self._write_memory()

    def detection(self, detection: Detection) -> None:
        """Append a detection."""
        at = {} if detection.where is None else {"at": detection.where}
        self._event(
            "detection",
            cycle=detection.tick,
            detector=detection.detector,
            **at,
            detail=detection.detail,
            reaction=detection.reaction.value,
        )
        if self._tell_others is not None:
            self._tell_others(detection)

    def close(self) -> None:
        """Write out what is left, and the memory image: table and log as the Apple II would hold them.

        As far as possible: `failure` says why not.
        """
        for write in (self._begin_events, self._signals.close, self._events.close, self._write_memory):
            with self._unwritten:
                write()

    def _event(self, event: str, **details: object) -> None:
        if self._unwritten.why is None:
            with self._unwritten:
                self._begin_events()
                time_ns = self._now_ns() if self._begun_ns is None else self._begun_ns + self._controller.run_ns
                self._events.write(time_ns, event, **details)

    def _begin_events(self) -> None:
        if self._begun_ns is None and self._controller.begun_ns is not None:
            self._begin(self._controller.begun_ns)

    def _begin(self, time_ns: int) -> None:
        self._begun_ns = time_ns
        self._events.begin(time_ns)

    def _write_memory(self) -> None:
        """The image from $2000 on: the table before a run, with the measurements after it."""
        replace_file(self._folder / MEMORY_FILE, self._controller.loop.memory.dump())
