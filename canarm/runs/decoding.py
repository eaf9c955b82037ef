"""Frames of the robot's bus in words: which message of which card, and what it carries."""

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID, Cob, Emergency, Frame, NmtCommand, NmtState
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.errors import FrameError

_TPDOS = (0x180, 0x280, 0x380, 0x480)
"""Of the predefined connection set (CiA 301, 7.3.3)."""
_COB_ID_OF_TPDO = range(0x1800, 0x1A00)
_DOWNLOADS_OF_4_BYTES = 0x23
_SDO_LENGTH = 8


class Decoder:
    """The messages of a cell's bus. Without a cell, only those that every CANopen bus has."""

    def __init__(self, cell: Cell | None) -> None:
        nodes = () if cell is None else card_nodes(cell)
        self._names = {node.card.node_id: node.card.name for node in nodes}
        self._pdos: dict[int, tuple[str, PdoLayout]] = {}
        for node in nodes:
            for layout in (*node.rpdos, *node.tpdos):
                self._pdos[layout.cob_id] = node.card.name, layout
        if cell is not None:
            self._names[cell.bus.controller_node_id] = "controller"
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
        is_sdo = node_id in self._names and len(data) == _SDO_LENGTH and data[0] == _DOWNLOADS_OF_4_BYTES
        if is_sdo and int.from_bytes(data[1:3], "little") in _COB_ID_OF_TPDO and data[3] == 1:
            self._of_cards.add(int.from_bytes(data[4:8], "little") & 0x7FF)
        return can_id in self._of_cards

    def text(self, frame: Frame) -> str:
        """The frame as candump shows it, and what it means."""
        can_id, data, is_extended, is_remote = frame
        raw = f"{can_id:08X}" if is_extended else f"{can_id:03X}"
        raw += f"#{'R' if is_remote else data.hex().upper()}"
        return f"{raw} ({self._meaning(frame)})"

    def _meaning(self, frame: Frame) -> str:
        can_id, data, is_extended, is_remote = frame
        if frame.is_error:
            return "error frame"
        if is_extended or is_remote:
            return "no message of CANopen"
        if can_id in self._pdos:
            return self._pdo(*self._pdos[can_id], data)
        base, node_id = can_id & ~HIGHEST_NODE_ID, can_id & HIGHEST_NODE_ID
        who = self._name(node_id)
        try:
            if can_id == Cob.NMT and len(data) == 2:
                to = self._name(data[1]) if data[1] else "all nodes"
                return f"NMT {NmtCommand(data[0]).name} to {to}"
            if can_id == Cob.SYNC:
                return "SYNC"
            if can_id == Cob.TIME:
                return "TIME"
            if base == Cob.EMERGENCY:
                return f"EMCY 0x{Emergency.parse(data).code:04X} of {who}"
            if base == Cob.HEARTBEAT and len(data) == 1:
                return f"heartbeat of {who}: {NmtState(data[0]).name}"
        except (FrameError, ValueError):
            return f"malformed, of {who}"
        if base in (Cob.SDO_TO_CLIENT, Cob.SDO_TO_SERVER) and len(data) == _SDO_LENGTH:
            way = "of" if base == Cob.SDO_TO_CLIENT else "to"
            return f"SDO {way} {who}: 0x{int.from_bytes(data[1:3], 'little'):04X}:{data[3]:02X}"
        return f"of {who}" if node_id in self._names else "unknown"

    def _name(self, node_id: int) -> str:
        return self._names.get(node_id, f"node 0x{node_id:02X}")

    def _pdo(self, name: str, layout: PdoLayout, data: bytes) -> str:
        what = f"{layout.kind.upper()}{layout.number} of {name}"
        if len(data) != layout.size:
            return f"{what}, {len(data)} bytes instead of {layout.size}"
        values = zip(layout.objects, layout.unpack(data), strict=True)
        return f"{what}: " + ", ".join(f"0x{each.index:04X}:{each.subindex:02X}={value}" for each, value in values)
