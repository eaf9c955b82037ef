"""What the bench node shows of the buses: load, response times and errors of the wire, clients of the virtual bus.

Reads and computes only. Without a wire model, counts are 0 and measurements are NaN.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from canarm_protocol.canopen.frames import EXTENDED_FLAG
from canarm_protocol.cell import bench_objects as objects

from ..node.io_device import Getter
from ..wire.bus_trouble import BusTrouble
from ..wire.confinement import ErrorState
from ..wire.wire import Wire
from ..wire.wire_node import WireNode

LOAD_WINDOW_NS = 1_000_000_000
LOAD_REFRESH_NS = 100_000_000
"""The load of the last second is computed this often: that looks at every frame of the second."""
NAN = float("nan")
_STATE_NUMBERS = {ErrorState.ACTIVE: 0, ErrorState.PASSIVE: 1, ErrorState.BUS_OFF: 2}


class ClientCounts(NamedTuple):
    """Clients of a bus: how many are attached, how many frames were dropped for slow ones."""

    attached: int
    dropped: int


class BusFigures:
    """Figures of the robot's bus with the cards `node_ids`, in the cell's order, and of both buses' clients."""

    def __init__(self, wire: Wire | None, trouble: BusTrouble, node_ids: Sequence[int]) -> None:
        self.count_clients: Callable[[str], ClientCounts] = lambda bus: ClientCounts(0, 0)
        """Counts the clients of a bus by its name; set by whoever serves them."""
        self._wire, self._trouble, self._node_ids = wire, trouble, node_ids
        self._load = NAN
        self._load_until_ns = -1

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read an object of the bench node; None if it is not about the buses."""
        if index in _FIGURES:
            figure = _FIGURES[index]
            return lambda: figure(self)
        if index in _CARD_FIGURES and 1 <= subindex <= len(self._node_ids):
            number, node_id = _CARD_FIGURES[index], self._node_ids[subindex - 1]
            return lambda: 0 if self._wire is None else number(self._wire.nodes[node_id])
        if index in _CLIENT_FIGURES and 1 <= subindex <= len(objects.BUSES):
            count, bus = _CLIENT_FIGURES[index], objects.BUSES[subindex - 1]
            return lambda: count(self.count_clients(bus))
        return None

    @property
    def load(self) -> float:
        """Busy share of the last second, 0 to 1, at most `LOAD_REFRESH_NS` old."""
        wire = self._wire
        if wire is not None and wire.time_ns >= self._load_until_ns:
            self._load = wire.load(LOAD_WINDOW_NS)
            self._load_until_ns = wire.time_ns + LOAD_REFRESH_NS
        return self._load

    @property
    def total_load(self) -> float:
        """Busy share since start, 0 to 1."""
        return NAN if self._wire is None else self._wire.load()

    @property
    def error_frames(self) -> int:
        """Error frames so far."""
        return self._trouble.error_frames

    @property
    def lost_frames(self) -> int:
        """Frames lost so far, in bus-off or because a node's queue was full."""
        return self._trouble.lost_frames

    @property
    def worst_response(self) -> tuple[float, int]:
        """Longest time from offer to last bit in µs, and the COB-ID of that frame, with bit 29 for an extended one."""
        worst = {} if self._wire is None else self._wire.worst_response_ns
        if not worst:
            return NAN, 0
        can_id, is_extended = max(worst, key=lambda name: worst[name])
        return worst[can_id, is_extended] / 1000, can_id | EXTENDED_FLAG * is_extended


_FIGURES: dict[int, Callable[[BusFigures], float]] = {
    objects.BUS_LOAD: lambda bus: bus.load,
    objects.TOTAL_BUS_LOAD: lambda bus: bus.total_load,
    objects.WORST_RESPONSE: lambda bus: bus.worst_response[0],
    objects.WORST_COB_ID: lambda bus: bus.worst_response[1],
    objects.ERROR_FRAMES: lambda bus: bus.error_frames,
    objects.LOST_FRAMES: lambda bus: bus.lost_frames,
}
_CARD_FIGURES: dict[int, Callable[[WireNode], int]] = {
    objects.TRANSMIT_ERRORS: lambda node: node.tec,
    objects.RECEIVE_ERRORS: lambda node: node.rec,
    objects.ERROR_STATE: lambda node: _STATE_NUMBERS[node.state],
}
_CLIENT_FIGURES: dict[int, Callable[[ClientCounts], int]] = {
    objects.DROPPED_FRAMES: lambda counts: counts.dropped,
    objects.ATTACHED_CLIENTS: lambda counts: counts.attached,
}
