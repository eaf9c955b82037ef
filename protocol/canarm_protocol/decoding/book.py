"""What is known of a bus: names of nodes, their dictionaries, messages and their signals, SDO channels.

Filled from a cell, from EDS files and from DBC files (`of_cell`, `eds_files`, `dbc_files`); who fills it twice
overrides.
"""

from collections.abc import Callable

from ..canopen.dictionary import Dictionary
from ..canopen.frames import HIGHEST_NODE_ID, Cob
from .meaning import KnownMessage
from .sdo_texts import SdoWay

Describe = Callable[["Book", int], None]
"""Enters what is known of a node, by its node-ID."""
_PDOS = range(0x180, 0x580)
"""COB-IDs of PDOs in the predefined connection set (CiA 301, 7.3.3)."""


class Book:
    """What is known; empty at first. `describe_others` is asked once for each node that nobody has described."""

    def __init__(self) -> None:
        self.names: dict[int, str] = {}
        self.dictionaries: dict[int, Dictionary] = {}
        self.messages: dict[tuple[int, bool], KnownMessage] = {}
        """By identifier, and whether that has 29 bits."""
        self.channels: dict[int, SdoWay] = {}
        """SDO channels besides those of the predefined connection set, by COB-ID."""
        self.describe_others: Describe | None = None
        self._asked: set[int] = set()

    def name(self, node_id: int) -> str:
        """The node's name, or its node-ID in words."""
        return self.names.get(node_id) or f"node 0x{node_id:02X}"

    def dictionary(self, node_id: int) -> Dictionary | None:
        """The node's object dictionary, if it is known."""
        self._ask(node_id)
        return self.dictionaries.get(node_id)

    def message(self, can_id: int, is_extended: bool) -> KnownMessage | None:
        """Who has described the message with that identifier."""
        if not is_extended and can_id in _PDOS:
            self._ask(can_id & HIGHEST_NODE_ID)
        return self.messages.get((can_id, is_extended))

    def channel(self, can_id: int) -> SdoWay | None:
        """The SDO channel that an 11-bit identifier belongs to."""
        if can_id in self.channels:
            return self.channels[can_id]
        base, node_id = can_id & ~HIGHEST_NODE_ID, can_id & HIGHEST_NODE_ID
        if node_id and base in (Cob.SDO_TO_CLIENT, Cob.SDO_TO_SERVER):
            return SdoWay(node_id, base == Cob.SDO_TO_SERVER)
        return None

    def _ask(self, node_id: int) -> None:
        if self.describe_others is None or node_id in self._asked or not 0 < node_id <= HIGHEST_NODE_ID:
            return
        self._asked.add(node_id)
        if node_id not in self.dictionaries:
            self.describe_others(self, node_id)
