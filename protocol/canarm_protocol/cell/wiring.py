"""How the process data of a cell's cards map to its joints: EDS mapping and wiring, combined in one place.

Controller, recorder and dashboard all read frames through this; no offset or COB-ID is written by hand.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ..canopen.dictionary import Dictionary, default_value, load_dictionary
from ..canopen.pdo import (
    COMMUNICATION,
    DISABLED,
    MOST_BYTES,
    Kind,
    PdoLayout,
    mapped_variable,
    pdo_numbers,
    read_layout,
)
from ..cards import Codec
from ..cards.sc300 import DirectionBits as DirectionBits
from ..cards.sc300 import HandBits as HandBits
from .model import Card, Cell, Command, Quantity
from .sensing import channel_scale
from .sensors import SENSOR_KINDS, SensorScale


@dataclass(frozen=True)
class CardNode:
    """A card of the cell as a node: its dictionary and the PDOs that carry its wired channels."""

    card: Card
    dictionary: Dictionary
    rpdos: tuple[PdoLayout, ...]
    tpdos: tuple[PdoLayout, ...]
    unused: tuple[PdoLayout, ...] = ()
    """PDOs that are enabled by default and carry no wired channel."""
    keeps_outputs: bool = False
    """Whether wired outputs keep their last values when the controller is lost, instead of their error values."""


@dataclass(frozen=True, slots=True)
class InputSlot:
    """Where one measured quantity arrives: node, frame, the value's position in it, joint (index in `cell.joints`)."""

    node_id: int
    cob_id: int
    position: int
    quantity: Quantity
    joint: int
    codec: Codec
    """Takes the code out of the value."""


def card_nodes(cell: Cell) -> tuple[CardNode, ...]:
    """All cards of the cell with the PDOs that the controller sets up."""
    holding = {robot.name for robot in cell.robot if robot.when_lost == "hold"}
    return tuple(_card_node(card, card.robot in holding) for card in cell.card)


def _card_node(card: Card, keeps_outputs: bool) -> CardNode:
    dictionary = load_dictionary(card.model, card.node_id)
    kind: Kind = "rpdo" if card.kind.is_output else "tpdo"
    enabled: list[PdoLayout] = []
    disabled: list[PdoLayout] = []
    for number in pdo_numbers(dictionary, kind):
        layout = read_layout(dictionary, kind, number, lambda *where: default_value(dictionary, *where))
        is_disabled = default_value(dictionary, COMMUNICATION[kind] + number - 1, 1) & DISABLED
        (disabled if is_disabled else enabled).append(layout)
    used = _carriers(card, dictionary, enabled, disabled)
    numbers = {layout.number for layout in used}
    unused = tuple(layout for layout in enabled if layout.number not in numbers)
    rpdos, tpdos = (used, ()) if card.kind.is_output else ((), used)
    return CardNode(card, dictionary, rpdos, tpdos, unused, keeps_outputs)


def _carriers(
    card: Card, dictionary: Dictionary, enabled: Sequence[PdoLayout], disabled: Sequence[PdoLayout]
) -> tuple[PdoLayout, ...]:
    """The EDS's mapping without the unwired channels; if it lacks objects of wired channels, a mapping of those.

    Such a mapping fills the PDOs that are enabled by default first, then the others.
    """
    places = [card.kind.place(card, channel.number) for channel in card.channel]
    wanted = sorted({(place.index, place.subindex) for place in places})
    restricted = [layout.restricted_to(lambda each: (each.index, each.subindex) in wanted) for layout in enabled]
    if {(each.index, each.subindex) for layout in restricted for each in layout.objects} == set(wanted):
        return tuple(layout for layout in restricted if layout.objects)
    objects = [mapped_variable(dictionary, index, subindex) for index, subindex in wanted]
    carriers = []
    for layout in (*enabled, *disabled):
        room, taken = MOST_BYTES * 8, []
        while objects and objects[0].bits <= room:
            taken.append(objects.pop(0))
            room -= taken[-1].bits
        if taken:
            carriers.append(layout.mapping(taken))
    return tuple(carriers)


