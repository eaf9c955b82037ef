"""How the process data of a cell's cards map to the joints: EDS mapping and cell wiring, joined once.

Controller, recorder and dashboard all read frames through this; nobody writes an offset or a COB-ID by hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from .cell import Card, Cell, Joint, Quantity
from .dictionary import (
    ANALOGUE_INPUT,
    ANALOGUE_OUTPUT,
    CODE_SHIFT,
    DIGITAL_OUTPUT,
    Dictionary,
    default_value,
    load_dictionary,
)
from .pdo import Kind, MappedObject, PdoLayout, read_layouts

BITS_A_JOINT = 2
"""Direction bits of one joint in the latch; channel n sits at bits 2n-2 and 2n-1."""
FULL_SCALE_CODE = 255


@dataclass(frozen=True)
class CardNode:
    """A card of the cell as a node: its dictionary and the PDOs that carry its wired channels."""

    card: Card
    dictionary: Dictionary
    rpdos: tuple[PdoLayout, ...]
    tpdos: tuple[PdoLayout, ...]


@dataclass(frozen=True, slots=True)
class InputSlot:
    """Where one measured quantity arrives: node, frame, position of the value in it, joint (index in `cell.joints`)."""

    node_id: int
    cob_id: int
    position: int
    quantity: Quantity
    joint: int


def card_nodes(cell: Cell) -> tuple[CardNode, ...]:
    """All cards of the cell with the PDOs that the controller sets up: the EDS's mapping less the channels not wired."""
    return tuple(_card_node(card) for card in cell.card)


def _card_node(card: Card) -> CardNode:
    dictionary = load_dictionary(card.model, card.node_id)
    wired = {channel.number for channel in card.channel}

    def is_wired(mapped: MappedObject) -> bool:
        return mapped.index == DIGITAL_OUTPUT or mapped.subindex in wired

    def layouts(kind: Kind) -> tuple[PdoLayout, ...]:
        found = read_layouts(dictionary, kind, lambda index, subindex: default_value(dictionary, index, subindex))
        return tuple(layout for layout in (each.restricted_to(is_wired) for each in found) if layout.objects)

    return CardNode(card, dictionary, layouts("rpdo"), layouts("tpdo"))


def input_slots(cell: Cell, nodes: Sequence[CardNode]) -> tuple[InputSlot, ...]:
    """Every measured quantity of the cell, in the order in which the frames carry them."""
    slots = []
    for node in nodes:
        channels = {channel.number: channel for channel in node.card.channel}
        for layout in node.tpdos:
            for position, mapped in enumerate(layout.objects):
                if mapped.index == ANALOGUE_INPUT:
                    channel = channels[mapped.subindex]
                    joint = cell.joint_names.index(channel.joint)
                    slots.append(InputSlot(node.card.node_id, layout.cob_id, position, Quantity(channel.quantity), joint))
    return tuple(slots)


class OutputFrames:
    """Packs DAC codes and direction bits of all joints into the cards' RPDOs."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        self._frames: list[tuple[PdoLayout, tuple[tuple[int, int], ...], bool]] = []
        for node in nodes:
            joints = {channel.number: cell.joint_names.index(channel.joint) for channel in node.card.channel}
            for layout in node.rpdos:
                if layout.objects[0].index == ANALOGUE_OUTPUT:
                    sources = tuple((joints[mapped.subindex], CODE_SHIFT) for mapped in layout.objects)
                    self._frames.append((layout, sources, False))
                else:
                    bits = tuple((joint, BITS_A_JOINT * (number - 1)) for number, joint in joints.items())
                    self._frames.append((layout, bits, True))

    def pack(self, codes: Sequence[int], directions: Sequence[int]) -> list[tuple[int, bytes]]:
        """COB-ID and data of each RPDO, from 8-bit DAC `codes` and 2-bit `directions`, one a joint."""
        packed = []
        for layout, sources, is_latch in self._frames:
            if is_latch:
                value = 0
                for joint, shift in sources:
                    value |= directions[joint] << shift
                packed.append((layout.cob_id, layout.pack(value)))
            else:
                packed.append((layout.cob_id, layout.pack(*[codes[joint] << shift for joint, shift in sources])))
        return packed


@dataclass(frozen=True, slots=True)
class SensorScale:
    """Turns a sensor's 8-bit code into its physical quantity: value = (code - zero) x step."""

    zero: float
    step: float

    def __call__(self, code: float) -> float:
        return (code - self.zero) * self.step


def sensor_scale(joint: Joint, quantity: Quantity) -> SensorScale:
    """Nominal scale of a sensor of `joint`: rad a code (potentiometer), rad/s a code (tachometer), A a code (current)."""
    sensors = joint.sensors
    volts = sensors.full_scale_v / FULL_SCALE_CODE
    if quantity is Quantity.POTENTIOMETER:
        radians = sensors.potentiometer_range_deg * DEGREE
        return SensorScale(sensors.potentiometer_zero_v / volts, radians / FULL_SCALE_CODE)
    if quantity is Quantity.TACHOMETER:
        span = sensors.full_scale_v - sensors.tachometer_zero_v
        return SensorScale(sensors.tachometer_zero_v / volts, sensors.tachometer_full_scale_rad_s / span * volts)
    if quantity is Quantity.CURRENT_SENSE:
        return SensorScale(0.0, sensors.current_sense_full_scale_a / FULL_SCALE_CODE)
    raise ValueError(f"{quantity} is no sensor; sensors are potentiometer, tachometer and current_sense")


DEGREE = 0.017453292519943295
"""One degree in rad."""
