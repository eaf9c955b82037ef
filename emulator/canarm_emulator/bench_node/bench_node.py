"""The bench bus: the bench as a CANopen node.

Owns the bench node and the record of its bus. The robot's bus never enters.
"""

from collections.abc import Callable

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Frame, NmtCommand
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.bench_objects import BUS_LOAD, bench_dictionary
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

from ..bus_record import Record
from ..node.slave import Slave
from ..robot.timeline import Timeline
from .bench_device import BenchDevice


class BenchNode:
    """The node that shows `device`; its telemetry has the bus load if `has_wire`."""

    def __init__(self, cell: Cell, clock: Clock, timeline: Timeline, device: BenchDevice, has_wire: bool) -> None:
        self.records: list[Record] = []
        """What was on the bench bus, in order; whoever drives the bench empties it."""
        self.slave = Slave("bench", cell.bus.bench_node_id, bench_dictionary(cell), device, self._emit, clock.value)
        self._timeline, self._device, self._has_wire = timeline, device, has_wire
        self._takers: dict[int, Callable[[bytes], None]] = {}

    def start(self) -> None:
        """Power on: the node starts itself."""
        slave = self.slave
        slave.boot(self._timeline.time_ns)
        slave.on_nmt(NmtCommand.START, self._timeline.time_ns)
        self._takers = {
            **{cob_id: self._sdo(cob_id) for cob_id in slave.sdo_cob_ids},
            **{layout.cob_id: self._rpdo(layout) for layout in slave.pdos.rpdos},
        }

    def receive(self, frame: Frame, origin: object) -> None:
        """Take a frame from a client; SDO only on a channel that the client owns or that nobody has claimed."""
        self.records.append(Record(self._timeline.time_ns, frame, origin))
        if frame.is_extended or frame.is_remote or not self._device.channels.admit(frame.can_id, origin):
            return
        take = self._takers.get(frame.can_id)
        if take is not None:
            take(frame.data)
        elif Cob.HEARTBEAT < frame.can_id <= Cob.HEARTBEAT + HIGHEST_NODE_ID:
            self.slave.on_heartbeat(frame.can_id - Cob.HEARTBEAT, self._timeline.time_ns)

    def send_telemetry(self) -> None:
        """The node sends its TPDOs."""
        for layout in self.slave.pdos.tpdos:
            if self._has_wire or layout.objects[0].index != BUS_LOAD:
                self.slave.pdos.send(layout, self._timeline.time_ns)

    def _sdo(self, cob_id: int) -> Callable[[bytes], None]:
        return lambda data: self.slave.on_sdo(cob_id, data, self._timeline.time_ns)

    def _rpdo(self, layout: PdoLayout) -> Callable[[bytes], None]:
        return lambda data: self.slave.on_rpdo(layout, data, self._timeline.time_ns)

    def _emit(self, time_ns: int, frame: Frame) -> None:
        self.records.append(Record(time_ns, frame))
