"""What a fault can do to a card: the implementation of `faults.declaration.NodeHandle` on a bench.

Every fault has a handle of its own, so that the end of one leaves alone what another has done to the same card.
"""

import math
from collections.abc import Hashable
from itertools import count, repeat
from typing import TYPE_CHECKING

from canarm_protocol.canopen.frames import NmtCommand

from ..bench.fault_hooks import CardTrouble, SecondCard, SendFilter, SyncFilter
from .declaration import NodeHandle

if TYPE_CHECKING:
    from ..bench.bench import Bench

_COMMANDS = {
    "stopped": NmtCommand.STOP,
    "pre-operational": NmtCommand.PRE_OPERATIONAL,
    "operational": NmtCommand.START,
}


class CardHandle(NodeHandle):
    """One fault's handle on a card of `bench`."""

    def __init__(self, bench: "Bench", node_id: int) -> None:
        self._bench, self._hooks = bench, bench.hooks
        self._slave = next(slave for slave in bench.slaves if slave.node_id == node_id)
        self._done = CardTrouble()
        self._double: Hashable = None

    def set_alive(self, is_alive: bool) -> None:
        """Timers stand still, and the card is off the bus."""
        self._done.is_halted = not is_alive
        self._apply()

    def set_deaf(self, is_deaf: bool) -> None:
        """Off the bus."""
        self._done.is_deaf = is_deaf
        self._apply()

    def lose_power(self) -> None:
        """Latches without power."""
        self._bench.catch_up()
        self._slave.device.power_off()

    def boot(self, now_ns: int) -> None:
        """Reset card and CAN controller as at power-on. A card that another fault keeps dead does not boot."""
        if self._slave.node_id in self._hooks.halted:
            return
        self._bench.catch_up()
        self._bench.trouble.reset(self._slave.node_id)
        self._slave.boot(now_ns)
        self._bench.nodes.refresh()

    def resume(self, now_ns: int) -> None:
        """Timers begin again. A card that another fault keeps dead does not go on."""
        if self._slave.node_id in self._hooks.halted:
            return
        self._slave.resume(now_ns)
        self._slave.on_error_state(self._bench.trouble.state_of(self._slave.node_id), now_ns)
        self._bench.nodes.refresh()

    def command(self, state: str, now_ns: int) -> None:
        """Act as on an NMT command."""
        if self._slave.node_id in self._hooks.halted:
            return
        self._bench.catch_up()
        self._slave.on_nmt(_COMMANDS[state], now_ns)
        self._bench.nodes.refresh()

    def set_sync_filter(self, passes: SyncFilter | None) -> None:
        """For this card alone."""
        self._done.sync_filter = passes
        self._apply()

    def set_send_filter(self, passes: SendFilter | None) -> None:
        """For this card alone."""
        self._done.send_filter = passes
        self._apply()

    def set_sdo_refusal(self, is_refusing: bool) -> None:
        """Before its dictionary sees a request."""
        self._done.refuses_sdo = is_refusing
        self._apply()

    def set_timer_scale(self, scale: float) -> None:
        """Set the heartbeat's times, in both directions."""
        self._done.timer_scale = scale
        self._apply()

    def add_double(self, now_ns: int) -> None:
        """It hears what the card hears."""
        bench, node_id, doubles = self._bench, self._slave.node_id, self._hooks.doubles
        card = next(card for card in bench.cell.card if card.node_id == node_id)
        name = next(each for each in map(SecondCard, repeat(node_id), count(1)) if each not in doubles)
        doubles[name] = double = bench.make_card(card, name)
        if bench.wire is not None:
            bench.wire.attach(name)
        self._double = name
        double.boot(now_ns)
        self._bench.nodes.refresh()

    def remove_double(self) -> None:
        """It leaves silently; what it has on the wire is still carried."""
        self._hooks.doubles.pop(self._double, None)
        self._bench.bus.expel(self._double)
        self._bench.nodes.refresh()

    def _apply(self) -> None:
        """Apply all faults of the card together."""
        hooks, node_id, slave = self._hooks, self._slave.node_id, self._slave
        known = hooks.cards.get(node_id, [])
        others = [each for each in known if each is not self._done]
        if not self._done.is_any:
            known = others
        elif len(others) == len(known):
            known = [*known, self._done]
        if known:
            hooks.cards[node_id] = known
        else:
            hooks.cards.pop(node_id, None)
        if any(each.is_halted for each in known):
            hooks.halted.add(node_id)
        else:
            hooks.halted.discard(node_id)
        trouble = self._bench.trouble
        is_off = any(each.is_halted or each.is_deaf for each in known)
        if is_off != (node_id in trouble.unplugged):
            (trouble.unplug if is_off else trouble.plug_in)(node_id)
        slave.timer_scale = math.prod(each.timer_scale for each in known)
        slave.refuses_sdo = any(each.refuses_sdo for each in known)
        self._bench.nodes.refresh()
