"""What a fault can do to a card: the bench's side of `faults.declaration.NodePort`."""

from typing import TYPE_CHECKING

from canarm_protocol.frames import NmtCommand

from .fault_hooks import SendFilter, SyncFilter
from .faults.declaration import NodePort
from .slave import Slave

if TYPE_CHECKING:
    from .bench import Bench

_COMMANDS = {
    "stopped": NmtCommand.STOP,
    "pre-operational": NmtCommand.PRE_OPERATIONAL,
    "operational": NmtCommand.START,
}


class CardPort(NodePort):
    """One card of `bench`."""

    def __init__(self, bench: "Bench", slave: Slave) -> None:
        self._bench, self._slave, self._hooks = bench, slave, bench.hooks

    def set_alive(self, is_alive: bool) -> None:
        """Timers stand still, and the card is off the bus."""
        node_id = self._slave.node_id
        if is_alive:
            self._hooks.halted.discard(node_id)
        else:
            self._hooks.halted.add(node_id)
        self.set_deaf(not is_alive)

    def set_deaf(self, is_deaf: bool) -> None:
        """Off the bus."""
        trouble = self._bench.trouble
        (trouble.unplug if is_deaf else trouble.plug_in)(self._slave.node_id)
        self._bench.nodes_changed()

    def lose_power(self) -> None:
        """Latches without power."""
        self._bench.catch_up()
        self._slave.device.power_off()

    def boot(self, now_ns: int) -> None:
        """As after power on."""
        self._bench.catch_up()
        self._slave.boot(now_ns)
        self._bench.nodes_changed()

    def resume(self, now_ns: int) -> None:
        """Heartbeats begin anew."""
        self._slave.resume(now_ns)
        self._bench.nodes_changed()

    def command(self, state: str, now_ns: int) -> None:
        """As if an NMT command had come."""
        self._bench.catch_up()
        self._slave.on_nmt(_COMMANDS[state], now_ns)
        self._bench.nodes_changed()

    def set_sync_filter(self, passes: SyncFilter | None) -> None:
        """For this card alone."""
        filters, node_id = self._hooks.sync_filters, self._slave.node_id
        if passes is None:
            filters.pop(node_id, None)
        else:
            filters[node_id] = passes

    def set_send_filter(self, passes: SendFilter | None) -> None:
        """For this card alone."""
        filters, node_id = self._hooks.send_filters, self._slave.node_id
        if passes is None:
            filters.pop(node_id, None)
        else:
            filters[node_id] = passes

    def set_timer_scale(self, scale: float) -> None:
        """Of the heartbeat, both ways."""
        self._slave.timer_scale = scale

    def add_double(self, now_ns: int) -> None:
        """It hears what the card hears."""
        double = self._bench.make_double(self._slave.node_id)
        self._hooks.doubles[self._slave.node_id] = double
        double.boot(now_ns)
        self._bench.nodes_changed()

    def remove_double(self) -> None:
        """Gone without a word."""
        self._hooks.doubles.pop(self._slave.node_id, None)
        self._bench.nodes_changed()


