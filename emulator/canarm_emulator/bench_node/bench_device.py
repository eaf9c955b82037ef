"""The bench node's data: truth, assessment, figures of the buses, faults, what the controller reports and detects, and
the run as a whole.

Passes on what clients write; faults and the ownership of channels are handled elsewhere.
"""

from collections.abc import Callable, Sequence

from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.model import Cell

from ..node.io_device import Getter, ReadObject, Refusal, Setter
from ..robot.world import JointState
from .assessor import Assessor
from .bus_figures import BusFigures
from .detection_objects import DetectionObjects
from .fault_objects import FaultObjects
from .run_objects import RunObjects
from .sdo_channels import SdoChannels


class BenchDevice:
    """State of the run as the bench node shows it. The bench fills `cycle` and `truth` at every SYNC.

    `set_emergency_stop` opens the supply of the amplifiers, or closes it again; `power_cycle` switches all of the robot
    off and on again.
    """

    def __init__(
        self,
        cell: Cell,
        assessor: Assessor,
        buses: BusFigures,
        faults: FaultObjects,
        detections: DetectionObjects,
        set_emergency_stop: Callable[[bool], None],
        power_cycle: Callable[[], None],
    ) -> None:
        count = len(cell.joints)
        self.assessor = assessor
        self.buses = buses
        self.faults = faults
        self.detections = detections
        self.run = RunObjects()
        self.channels = SdoChannels(cell.bus.bench_node_id)
        self.is_stopped = False
        """Whether the emergency stop is on."""
        self.on_emergency_stop: Callable[[bool], None] | None = None
        """Called at every change."""
        self.on_power_cycle: Callable[[], None] | None = None
        """Called after each."""
        self.refused_directions: Callable[[], Sequence[int]] = tuple
        """Whoever has the drives says so here: for each joint, how often its bridge was asked for both directions."""
        self._set_emergency_stop, self._power_cycle = set_emergency_stop, power_cycle
        self.cycle = 0
        self.truth: list[JointState] = []
        self.tick = 0
        self.report: dict[tuple[int, int], float] = {
            (index, joint): 0.0
            for index in (
                objects.REFERENCE,
                objects.MEASURED_ANGLE,
                objects.MEASURED_SPEED,
                objects.CURRENT_COMMAND,
                objects.FEED_FORWARD,
                *(objects.INTERNAL + k for k in range(objects.INTERNALS)),
            )
            for joint in range(1, count + 1)
        }
        self.report[objects.LATE, 0] = self.report[objects.CONTROLLER_STATE, 0] = 0

    def setter(self, index: int, subindex: int) -> Setter | None:
        """Objects of the controller's report, faults, emergency stop, channels.

        A reference is assessed with the tick written just before it.
        """
        if index == objects.TICK:
            return self._set_tick
        if index == objects.FAULT_SET:
            return lambda data: self.faults.write(data, self.channels.current)
        if index == objects.DETECTION_PIECE:
            return self.detections.take
        if index == objects.EMERGENCY_STOP:
            return self._stop
        if index == objects.POWER_CYCLE:
            return self._off_and_on
        if index == objects.CHANNEL_OWNER:
            return lambda token: self._claim(subindex, token)
        if index == objects.OUTCOME:
            return self.run.set_outcome
        if index == objects.RECORDING:
            return lambda value: self.run.record(bool(value))
        if index == objects.CONTROLLER_STATE:
            return self._set_state
        if (index, subindex) not in self.report:
            return None
        report, key = self.report, (index, subindex)
        if index == objects.REFERENCE:
            assessor, joint = self.assessor, subindex - 1

            def assess(value: float) -> None:
                report[key] = value
                assessor.reference(self.tick, joint, value)

            return assess

        def store(value: float) -> None:
            report[key] = value

        return store

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """What cannot be done, its setter refuses."""
        return None

    def getter(self, index: int, subindex: int) -> Getter | None:
        """Truth, assessment, figures of the buses, faults, detections, or what the controller reported last."""
        if (index, subindex) in self.report:
            return lambda: self.report[index, subindex]
        if index == objects.POWER_CYCLE:
            return lambda: 0
        if index == objects.CYCLE:
            return lambda: self.cycle
        if index == objects.TICK:
            return lambda: self.tick
        if index in _EVENTS:
            return lambda: _EVENTS[index](self)
        if index == objects.CHANNEL_OWNER and subindex:
            return lambda: self.channels.owner(subindex)
        if index == objects.ASSESSED_CYCLES:
            return lambda: min(score.samples for score in self.assessor.scores)
        figure = self.buses.getter(index, subindex)
        if figure is not None:
            return figure
        joint = subindex - 1
        if not 0 <= joint < len(self.truth):
            return None
        if index == objects.REFUSED_DIRECTIONS:
            return lambda: self.refused_directions()[joint]
        truth = _TRUTH.get(index)
        if truth is not None:
            return lambda: truth(self.truth[joint])
        field = _SCORES.get(index)
        return (lambda: getattr(self.assessor.scores[joint], field)) if field else None

    def refresh(self, index: int, subindex: int) -> None:
        """Everything here is kept up to date."""

    def configure(self, read: ReadObject) -> None:
        """There are no parameters."""

    def power_off(self) -> None:
        """Nothing that this node does moves the robot."""

    def take_error_values(self, read: ReadObject) -> None:
        """Nothing that this node does moves the robot."""

    def _set_tick(self, value: float) -> None:
        self.tick = int(value)

    def _set_state(self, value: float) -> None:
        self.report[objects.CONTROLLER_STATE, 0] = value
        if objects.CONTROLLER_STATES.get(int(value)) not in objects.ENDED:
            self.run.forget_outcome()

    def _stop(self, value: int) -> None:
        is_on = bool(value)
        if is_on is not self.is_stopped:
            self.is_stopped = is_on
            self.faults.note_stop(is_on)
            self._set_emergency_stop(is_on)
            if self.on_emergency_stop is not None:
                self.on_emergency_stop(is_on)

    def _off_and_on(self, value: int) -> None:
        if value:
            self._power_cycle()
            if self.on_power_cycle is not None:
                self.on_power_cycle()

    def _claim(self, channel: int, token: int) -> None:
        if self.channels.write(channel, token):
            self.faults.forget(channel)


