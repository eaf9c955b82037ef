"""The inputs of a cycle: which TPDOs are still awaited, and the codes in those that have come.

The meaning of codes, and the reaction to missing inputs, never enter.
"""

from collections.abc import Sequence

from canarm_protocol.canopen.frames import HIGHEST_NODE_ID
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.wiring import CardNode, InputSlot


class AwaitedInputs:
    """Inputs from the cyclic TPDOs of `nodes`; `codes` has the last code of each slot."""

    def __init__(self, nodes: Sequence[CardNode], slots: Sequence[InputSlot]) -> None:
        self.layouts = {layout.cob_id: layout for node in nodes for layout in node.tpdos}
        """Layouts by COB-ID."""
        self.codes = [0] * len(slots)
        self.awaited = set(self.layouts)
        """COB-IDs of TPDOs that have not come in this cycle."""
        self._places = {
            cob_id: [(place, slot.codec.shift) for place, slot in enumerate(slots) if slot.cob_id == cob_id]
            for cob_id in self.layouts
        }
        self._joints = {
            cob_id: frozenset(slot.joint for slot in slots if slot.cob_id == cob_id) for cob_id in self.layouts
        }
        self._lowest = {slot.cob_id: slot.codec.lowest_value for slot in slots}

    def open_cycle(self) -> None:
        """From now on everything is awaited."""
        self.awaited = set(self.layouts)

    def take(self, layout: PdoLayout, data: bytes) -> bool:
        """Take the data of a TPDO. False if they are too short, or no code of the card's converter."""
        if len(data) != layout.size:
            if len(data) < layout.size:
                return False
            data = data[: layout.size]
        values = layout.unpack(data)
        if min(values) < self._lowest[layout.cob_id]:
            return False
        for (place, shift), value in zip(self._places[layout.cob_id], values, strict=True):
            self.codes[place] = value >> shift
        return True

    @property
    def is_part_silent(self) -> bool:
        """Whether a card has sent nothing in this cycle, while another one has: then the bus is sound."""
        here = {cob_id & HIGHEST_NODE_ID for cob_id in self.layouts if cob_id not in self.awaited}
        return bool(here) and any(cob_id & HIGHEST_NODE_ID not in here for cob_id in self.awaited)

    def unseen_joints(self) -> frozenset[int]:
        """The joints of which something is still awaited in this cycle."""
        return frozenset(joint for cob_id in self.awaited for joint in self._joints[cob_id])

    def describe_awaited(self) -> str:
        """The TPDOs that have not come in this cycle, in words."""
        late = [f"TPDO 0x{cob_id:03X} of node 0x{cob_id & HIGHEST_NODE_ID:02X}" for cob_id in sorted(self.awaited)]
        return " and ".join(late)