def input_slots(cell: Cell, nodes: Sequence[CardNode]) -> tuple[InputSlot, ...]:
    """Every measured quantity of the cell, in the order in which the frames carry them."""
    slots = []
    for node in nodes:
        card = node.card
        channels = {_object_of(card, channel.number): channel for channel in card.channel}
        for layout in node.tpdos:
            for position, mapped in enumerate(layout.objects):
                channel = channels[mapped.index, mapped.subindex]
                joint, quantity = cell.far_joint(card, channel), SENSOR_KINDS[channel.leaf].quantity
                slots.append(InputSlot(card.node_id, layout.cob_id, position, quantity, joint, card.codec))
    return tuple(slots)


def _object_of(card: Card, number: int) -> tuple[int, int]:
    place = card.kind.place(card, number)
    return place.index, place.subindex


def command_codec(cell: Cell, joint: int) -> Codec:
    """The codec of the DAC channel that drives a joint (index in `cell.joints`). Raises `LookupError` without one."""
    for card in cell.card:
        for channel in card.channel:
            if channel.leaf == Command.CURRENT and cell.far_joint(card, channel) == joint:
                return card.codec
    raise LookupError(f"{cell.joint_names[joint]}.{Command.CURRENT} is wired to no card of cell {cell.name!r}")


def command_scale(cell: Cell, joint: int) -> SensorScale:
    """Nominal scale of the DAC channel that drives a joint: magnitude of the motor current in A per code."""
    return cell.joints[joint].drive.current_scale(command_codec(cell, joint).bits)


def bridge_directions(cell: Cell, joint: int) -> tuple[DirectionBits, DirectionBits]:
    """What the bridge of a joint (index in `cell.joints`) is told for a negative, and for a positive joint torque."""
    ways = DirectionBits.CLOCKWISE, DirectionBits.COUNTER_CLOCKWISE
    return ways if cell.joints[joint].motor.direction > 0 else (ways[1], ways[0])


@dataclass(frozen=True, slots=True)
class WiredSignal:
    """A command or sensor of one joint (index in `cell.joints`) in a PDO: its bits, and value = raw x factor + offset.

    `leaf` is a `Command`, or the kind of a sensor that measures `quantity`. Values are in rad, rad/s or A, raw from
    `lowest_raw` to `highest_raw`; a direction is a `DirectionBits`, a grip `HandBits`.
    """

    joint: int
    leaf: str
    quantity: Quantity | None
    start_bit: int
    bit_length: int
    is_signed: bool
    factor: float
    offset: float
    lowest_raw: int
    highest_raw: int


def wired_signals(cell: Cell, node: CardNode, layout: PdoLayout) -> tuple[WiredSignal, ...]:
    """What `layout`, a PDO of `node`, carries, in the order of its bits."""
    card, signals = node.card, []
    codec = card.codec
    for mapped, start_bit in zip(layout.objects, layout.bit_offsets, strict=True):
        for channel in card.channel:
            joint, leaf = cell.far_joint(card, channel), channel.leaf
            place = card.kind.place(card, channel.number)
            if (place.index, place.subindex) != (mapped.index, mapped.subindex):
                continue
            bit, kind = start_bit + place.start_bit, SENSOR_KINDS.get(leaf)
            if leaf in (Command.DIRECTION, Command.GRIP):
                signals.append(WiredSignal(joint, leaf, None, bit, codec.bits, False, 1.0, 0.0, 0, codec.full_scale))
                continue
            quantity = None if kind is None else kind.quantity
            scale = command_scale(cell, joint) if quantity is None else channel_scale(cell, card, channel)
            factor, raw = scale.step / (1 << codec.shift), (codec.lowest_value, codec.value(codec.full_scale))
            signed = mapped.is_signed
            signals.append(WiredSignal(joint, leaf, quantity, bit, mapped.bits, signed, factor, scale(0), *raw))
    return tuple(sorted(signals, key=lambda signal: signal.start_bit))
