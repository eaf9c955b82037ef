"""Trouble on the wire: last error states, nodes in bus-off, counts of errors and lost frames.

Keeps records of the wire's events; the bus decides what they mean for a card or a client.
"""

from collections.abc import Hashable
from functools import lru_cache
from typing import NamedTuple

from .confinement import ErrorState
from .wire import Wire
from .wire_events import ErrorFrame, StateChange


class ClientNode(NamedTuple):
    """A client of the virtual bus as a node on the wire; its number is no node-ID."""

    client_id: int


_client_node = lru_cache(ClientNode)


def wire_name(origin: object) -> Hashable:
    """The name of a client on the wire, distinct from those of cards, which are node-IDs."""
    return _client_node(origin) if isinstance(origin, int) else origin


def origin_of(name: Hashable) -> object:
    """The client behind a name on the wire."""
    return name.client_id if isinstance(name, ClientNode) else name


class BusTrouble:
    """The trouble on `wire` so far; without a wire there is none."""

    def __init__(self, wire: Wire | None) -> None:
        self.error_frames = 0
        self.off: set[Hashable] = set()
        """Nodes in bus-off, or unplugged: they hear and send nothing."""
        self.held: set[Hashable] = set()
        """Nodes that, once in bus-off, stay there until `RobotBus.recover` is called for them."""
        self.unplugged: set[Hashable] = set()
        """Nodes that are not connected to the bus."""
        self._wire = wire
        self._states: dict[Hashable, ErrorState] = {}
        self._lost_before = 0

    @property
    def lost_frames(self) -> int:
        """Frames discarded by nodes in bus-off or with a full queue, including nodes that have left."""
        nodes = () if self._wire is None else self._wire.nodes.values()
        return self._lost_before + sum(node.discarded for node in nodes)

    def note(self, event: ErrorFrame | StateChange) -> ErrorState:
        """Record an event; returns the node's state before it. At bus-off, recovery begins."""
        if isinstance(event, ErrorFrame):
            self.error_frames += 1
            return self._states.get(event.sender, ErrorState.ACTIVE)
        node = event.node
        was = self._states.get(node, ErrorState.ACTIVE)
        self._states[node] = event.state
        if event.state is ErrorState.BUS_OFF:
            self.off.add(node)
            if self._wire is not None and node not in self.held:
                self._wire.recover(node)
        elif node not in self.unplugged:
            self.off.discard(node)
        return was

    def state_of(self, name: Hashable) -> ErrorState:
        """A node's last reported error state."""
        return self._states.get(name, ErrorState.ACTIVE)

    def unplug(self, name: Hashable) -> None:
        """A node loses its connection to the bus: it hears, sends and acknowledges nothing."""
        self.unplugged.add(name)
        self.off.add(name)
        if self._wire is not None:
            self._wire.disconnect(name)

    def plug_in(self, name: Hashable) -> None:
        """It is connected again; in bus-off it stays off until it has recovered."""
        self.unplugged.discard(name)
        if self._wire is not None:
            self._wire.connect(name)
        if self.state_of(name) is not ErrorState.BUS_OFF:
            self.off.discard(name)

    def reset(self, name: Hashable) -> None:
        """A node's CAN controller is reset: error-active, with nothing to send."""
        self._states.pop(name, None)
        if self._wire is not None:
            self._wire.reset(name)
        if name not in self.unplugged:
            self.off.discard(name)

    def forget(self, name: Hashable) -> None:
        """A node is about to leave the bus."""
        if self._wire is not None:
            self._lost_before += self._wire.nodes[name].discarded
        self._states.pop(name, None)
        self.off.discard(name)
