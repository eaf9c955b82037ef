"""Faults of a node, that is of a card's processor and its connection to the bus."""

from dataclasses import dataclass

from canarm_protocol.canopen.frames import Cob, Frame

from ..declaration import Context, Family, NodeFault, NodeHandle, TapKind
from ..parameters import choice, parameter

_NODE = (TapKind.NODE,)


@dataclass
class _Once(NodeFault):
    """A fault that does one thing when it begins, and whose end undoes it."""

    _has_acted: bool = False

    def act(self, node: NodeHandle, now_ns: int) -> None:
        """The first time only."""
        if not self._has_acted:
            self._has_acted = True
            self.strike(node, now_ns)

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """What it does."""
        raise NotImplementedError

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """Nothing to be undone."""


@dataclass
class Crash(_Once, name="crash", family=Family.NODE, acts_on=_NODE):
    """The card loses its power: outputs go off, and it boots again when the fault ends."""

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Off."""
        node.set_alive(False)
        node.lose_power()

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """On again."""
        node.set_alive(True)
        node.boot(now_ns)


@dataclass
class Hang(_Once, name="hang", family=Family.NODE, acts_on=_NODE, is_dangerous=True):
    """The card's processor stands still: outputs keep their last values, and it goes on when the fault ends.

    Its CAN controller stands still as well, and acknowledges nothing.
    """

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Stand still."""
        node.set_alive(False)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """Go on."""
        node.set_alive(True)
        node.resume(now_ns)


@dataclass
class Reset(_Once, name="reset", family=Family.NODE, acts_on=_NODE):
    """The card's processor is reset, once: it boots, with outputs at their error values, and waits for NMT start."""

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Boot."""
        node.boot(now_ns)


@dataclass
class LateBoot(_Once, name="late-boot", family=Family.NODE, acts_on=_NODE):
    """The card takes long to boot after power on or a reset; injected at once, it starts without power."""

    delay: float = parameter("time until it boots", "s", 1.0, 0.0, 60.0)
    _due_ns: int = 0
    _is_up: bool = False

    def begin(self, context: Context) -> None:
        """When it will have booted."""
        self._due_ns = context.now_ns + round(self.delay * 1e9)

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Off."""
        node.set_alive(False)
        node.lose_power()

    def act(self, node: NodeHandle, now_ns: int) -> None:
        """Boot when it is time."""
        super().act(node, now_ns)
        if now_ns >= self._due_ns:
            self._boot(node, now_ns)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """It boots now, if it has not."""
        self._boot(node, now_ns)

    def _boot(self, node: NodeHandle, now_ns: int) -> None:
        if not self._is_up:
            self._is_up = True
            node.set_alive(True)
            node.boot(now_ns)


@dataclass
class DuplicateNodeId(_Once, name="duplicate-node-id", family=Family.NODE, acts_on=_NODE, is_dangerous=True):
    """A second card with the same node-ID, wired to nothing, boots on the bus and answers as well.

    A master sees two boot-ups, two heartbeats that may name different states, and two answers to an SDO request; both
    obey NMT. With the wire model different frames with one identifier that begin at once are errors for both senders,
    equal ones are one.
    """

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """It boots."""
        node.add_double(now_ns)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """It is taken away."""
        node.remove_double()


@dataclass
class WrongNmtState(_Once, name="wrong-nmt-state", family=Family.NODE, acts_on=_NODE):
    """The card leaves OPERATIONAL by itself, once."""

    state: str = choice("the state that it enters", ("pre-operational", "stopped"))

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Change the state."""
        node.command(self.state, now_ns)


@dataclass
class SyncMissed(_Once, name="sync-missed", family=Family.NODE, acts_on=_NODE):
    """The card does not see some SYNCs: outputs do not act, inputs are not sent."""

    every: int = parameter("of so many SYNCs one is missed; 1: all of them", "", 1, 1, 1000, is_whole=True)
    _count: int = 0

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Watch the SYNCs."""
        node.set_sync_filter(self._passes)

    def _passes(self, now_ns: int) -> bool:
        self._count += 1
        return self._count % self.every != 0

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """It sees all again."""
        node.set_sync_filter(None)


@dataclass
class HeartbeatLost(_Once, name="heartbeat-lost", family=Family.NODE, acts_on=_NODE):
    """The card sends everything but its heartbeat, and no boot-up message either."""

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Watch what it sends."""
        node.set_send_filter(self.passes)

    def passes(self, frame: Frame) -> Frame | None:
        """All but 0x700 + node-ID."""
        return None if frame.can_id & ~0x7F == Cob.HEARTBEAT else frame

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """All goes out again."""
        node.set_send_filter(None)


@dataclass
class SdoAbort(_Once, name="sdo-abort", family=Family.NODE, acts_on=_NODE):
    """The card refuses every SDO transfer with "general error"."""

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Refuse."""
        node.set_sdo_refusal(True)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """Obey again."""
        node.set_sdo_refusal(False)


@dataclass
class LineBroken(_Once, name="line-broken", family=Family.NODE, acts_on=_NODE):
    """The card's stub of the bus is cut: nothing comes in or goes out, while the card goes on by itself.

    On the wire it acknowledges nothing; what it sends meanwhile is lost, and does not move its error counters.
    """

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Cut."""
        node.set_deaf(True)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """Mended."""
        node.set_deaf(False)


@dataclass
class ClockDrift(_Once, name="clock-drift", family=Family.NODE, acts_on=_NODE):
    """The card's clock runs slow or fast: its heartbeat period and its time-outs are longer or shorter."""

    rate: float = parameter("how much longer its periods last", "%", 400.0, -90.0, 10_000.0)

    def strike(self, node: NodeHandle, now_ns: int) -> None:
        """Slow down."""
        node.set_timer_scale(1.0 + self.rate / 100)

    def end(self, node: NodeHandle, now_ns: int) -> None:
        """Unchanged."""
        node.set_timer_scale(1.0)