_TRUTH: dict[int, Callable[[JointState], float]] = {
    objects.TRUE_ANGLE: lambda state: state.angle_rad,
    objects.TRUE_SPEED: lambda state: state.speed_rad_s,
    objects.TRUE_CURRENT: lambda state: state.current_a,
    objects.TRUE_COMMAND: lambda state: state.command_a,
}
_EVENTS: dict[int, Callable[[BenchDevice], float | str | bytes]] = {
    objects.FAULT_RESULT: lambda device: device.faults.result(device.channels.current),
    objects.FAULT_STATUS: lambda device: device.faults.status(),
    objects.FAULT_CATALOGUE: lambda device: device.faults.catalogue(),
    objects.PACKED_CATALOGUE: lambda device: device.faults.packed_catalogue(),
    objects.PACKED_EVENTS: lambda device: device.faults.packed_events(),
    objects.FAULT_EVENTS: lambda device: device.faults.events(),
    objects.ACTIVE_FAULTS: lambda device: device.faults.active,
    objects.BEGUN_FAULTS: lambda device: device.faults.begun,
    objects.EMERGENCY_STOP: lambda device: device.is_stopped,
    objects.DETECTIONS: lambda device: device.detections.count,
    objects.BROKEN_DETECTIONS: lambda device: device.detections.broken,
    objects.DETECTION_EVENTS: lambda device: device.detections.events(),
    objects.PACKED_DETECTIONS: lambda device: device.detections.packed_events(),
    objects.OUTCOME: lambda device: device.run.outcome(),
    objects.RECORDING: lambda device: device.run.is_recording(),
    objects.RECORD_PLACE: lambda device: device.run.place(),
}
_SCORES = {
    objects.RMS_ERROR: "rms_lsb",
    objects.MAX_ERROR: "max_lsb",
    objects.PEAK_CURRENT: "peak_current_a",
    objects.SATURATED_CYCLES: "saturated_cycles",
    objects.SPEED_RIPPLE: "speed_ripple",
}
