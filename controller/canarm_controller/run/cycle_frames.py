"""The frames that the controller sends in every cycle: heartbeat, SYNC and the outputs of the cards.

What the outputs are to be never enters.
"""

from collections.abc import Iterable, Sequence

from canarm_protocol.canopen.frames import Frame, NmtState, heartbeat_frame, sync_frame
from canarm_protocol.cell.configuration import SYNC_COUNTER
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import CardNode

from .loop import OFF


class CycleFrames:
    """The cyclic frames of one run."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        self._packed = OutputFrames(cell, nodes)
        self.outputs = self._packed.frames
        """The RPDOs that carry DAC codes and direction bits, one of each per joint."""
        self._syncs = [sync_frame(counter) for counter in range(1, SYNC_COUNTER + 1)]
        self._heartbeat = heartbeat_frame(cell.bus.controller_node_id, NmtState.OPERATIONAL)
        self._heartbeat_cycles = max(1, cell.bus.heartbeat_ms * 1000 // cell.bus.cycle_us)
        joints = len(cell.joints)
        self.no_torque = self.outputs([0] * joints, [OFF] * joints)

    def move_hands(self, joints: Iterable[int], bits: int) -> None:
        """What the hands at these joints are told from the next outputs on, see `HandBits`."""
        for joint in joints:
            self._packed.grips[joint] = bits

    def opening(self, tick: int) -> list[Frame]:
        """What begins cycle `tick`: SYNC, after a heartbeat when one is due."""
        sync = self._syncs[tick % SYNC_COUNTER]
        return [sync] if tick % self._heartbeat_cycles else [self._heartbeat, sync]
