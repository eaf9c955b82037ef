"""The points where faults of the wire, of nodes and of the bench's time act."""

from typing import TYPE_CHECKING

from .card_handle import CardHandle
from .declaration import BusFault, ClockFault, Context, Fault, GripFault, NodeFault, NodeHandle, Tap
from .points import Point

if TYPE_CHECKING:
    from ..bench.bench import Bench


class BusPoint(Point):
    """The wire model of the robot's bus."""

    def __init__(self, bench: "Bench") -> None:
        assert bench.wire is not None
        self._wire = bench.wire
        self._faults: list[tuple[BusFault, int]] = []
        """Faults with the times at which they began."""

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, BusFault)
        self._faults.append((fault, context.now_ns))
        fault.act(self._wire, context.now_ns)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Withdraw what the fault has asked of the wire and has not happened yet."""
        assert isinstance(fault, BusFault)
        self._faults = [each for each in self._faults if each[0] is not fault]
        fault.end(self._wire)

    def refresh(self, now_ns: int) -> None:
        """Every fault acts once a cycle, when it begins for the first time."""
        for fault, begun_ns in self._faults:
            if now_ns > begun_ns:
                fault.act(self._wire, now_ns)


class NodePoint(Point):
    """A card as a node."""

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._bench, self._node_id = bench, tap.node_id
        self._faults: list[tuple[NodeFault, NodeHandle, int]] = []
        """Faults, each with a handle of its own and the time at which it began."""

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, NodeFault)
        port = CardHandle(self._bench, self._node_id)
        self._faults.append((fault, port, context.now_ns))
        fault.act(port, context.now_ns)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """The node is as the fault, and those that still act on it, leave it."""
        assert isinstance(fault, NodeFault)
        ports = [port for each, port, _ in self._faults if each is fault]
        self._faults = [each for each in self._faults if each[0] is not fault]
        for port in ports:
            fault.end(port, now_ns)

    def refresh(self, now_ns: int) -> None:
        """Every fault acts once a cycle, when it begins for the first time."""
        for fault, port, begun_ns in self._faults:
            if now_ns > begun_ns:
                fault.act(port, now_ns)


class GripPoint(Point):
    """A hand that holds the object."""

    def __init__(self, bench: "Bench", tap: Tap) -> None:
        self._world, self._hand = bench.world, tap.name.removeprefix("object.")

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, GripFault)
        fault.strike(self._world, self._hand)

    def remove(self, fault: Fault, now_ns: int) -> None:
        """What a hand has lost stays lost."""


class ClockPoint(Point):
    """The virtual time from one SYNC to the next, in lockstep."""

    def __init__(self, bench: "Bench") -> None:
        self._bench = bench
        self._faults: list[ClockFault] = []

    def _add(self, fault: Fault, context: Context) -> None:
        assert isinstance(fault, ClockFault)
        self._faults.append(fault)
        self._bench.hooks.cycle_length = self._period_ns

    def remove(self, fault: Fault, now_ns: int) -> None:
        """Cycles are as long as the cell says once the last fault has gone."""
        assert isinstance(fault, ClockFault)
        self._faults = [each for each in self._faults if each is not fault]
        if not self._faults:
            self._bench.hooks.cycle_length = None

    def _period_ns(self, nominal_ns: int, now_ns: int) -> int:
        for fault in self._faults:
            nominal_ns = fault.period_ns(nominal_ns, now_ns)
        return nominal_ns
