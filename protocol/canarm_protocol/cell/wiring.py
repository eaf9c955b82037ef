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
                    joint, quantity = cell.joint_names.index(channel.joint), Quantity(channel.quantity)
                    slots.append(InputSlot(node.card.node_id, layout.cob_id, position, quantity, joint))
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
    """Turns an 8-bit code into its physical quantity: value = (code - zero) x step."""

    zero: float
    step: float

    def __call__(self, code: float) -> float:
        """The quantity at `code`."""
        return (code - self.zero) * self.step


def sensor_scale(joint: Joint, quantity: Quantity) -> SensorScale:
    """Nominal scale of a sensor of `joint`: rad, rad/s or A a code of potentiometer, tachometer or current sense."""
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


def current_scale(joint: Joint) -> SensorScale:
    """Nominal scale of the DAC channel that drives `joint`: A of motor current a code, without sign."""
    return SensorScale(0.0, joint.amplifier.max_current_a / FULL_SCALE_CODE)


@dataclass(frozen=True, slots=True)
class WiredSignal:
    """One joint's quantity in a PDO: joint (index in `cell.joints`), its bits, and value = raw x factor + offset.

    Values are in rad, rad/s or A, with raw from 0 to `highest_raw`; a direction is a `DirectionBits`.
    """

    joint: int
    quantity: Quantity
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
            joint, quantity = cell.joint_names.index(channel.joint), Quantity(channel.quantity)
            if mapped.index == DIGITAL_OUTPUT:
                bit = start_bit + BITS_A_JOINT * (channel.number - 1)
                signals.append(WiredSignal(joint, quantity, bit, BITS_A_JOINT, False, 1.0, 0.0, max(DirectionBits)))
            elif mapped.subindex == channel.number:
                is_output = mapped.index == ANALOGUE_OUTPUT
                scale = current_scale(cell.joints[joint]) if is_output else sensor_scale(cell.joints[joint], quantity)
                factor, highest_raw = scale.step / (1 << CODE_SHIFT), FULL_SCALE_CODE << CODE_SHIFT
                signals.append(
                    WiredSignal(joint, quantity, start_bit, mapped.bits, True, factor, scale(0), highest_raw)
                )
    return tuple(sorted(signals, key=lambda signal: signal.start_bit))


DEGREE = 0.017453292519943295
"""One degree in rad."""
