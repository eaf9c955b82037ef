"""A controller's files in a run folder: reference, measurement, command and the law's internals; events."""

import contextlib
from pathlib import Path

from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.runs.run_folder import EVENTS_FILE, SIGNALS_FOLDER, EventLog, SignalLog

from ..supervision.detection import Detection
from .controller import Controller
from .state import State

SIGNALS_FILE, MEMORY_FILE = "controller.csv", "memory.bin"
_COLUMNS = (
    "reference_rad",
    "reference_rad_s",
    "measured_rad",
    "measured_rad_s",
    "measured_a",
    "command_a",
    "feedforward_nm",
)


class ControllerRecorder:
    """Writes the files of one run; `tick` and `state` are given to the controller and its runner to call."""

    def __init__(self, folder: Path, controller: Controller) -> None:
        self._controller, self._folder = controller, folder
        names = controller.cell.joint_names
        columns = [f"{name}.{column}" for name in names for column in (*_COLUMNS, *controller.loop.internal_names)]
        self._signals = SignalLog(folder / SIGNALS_FOLDER / SIGNALS_FILE, columns)
        self._events = EventLog(folder / EVENTS_FILE, "controller")
        self._joints = range(len(names))
        self._period_ns = controller.cell.bus.cycle_ns
        self._tell_others = controller.on_detection
        controller.on_detection = self.detection

    def tick(self) -> None:
        """Append the tick that has just been controlled. Raises `LawError`; `OSError` when it cannot be written."""
        loop = self._controller.loop
        cycle, internals = loop.cycle, list(loop.internals().values())
        values: list[float] = []
        for joint in self._joints:
            values += (
                cycle.reference_rad[joint],
                cycle.reference_rad_s[joint],
                cycle.position_rad[joint],
                cycle.velocity_rad_s[joint],
                cycle.current_a[joint],
                cycle.applied_nm[joint] / loop.arm.torque_per_ampere[joint],
                cycle.feedforward_nm[joint],
                *[values_of[joint] for values_of in internals],
            )
        self._signals.write(cycle.tick, cycle.tick * self._period_ns, values)

    def state(self, state: State) -> None:
        """Append a change of state, with its reason when there is one. Its time counts from cycle 0."""
        controller = self._controller
        reason = {} if controller.reason is None else {"reason": controller.reason}
        verdict = {} if controller.verdict is None else {"detector": controller.verdict.detector}
        cycle = max(controller.tick, 0)
        self._events.write(cycle * self._period_ns, "state", cycle=cycle, state=state.name, **reason, **verdict)
        if state is State.RUNNING:
            self._write_memory()

    def detection(self, detection: Detection) -> None:
        """Append a detection."""
        at = {} if detection.where is None else {"at": detection.where}
        self._events.write(
            detection.tick * self._period_ns,
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

        Raises `OSError` once all that can be written is.
        """
        with contextlib.ExitStack() as stack:  # close all files even if one cannot be written
            stack.callback(self._write_memory)
            stack.callback(self._events.close)
            stack.callback(self._signals.close)

    def _write_memory(self) -> None:
        """The image from $2000 on: the table before a run, with the measurements after it."""
        replace_file(self._folder / MEMORY_FILE, self._controller.loop.memory.dump())
