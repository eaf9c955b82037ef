"""The log pages of the Apple II's memory as a controller on the bus fills them, put together from the cards' inputs.

The controller keeps the image itself and writes it down at the end. What is on the bus tells of every cycle: which one
by SYNC's counter, and the bytes by the inputs that follow. The torque table is not on the bus.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand
from canarm_protocol.cell.model import Cell, Quantity
from canarm_protocol.cell.wiring import InputSlot, card_nodes, input_slots

from .cycle_count import CycleCount

SAMPLES = 4096
TABLE_BASE, LOG_BASE = 0x2000, 0x4000
BANK_JOINTS = 2
BANK_BYTES = 3 * BANK_JOINTS * SAMPLES
"""Torque table, positions and velocities of two joints, from $2000 to $7FFF."""
_PAGES = {Quantity.POSITION: 0, Quantity.VELOCITY: 1}


def address_of(joint: int, quantity: Quantity | None, sample: int = 0) -> int:
    """The address of a sample's byte in the joint's bank: position pages from $4000, velocity pages from $6000; without
    a quantity, the torque table's from $2000.
    """
    if quantity is None:
        return TABLE_BASE + joint % BANK_JOINTS * SAMPLES + sample % SAMPLES
    page = _PAGES[quantity] * BANK_JOINTS + joint % BANK_JOINTS
    return LOG_BASE + page * SAMPLES + sample % SAMPLES


@dataclass(frozen=True, slots=True, eq=False)
class PageNow:
    """One page: what it holds, and which of its bytes are known. Both (4096,). The torque table has no quantity."""

    joint: int
    quantity: Quantity | None
    data: NDArray[np.uint8]
    is_known: NDArray[np.bool_]

    @property
    def title(self) -> str:
        """What its bytes are."""
        return "torque" if self.quantity is None else self.quantity.value

    @property
    def address(self) -> int:
        """Of its first byte."""
        return address_of(self.joint, self.quantity)


class MemoryMirror:
    """The pages of `cell`. `receive` every frame of the robot's bus, in order.

    With an `image`, as a run has left it, all pages are known from the beginning, the torque table's too.
    """

    def __init__(self, cell: Cell, image: bytes | None = None) -> None:
        slots = [slot for slot in input_slots(cell, card_nodes(cell)) if slot.quantity in _PAGES]
        self._by_cob: dict[int, list[InputSlot]] = {}
        for slot in slots:
            self._by_cob.setdefault(slot.cob_id, []).append(slot)
        self._layouts = {layout.cob_id: layout for node in card_nodes(cell) for layout in node.tpdos}
        keys: list[tuple[int, Quantity | None]] = [*{(slot.joint, slot.quantity) for slot in slots}]
        self._image = image
        if image is not None:
            keys += [(joint, None) for joint in range(len(cell.joints))]
        keys.sort(key=lambda key: (key[0], -1 if key[1] is None else _PAGES[key[1]]))
        self.pages = [PageNow(*key, np.zeros(SAMPLES, np.uint8), np.zeros(SAMPLES, np.bool_)) for key in keys]
        self._page_of = {(page.joint, page.quantity): page for page in self.pages}
        self._count = CycleCount()
        self.forget()

    @property
    def cycle(self) -> int | None:
        """The cycle of the last SYNC; None until it is known."""
        return self._count.cycle

    def forget(self) -> None:
        """What comes from now on begins anew; an image stays what it is."""
        self._count.forget()
        for page in self.pages:
            page.is_known[:] = self._image is not None
            if self._image is not None:
                first = page.joint // BANK_JOINTS * BANK_BYTES + page.address - TABLE_BASE
                page.data[:] = np.frombuffer(self._image, np.uint8, SAMPLES, first)

    def anchor(self, cycle: int | None) -> None:
        """Telemetry says that the present cycle is about this one: the next SYNC's counter tells exactly which."""
        self._count.anchor(cycle)

    def receive(self, frames: Iterable[tuple[int, Frame]]) -> None:
        """Take frames of the bus."""
        by_cob = self._by_cob
        for _, (can_id, data, is_extended, is_remote) in frames:
            if is_extended or is_remote:
                continue
            if can_id in by_cob:
                self._take(can_id, data)
            elif can_id == Cob.SYNC:
                self._count.sync(data)
            elif can_id == Cob.NMT and data[:1] == bytes((NmtCommand.START,)):
                self._count.start()

    def _take(self, can_id: int, data: bytes) -> None:
        layout = self._layouts[can_id]
        if self.cycle is None or self.cycle < 0 or len(data) < layout.size:
            return
        values = layout.unpack(data[: layout.size])
        place = self.cycle % SAMPLES
        for slot in self._by_cob[can_id]:
            page, codec = self._page_of[slot.joint, slot.quantity], slot.codec
            code = codec.code(values[slot.position])
            page.data[place] = (code if codec.is_signed else code >> codec.bits - 8) & 0xFF
            page.is_known[place] = True
