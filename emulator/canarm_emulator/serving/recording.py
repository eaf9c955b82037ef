"""An emulator's files in a run folder: every frame of the robot's bus in order, the true signals, events.

Times count from cycle 0, the first SYNC after NMT start, but for the stamps of the frames, which count from power-on.
A record that cannot be written ends with what has been written; the run goes on.
"""

from collections.abc import Callable, Hashable, Sequence
from itertools import chain
from pathlib import Path

from canarm_protocol.canopen.frames import ERROR_FLAG, HIGHEST_NODE_ID, Cob, Emergency, Frame
from canarm_protocol.cell.model import Cell
from canarm_protocol.faults.fault_events import FaultEvent, event_details, event_name
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import FaultScript
from canarm_protocol.runs.run_folder import (
    BENCH_LOG_FILE,
    CAN_LOG_FILE,
    EVENTS_FILE,
    SIGNALS_FOLDER,
    CanLog,
    EventLog,
    Rotation,
    SignalLog,
)
from canarm_protocol.runs.unwritten import UNWRITABLE, Unwritten

from ..bench.bench import CycleTruth, Record
from ..robot.carried import GRIP_LOST, ObjectState
from ..wire.bus_trouble import origin_of
from ..wire.error_frames import ErrorClass
from ..wire.wire_events import ErrorFrame, StateChange

SIGNALS_FILE = "robot.csv"
POWER_ON_S = "power_on_s"
"""Virtual time since power-on: a column of the signals, and a key of the events."""
_COLUMNS = (
    "true_angle_rad",
    "true_speed_rad_s",
    "motor_current_a",
    "command_a",
    "motor_angle_rad",
    "motor_speed_rad_s",
)
"""The columns are those of `world.JointState`."""
_OBJECT_COLUMNS = (
    *(f"position_{axis}_m" for axis in "xyz"),
    *(f"quaternion_{part}" for part in "wxyz"),
    *(f"master_force_{axis}_n" for axis in "xyz"),
    *(f"slave_force_{axis}_n" for axis in "xyz"),
    "squeeze_n",
)
"""The columns are those of `carried.ObjectState`, but for its grips: when one is lost is an event."""
EMERGENCY_LENGTH = 8
_SYNC, _LAST_EMERGENCY = int(Cob.SYNC), Cob.EMERGENCY + HIGHEST_NODE_ID
SCRIPT = "fault-script"
RECORDING = "recording"
"""The event of a record that is switched off, or on again."""
"""The event of a fault script that has been accepted."""


