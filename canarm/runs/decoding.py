"""Frames of the robot's bus as a replay sees them: whose they are, and what they mean in words."""

from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.decoding import Book, raw_text
from canarm_protocol.decoding.decoder import Decoder as Meanings
from canarm_protocol.decoding.of_cell import robot_book

_TPDOS = (0x180, 0x280, 0x380, 0x480)
"""Of the predefined connection set (CiA 301, 7.3.3)."""
_COB_ID_OF_TPDO = range(0x1800, 0x1A00)
_DOWNLOADS_OF_4_BYTES = 0x23
_SDO_LENGTH = 8


class Decoder:
    """The messages of a cell's bus. Without a cell, only those that every CANopen bus has."""

    def __init__(self, cell: Cell | None) -> None:
        nodes = () if cell is None else card_nodes(cell)
        self._meanings = Meanings(Book() if cell is None else robot_book(cell))
        self._node_ids = {node.card.node_id for node in nodes}
        sent = (Cob.EMERGENCY, *_TPDOS, Cob.SDO_TO_CLIENT, Cob.HEARTBEAT)
        self._of_cards = {base + node.card.node_id for node in nodes for base in sent}
        self._of_cards |= {layout.cob_id for node in nodes for layout in node.tpdos} | {Cob.TIME}

    def is_from_cards(self, frame: Frame) -> bool:
        """Whether the emulator has sent it: a card, or TIME of lockstep. Call it for all frames, in order.

        It follows an SDO that gives a card's TPDO another COB-ID.
        """
        can_id, data, is_extended, _ = frame
        if is_extended:
            return False
        node_id = can_id - Cob.SDO_TO_SERVER
        is_sdo = node_id in self._node_ids and len(data) == _SDO_LENGTH and data[0] == _DOWNLOADS_OF_4_BYTES
        if is_sdo and int.from_bytes(data[1:3], "little") in _COB_ID_OF_TPDO and data[3] == 1:
            self._of_cards.add(int.from_bytes(data[4:8], "little") & 0x7FF)
        return can_id in self._of_cards

    def text(self, frame: Frame) -> str:
        """The frame as candump shows it, and what it means."""
        return f"{raw_text(frame)} ({self._meanings.meaning(frame)})"
