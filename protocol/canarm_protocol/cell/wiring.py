"""How the process data of a cell's cards map to the joints: EDS mapping and cell wiring, joined once.

Controller, recorder and dashboard all read frames through this; nobody writes an offset or a COB-ID by hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from ..canopen.dictionary import (
    ANALOGUE_INPUT,
    ANALOGUE_OUTPUT,
    CODE_SHIFT,
    DIGITAL_OUTPUT,
    Dictionary,
    default_value,
    load_dictionary,
)
from ..canopen.pdo import Kind, MappedObject, PdoLayout, read_layouts
from .model import Card, Cell, Joint, Quantity
from .sensors import SENSOR_KINDS, SensorScale

BITS_A_JOINT = 2
"""Direction bits of one joint in the latch; channel n sits at bits 2n-2 and 2n-1."""
FULL_SCALE_CODE = 255


class DirectionBits(IntEnum):
    """What two bits of the latch do to a joint's bridge; counter-clockwise is towards positive angles."""

    OFF = 0b00
    CLOCKWISE = 0b01
    COUNTER_CLOCKWISE = 0b10
    ILLEGAL = 0b11


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
    """All cards of the cell with the PDOs that the controller sets up: the EDS's mapping less channels not wired."""
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
                    joint, quantity = cell.far_joint(node.card, channel), SENSOR_KINDS[channel.leaf].quantity
                    slots.append(InputSlot(node.card.node_id, layout.cob_id, position, quantity, joint))
    return tuple(slots)


class OutputFrames:
    """Packs DAC codes and direction bits of all joints into the cards' RPDOs."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        self._frames: list[tuple[PdoLayout, tuple[tuple[int, int], ...], bool]] = []
        for node in nodes:
            joints = {channel.number: cell.far_joint(node.card, channel) for channel in node.card.channel}
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


def sensor_scale(joint: Joint, quantity: Quantity, bits: int = 8) -> SensorScale:
    """Nominal scale of the sensor of `joint` that measures `quantity`: rad, rad/s or A a code of `bits` bits.

    Raises `ValueError` if the joint has none.
    """
    sensor = joint.sensor(quantity)
    if sensor is None:
        raise ValueError(f"joint {joint.name!r} has no sensor that measures {quantity}")
    return sensor.scale(bits)


def current_scale(joint: Joint) -> SensorScale:
    """Nominal scale of the DAC channel that drives `joint`: A of motor current a code, without sign."""
    return joint.drive.current_scale()


@dataclass(frozen=True, slots=True)
class WiredSignal:
    """One joint's command or sensor in a PDO: joint (index in `cell.joints`), its bits, value = raw x factor + offset.

    `leaf` is a `Command`, or the kind of a sensor with what it measures in `quantity`.

    Values are in rad, rad/s or A, with raw from 0 to `highest_raw`; a direction is a `DirectionBits`.
    """

    joint: int
    leaf: str
    quantity: Quantity | None
    start_bit: int
    bit_length: int
    is_signed: bool
    factor: float
    offset: float
    highest_raw: int


def wired_signals(cell: Cell, node: CardNode, layout: PdoLayout) -> tuple[WiredSignal, ...]:
    """What `layout`, a PDO of `node`, carries, in the order of its bits."""
    signals = []
    for mapped, start_bit in zip(layout.objects, layout.bit_offsets, strict=True):
        for channel in node.card.channel:
            joint, leaf = cell.far_joint(node.card, channel), channel.leaf
            if mapped.index == DIGITAL_OUTPUT:
                bit = start_bit + BITS_A_JOINT * (channel.number - 1)
                signals.append(WiredSignal(joint, leaf, None, bit, BITS_A_JOINT, False, 1.0, 0.0, max(DirectionBits)))
            elif mapped.subindex == channel.number:
                kind = SENSOR_KINDS.get(leaf)
                quantity = None if kind is None else kind.quantity
                joint_itself = cell.joints[joint]
                scale = current_scale(joint_itself) if quantity is None else sensor_scale(joint_itself, quantity)
                factor, highest_raw = scale.step / (1 << CODE_SHIFT), FULL_SCALE_CODE << CODE_SHIFT
                signals.append(
                    WiredSignal(joint, leaf, quantity, start_bit, mapped.bits, True, factor, scale(0), highest_raw)
                )
    return tuple(sorted(signals, key=lambda signal: signal.start_bit))
