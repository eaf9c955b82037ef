"""A cell as the bus description that `dcfgen` of Lely's dcf-tools reads, and ros2_canopen with it (`bus.yml`).

`dcfgen` takes the values of an EDS or DCF for what a device has already and downloads only what differs. So the
description names the EDS files, and what a master sets is said here.
"""

from collections.abc import Iterator

from ..canopen.pdo import DISABLED, PdoLayout
from .configuration import card_settings, final_values
from .model import Cell
from .wiring import CardNode

RESERVED = ("master", "options")
"""Names at the top of the file that are no slave's."""
FIRST_PROFILE_OBJECT = 0x6000


def dcfgen_text(cell: Cell, nodes: tuple[CardNode, ...]) -> str:
    """The description: the master with SYNC and heartbeat, and every card with the PDOs of its wired channels."""
    return "\n".join([*_master(cell), *(line for node in nodes for line in _slave(cell, node))]) + "\n"


def _master(cell: Cell) -> Iterator[str]:
    bus = cell.bus
    yield f"# {cell.name} for dcfgen (Lely's dcf-tools): dcfgen -r bus.yml"
    yield "options:"
    yield f"  heartbeat_multiplier: {bus.heartbeat_timeout_ms / bus.heartbeat_ms}"
    yield "master:"
    yield f"  node_id: {bus.controller_node_id}"
    yield f"  baudrate: {bus.bitrate // 1000}"
    yield f"  sync_period: {bus.cycle_us}"
    yield f"  heartbeat_producer: {bus.heartbeat_ms}"


def _slave(cell: Cell, node: CardNode) -> Iterator[str]:
    card = node.card
    yield f"{card.name}_card:" if card.name in RESERVED else f"{card.name}:"
    yield f"  dcf: {card.model}.eds"
    yield f"  node_id: 0x{card.node_id:02X}"
    yield "  heartbeat_consumer: true"
    yield f"  heartbeat_producer: {cell.bus.heartbeat_ms}"
    pdos = {layout.number: tuple(_disabled(layout)) for layout in node.unused}
    pdos |= {layout.number: tuple(_enabled(layout)) for layout in (*node.rpdos, *node.tpdos)}
    yield "  rpdo:" if card.kind.is_output else "  tpdo:"
    for number in sorted(pdos):
        yield f"    {number}:"
        yield from pdos[number]
    application = {
        key: value
        for key, value in final_values(card_settings(node, cell.bus)).items()
        if key[0] >= FIRST_PROFILE_OBJECT
    }
    if application:
        yield "  sdo:"
    for (index, subindex), value in application.items():
        yield f"    - {{index: 0x{index:04X}, sub_index: {subindex}, value: {value}}}"


def _disabled(layout: PdoLayout) -> Iterator[str]:
    yield f"      cob_id: 0x{DISABLED | layout.cob_id:08X}"


def _enabled(layout: PdoLayout) -> Iterator[str]:
    yield f"      cob_id: 0x{layout.cob_id:03X}"
    yield f"      transmission: {layout.transmission_type}"
    yield "      mapping:"
    for mapped in layout.objects:
        yield f"        - {{index: 0x{mapped.index:04X}, sub_index: {mapped.subindex}}}"
