"""Process data between a SYNC and the end of the conversions that it starts."""

from collections.abc import Mapping

from canarm_protocol.canopen.pdo import PdoLayout

from ..cards.rack import Mapped, Rack
from ..node.slave import Slave
from ..robot.world import World
from ..timing import NEVER
from .fault_hooks import FaultHooks


class InputScan:
    """The scan of the inputs that the cards' TPDOs carry; one at a time."""

    def __init__(self, rack: Rack, world: World, hooks: FaultHooks) -> None:
        self.due_ns = NEVER
        """When the next card has finished its conversions; `NEVER` while there are none."""
        self._rack, self._world, self._hooks = rack, world, hooks
        self._pdos: list[tuple[Slave, PdoLayout]] = []
        self._mapped: Mapped = ()
        """The objects in `_pdos` with their node-IDs; the same in nearly every cycle."""
        self._durations_ns: Mapping[int, int] | None = None
        self._groups: list[tuple[int, list[tuple[Slave, PdoLayout]]]] = []
        """PDOs that are sent together, and how long after the start of the scan."""
        self._due: list[tuple[int, list[tuple[Slave, PdoLayout]]]] = []
        """PDOs still to be sent with their times, earliest first."""

    def begin(self, pdos: list[tuple[Slave, PdoLayout]], now_ns: int) -> None:
        """Convert the inputs of `pdos`; the world moves on meanwhile."""
        if pdos != self._pdos:
            self._pdos, self._durations_ns = pdos, None
            self._mapped = tuple((slave.node_id, each) for slave, layout in pdos for each in layout.objects)
        begin_ns = max(self._world.time_ns, now_ns)
        durations_ns = self._rack.convert(tuple(dict.fromkeys(self._mapped)) if self._hooks.doubles else self._mapped)
        if durations_ns is not self._durations_ns:
            self._durations_ns = durations_ns
            groups: dict[int, list[tuple[Slave, PdoLayout]]] = {}
            for pdo in pdos:
                groups.setdefault(durations_ns.get(pdo[0].node_id, 0), []).append(pdo)
            self._groups = sorted(groups.items())
        self._due = [(begin_ns + duration_ns, group) for duration_ns, group in self._groups]
        self.due_ns = self._due[0][0]

    def finish(self, now_ns: int) -> None:
        """Send the TPDOs of the cards that have finished their conversions."""
        while self._due and self._due[0][0] <= now_ns:
            _, pdos = self._due.pop(0)
            for slave, layout in pdos:
                slave.pdos.send(layout, now_ns)
        self.due_ns = self._due[0][0] if self._due else NEVER