class Recorder:
    """Writes the files of one run. `frames` takes the robot's bus, `cycle` the truth at each SYNC.

    `on_failure` is told, once, why nothing more is written. `frames` and `signals` say when their files are parted.
    `with_bench` records the bench's own bus too: what listeners ask for, on which no run depends.
    """

    def __init__(
        self,
        folder: Path,
        cell: Cell,
        on_failure: Callable[[str], None] = lambda text: None,
        frames: Rotation | None = None,
        signals: Rotation | None = None,
        *,
        with_bench: bool = False,
    ) -> None:
        self._rotations, self._with_bench = (frames, signals), with_bench
        self._cell, self._unwritten = cell, Unwritten(folder, on_failure)
        self.is_on = True
        """Whether frames and signals are recorded; events always are."""
        self._open(folder)

    def _open(self, folder: Path) -> None:
        cell = self._cell
        self._folder = folder
        self._log = CanLog(folder / CAN_LOG_FILE, rotation=self._rotations[0])
        bench = folder / BENCH_LOG_FILE
        self._bench_log = CanLog(bench, "bench", self._rotations[0]) if self._with_bench else None
        columns = [f"{joint}.{column}" for joint in cell.joint_names for column in _COLUMNS]
        if cell.object is not None:
            columns += [f"object.{column}" for column in _OBJECT_COLUMNS]
        self._lost: tuple[str, ...] = ()
        self._signals = SignalLog(folder / SIGNALS_FOLDER / SIGNALS_FILE, (POWER_ON_S, *columns), self._rotations[1])
        self._events = EventLog(folder / EVENTS_FILE, "emulator")
        self._cycle, self._begin_ns = -1, 0

    @property
    def failure(self) -> str | None:
        """Why the record ends before the run, if it does."""
        return self._unwritten.why

    @property
    def place(self) -> str:
        """The folder of the present run."""
        return str(self._folder.absolute())

    def switch(self, time_ns: int, is_on: bool) -> None:
        """Record frames and signals from now on, or no longer. What has been recorded is whole on disk then."""
        self.is_on = is_on
        self._note_switch(time_ns)
        self.write_out()

    def begin_run(self) -> None:
        """The truth of the next `cycle` is that of cycle 0."""

    def frames(self, records: Sequence[Record]) -> None:
        """Append frames of the robot's bus; EMCY messages and error frames are also events.

        The log has only error frames that are caused by an error on the bus (BUSERROR): python-can's reader takes the
        others, which report a better state, for data frames.
        """
        unwritten = self._unwritten
        if unwritten.why is not None or not records:
            return
        special = [
            each for each in records if not _LAST_EMERGENCY < (can_id := each[1][0]) < ERROR_FLAG and can_id != _SYNC
        ]
        if special and any(each.frame.can_id >= ERROR_FLAG for each in special):
            records = [each for each in records if _is_logged(each.frame)]
        if self.is_on:
            try:
                self._log.write_all(records)
            except UNWRITABLE as error:
                unwritten.note(error)
        for each in special:
            self._event_of(each)

    def bench_frames(self, records: Sequence[Record]) -> None:
        """Append frames of the bench's own bus, if they are recorded."""
        if self._bench_log is not None and self.is_on and self._unwritten.why is None:
            with self._unwritten:
                self._bench_log.write_all(records)

    def cycle(self, truth: CycleTruth) -> None:
        """Append the true state at a SYNC."""
        if self._unwritten.why is None:
            try:
                self._row(truth)
            except UNWRITABLE as error:
                self._unwritten.note(error)

    def event(self, time_ns: int, event: str, **details: object) -> None:
        """Append an event; `cycle` is the last one begun, unless given: -1 before the first."""
        if self._unwritten.why is None:
            with self._unwritten:
                details = {"cycle": self._cycle, **details, POWER_ON_S: round(time_ns * 1e-9, 9)}
                self._events.write(time_ns, event, **details)

    def fault(self, event: FaultEvent) -> None:
        """Append the beginning or end of a fault."""
        self.event(event.time_ns, event_name(event), **event_details(event))

    def script(self, time_ns: int, script: FaultScript) -> None:
        """Append a fault script that has been accepted, as text: with it the run can be repeated."""
        self.event(time_ns, SCRIPT, toml=as_toml(script))

    def write_out(self) -> None:
        """Put on disk what has gathered: a reader then finds all that there is."""
        for file in (self._signals, self._log, self._bench_log):
            if file is not None and self._unwritten.why is None:
                with self._unwritten:
                    file.write_out()

    def close(self) -> None:
        """Write out what is left, as far as possible. May be called again."""
        for file in (self._events, self._signals, self._log, self._bench_log):
            with self._unwritten:
                if file is not None:
                    file.close()

    def _event_of(self, record: Record) -> None:
        """The event of an EMCY message or an error frame."""
        if record.frame.can_id >= ERROR_FLAG:
            self._error(record)
            return
        node_id = record.frame.can_id - Cob.EMERGENCY
        if 0 < node_id <= HIGHEST_NODE_ID and len(record.frame.data) == EMERGENCY_LENGTH:
            emergency = Emergency.parse(record.frame.data)
            self.event(record.time_ns, "emergency", node=node_id, code=f"0x{emergency.code:04X}")

    def _error(self, record: Record) -> None:
        event = record.origin
        if isinstance(event, ErrorFrame):
            sent = f"0x{event.frame.can_id:03X}"
            self.event(record.time_ns, "error-frame", kind=event.kind.value, frame=sent, **_party(event.sender))
        elif isinstance(event, StateChange):
            self.event(record.time_ns, "error-state", state=event.state.value, **_party(event.node))

    def _row(self, truth: CycleTruth) -> None:
        if self._cycle < 0:
            self._begin_ns = truth.time_ns
            self._events.begin(truth.time_ns)
            if not self.is_on:
                self._note_switch(truth.time_ns)
        self._cycle = truth.cycle
        values = chain((truth.time_ns * 1e-9,), *truth.joints)
        if truth.object is not None:
            values = chain(values, self._object(truth.time_ns, truth.object))
        if self.is_on:
            self._signals.write(truth.cycle, truth.time_ns - self._begin_ns, values)

    def _note_switch(self, time_ns: int) -> None:
        self.event(time_ns, RECORDING, state="on" if self.is_on else "off")

    def _object(self, time_ns: int, state: ObjectState) -> list[float]:
        """The object's columns. A grip that has been lost since the last cycle is an event."""
        lost = state.lost
        for name in lost:
            if name not in self._lost:
                self.event(time_ns, GRIP_LOST, hand=name)
        self._lost = lost
        vectors = (state.position_m, state.quaternion, state.master_force_n, state.slave_force_n)
        return [*(value for vector in vectors for value in vector), state.squeeze_n]


def _is_logged(frame: Frame) -> bool:
    return frame.can_id < ERROR_FLAG or bool(frame.can_id & ErrorClass.BUSERROR)


def _party(name: Hashable) -> dict[str, object]:
    """A participant of the wire: a card by its node-ID, a client of the virtual bus by its number."""
    if isinstance(name, int):
        return {"node": name}
    client = origin_of(name)
    return {"client": client if isinstance(client, int | str) else None}
