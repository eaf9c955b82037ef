"""Where faults of the wire, of nodes and of the bench's time act: thin points over what the bench offers for each."""

from typing import TYPE_CHECKING

from .declaration import BusFault, ClockFault, Context, Fault, NodeFault, Tap
from .points import Point

if TYPE_CHECKING:
    from ..bench import Bench


class BusPoint(Point):
    """The wire model of the robot's bus."""

    def __init__(self, bench: "Bench") -> None:
        assert bench.wire is not None
        self._wire = bench.wire
        self._faults: list[BusFault] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, BusFault)
        self._faults.append(fault)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """The wire is left with what it has not carried out yet."""
        assert isinstance(fault, BusFault)
        self._faults.remove(fault)
        fault.end(self._wire)

    def refresh(self, now_ns: int) -> None:
        """Every fault acts once a cycle."""
        for fault in self._faults:
            fault.act(self._wire, now_ns)


class NodePoint(Point):
    """A card as a node."""

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._port = bench.node_port(tap.node_id)
        self._faults: list[NodeFault] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, NodeFault)
        self._faults.append(fault)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """The node is as the fault leaves it."""
        assert isinstance(fault, NodeFault)
        self._faults.remove(fault)
        fault.end(self._port, now_ns)

    def refresh(self, now_ns: int) -> None:
        """Every fault acts once a cycle."""
        for fault in self._faults:
            fault.act(self._port, now_ns)


class ClockPoint(Point):
    """The virtual time from one SYNC to the next, in lockstep."""

    def __init__(self, bench: "Bench") -> None:
        self._bench = bench
        self._faults: list[ClockFault] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, ClockFault)
        self._faults.append(fault)
        self._bench.set_cycle_length(self._period_ns)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Cycles are as long as the cell says once the last fault has gone."""
        assert isinstance(fault, ClockFault)
        self._faults.remove(fault)
        if not self._faults:
            self._bench.set_cycle_length(None)

    def _period_ns(self, nominal_ns: int, now_ns: int) -> int:
        for fault in self._faults:
            nominal_ns = fault.period_ns(nominal_ns, now_ns)
        return nominal_ns
