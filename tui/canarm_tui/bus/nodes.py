"""Who is on a CANopen bus: states, heartbeats, errors and identities, as far as they were heard.

Nobody is asked: an identity is known from an answer that somebody else has got, or from the node's data sheet.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from canarm_protocol.canopen.dictionary import IDENTITY, variable_at
from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Emergency, Frame, NmtCommand, NmtState, parse_nmt
from canarm_protocol.decoding import Book
from canarm_protocol.errors import FrameError

EMERGENCIES = 50
"""EMCY messages that are remembered, of all nodes."""
_EXPEDITED_UPLOAD = 0x43
"""Answer with four bytes (CiA 301, 7.2.4.3.5): as all members of 0x1018 have."""
_SDO_LENGTH = 8
_ALPHA = 0.2
"""Weight of the newest interval in a heartbeat's period."""


class NodeNow(NamedTuple):
    """A node. Times are in ns of wall time; None is what was not heard."""

    node_id: int
    name: str
    state: int | None
    """As the heartbeat carries it."""
    heartbeat_wall_ns: int | None
    heartbeat_period_ns: int | None
    boots: int
    register: int | None
    """0x1001, as the last EMCY carried it."""
    code: int | None
    """Of the last EMCY."""
    emergencies: int
    identity: tuple[int | None, int | None]
    """Vendor-ID and product code."""
    is_identity_heard: bool
    """Else it is what the data sheet says."""
    is_told: bool = False
    """Whether `state` is what an NMT command has told it since its last heartbeat."""


class HeardEmergency(NamedTuple):
    """An EMCY of a node, at a wall time in ns."""

    wall_ns: int
    node_id: int
    data: bytes


@dataclass(slots=True)
class _Node:
    state: int | None = None
    is_told: bool = False
    heartbeat_wall_ns: int | None = None
    period_ns: float | None = None
    boots: int = 0
    register: int | None = None
    code: int | None = None
    emergencies: int = 0
    identity: dict[int, int] = field(default_factory=dict)


def is_of_node(frame: Frame) -> bool:
    """Whether a frame says something of a node: heartbeat, EMCY, an answer to an SDO request, an NMT command."""
    can_id, _, is_extended, is_remote = frame
    if can_id == Cob.NMT:
        return not is_extended and not is_remote
    base, node_id = can_id & ~HIGHEST_NODE_ID, can_id & HIGHEST_NODE_ID
    return not is_extended and not is_remote and node_id > 0 and base in _BASES


_TOLD = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}
_BASES = (Cob.HEARTBEAT, Cob.EMERGENCY, Cob.SDO_TO_CLIENT)


class NodeTable:
    """The nodes that were heard, at most 127."""

    def __init__(self, book: Book) -> None:
        self._book = book
        self._nodes: dict[int, _Node] = {}
        self.emergencies: deque[HeardEmergency] = deque(maxlen=EMERGENCIES)

    def take(self, frame: Frame, wall_ns: int) -> None:
        """Note what `frame` says of its node. Other frames, and malformed ones, say nothing."""
        if not is_of_node(frame):
            return
        base, node_id = frame.can_id & ~HIGHEST_NODE_ID, frame.can_id & HIGHEST_NODE_ID
        if frame.can_id == Cob.NMT:
            self._command(frame.data)
            return
        node = self._nodes.setdefault(node_id, _Node())
        if base == Cob.HEARTBEAT and len(frame.data) == 1:
            _heartbeat(node, frame.data[0] & 0x7F, wall_ns)
        elif base == Cob.EMERGENCY:
            self._emergency(node, node_id, frame.data, wall_ns)
        elif base == Cob.SDO_TO_CLIENT and len(frame.data) == _SDO_LENGTH and frame.data[0] == _EXPEDITED_UPLOAD:
            index, subindex = int.from_bytes(frame.data[1:3], "little"), frame.data[3]
            if index == IDENTITY and subindex in (1, 2):
                node.identity[subindex] = int.from_bytes(frame.data[4:], "little")

    def now(self) -> Sequence[NodeNow]:
        """All nodes by node-ID."""
        return [self._now(node_id, node) for node_id, node in sorted(self._nodes.items())]

    def _command(self, data: bytes) -> None:
        """Those that were heard are told; of all, only those that a data sheet describes: a master obeys nobody."""
        try:
            command, told = parse_nmt(data)
        except FrameError:
            return
        state, slaves = _TOLD.get(command), self._book.dictionaries
        for node_id, node in self._nodes.items():
            if state is not None and (told == node_id or (told == 0 and (not slaves or node_id in slaves))):
                node.state, node.is_told = state, True

    def _emergency(self, node: _Node, node_id: int, data: bytes, wall_ns: int) -> None:
        try:
            message = Emergency.parse(data)
        except FrameError:
            return
        node.code, node.register = message.code, message.register
        node.emergencies += 1
        self.emergencies.append(HeardEmergency(wall_ns, node_id, data))

    def _now(self, node_id: int, node: _Node) -> NodeNow:
        heard = bool(node.identity)
        vendor, product = (node.identity.get(sub) if heard else self._expected(node_id, sub) for sub in (1, 2))
        period_ns = None if node.period_ns is None else round(node.period_ns)
        return NodeNow(
            *(node_id, self._book.name(node_id), node.state, node.heartbeat_wall_ns, period_ns, node.boots),
            *(node.register, node.code, node.emergencies, (vendor, product), heard, node.is_told),
        )

    def _expected(self, node_id: int, subindex: int) -> int | None:
        dictionary = self._book.dictionaries.get(node_id)
        variable = None if dictionary is None else variable_at(dictionary, IDENTITY, subindex)
        default = None if variable is None else variable.default
        return default if isinstance(default, int) else None


def _heartbeat(node: _Node, state: int, wall_ns: int) -> None:
    if state == NmtState.BOOT_UP:
        node.boots += 1
        node.period_ns = None
        node.register, node.code = None, None
    elif node.heartbeat_wall_ns is not None and node.state != NmtState.BOOT_UP:
        interval_ns = wall_ns - node.heartbeat_wall_ns
        node.period_ns = (
            interval_ns if node.period_ns is None else node.period_ns + _ALPHA * (interval_ns - node.period_ns)
        )
    node.state, node.heartbeat_wall_ns, node.is_told = state, wall_ns, False
