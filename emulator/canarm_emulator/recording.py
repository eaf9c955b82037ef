"""What an emulator leaves in a run folder: every frame of the robot's bus in its order, the true signals, events."""

from pathlib import Path

from canarm_protocol.cell import Cell
from canarm_protocol.frames import Cob, Emergency
from canarm_protocol.run_folder import CAN_LOG_FILE, EVENTS_FILE, SIGNALS_FOLDER, CanLog, EventLog, SignalLog

from .bench import CycleTruth, Record

SIGNALS_FILE = "robot.csv"
_COLUMNS = (
    "true_angle_rad",
    "true_speed_rad_s",
    "motor_current_a",
    "command_a",
    "motor_angle_rad",
    "motor_speed_rad_s",
)
"""As in `world.JointState`."""
HIGHEST_NODE_ID, EMERGENCY_LENGTH = 127, 8


class Recorder:
    """Writes the files of one run. `frame` takes the robot's bus, `cycle` the truth at each SYNC."""

    def __init__(self, folder: Path, cell: Cell) -> None:
        self._log = CanLog(folder / CAN_LOG_FILE)
        columns = [f"{joint}.{column}" for joint in cell.joint_names for column in _COLUMNS]
        self._signals = SignalLog(folder / SIGNALS_FOLDER / SIGNALS_FILE, columns)
        self._events = EventLog(folder / EVENTS_FILE, "emulator")

    def frame(self, record: Record) -> None:
        """Append a frame of the robot's bus; an emergency of a node is an event as well."""
        self._log.write(record.time_ns, record.frame)
        node_id = record.frame.can_id - Cob.EMERGENCY
        if 0 < node_id <= HIGHEST_NODE_ID and len(record.frame.data) == EMERGENCY_LENGTH:
            emergency = Emergency.parse(record.frame.data)
            self.event(record.time_ns, "emergency", node=node_id, code=f"0x{emergency.code:04X}")

    def cycle(self, truth: CycleTruth) -> None:
        """Append the true state at a SYNC."""
        values = [value for joint in truth.joints for value in joint]
        self._signals.write(truth.cycle, truth.time_ns, values)

    def event(self, time_ns: int, event: str, **details: object) -> None:
        """Append an event."""
        self._events.write(time_ns, event, **details)

    def close(self) -> None:
        """Write out what is left."""
        for file in (self._log, self._signals, self._events):
            file.close()
