"""Process data between a SYNC and the end of the conversions that it starts.

When a SYNC comes never enters.
"""

from canarm_protocol.canopen.pdo import MappedObject, PdoLayout

from ..cards.rack import Rack
from ..node.slave import Slave
from ..robot.world import World
from ..timing import NEVER
from .fault_hooks import FaultHooks


class InputScan:
    """The scan of the inputs that the cards' TPDOs carry; one at a time."""

    def __init__(self, rack: Rack, world: World, hooks: FaultHooks) -> None:
        self.due_ns = NEVER
        """When the conversions are done; `NEVER` while there are none."""
        self._rack, self._world, self._hooks = rack, world, hooks
        self._pdos: list[tuple[Slave, PdoLayout]] = []
        self._mapped: tuple[tuple[int, MappedObject], ...] = ()
        """The objects in them, by node-ID; they are the same in nearly every cycle."""

    def begin(self, pdos: list[tuple[Slave, PdoLayout]], now_ns: int) -> None:
        """Convert the inputs of `pdos`; the world moves on meanwhile."""
        if pdos != self._pdos:
            self._pdos = pdos
            self._mapped = tuple((slave.node_id, each) for slave, layout in pdos for each in layout.objects)
        self._rack.convert(tuple(dict.fromkeys(self._mapped)) if self._hooks.doubles else self._mapped)
        self.due_ns = max(self._world.time_ns, now_ns)

    def finish(self, now_ns: int) -> None:
        """The conversions are done: the TPDOs leave."""
        self.due_ns = NEVER
        for slave, layout in self._pdos:
            slave.send_tpdo(layout, now_ns)
