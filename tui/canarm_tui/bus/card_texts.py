"""The cards as the Apple II has them: a row for each wired channel, with its registers, code, volts and value."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cards import Codec
from canarm_protocol.cards.kind import RegisterByte
from canarm_protocol.cell.model import Card, Cell, Channel, Command, Quantity
from canarm_protocol.cell.sensing import channel_scale, fitted_sensor
from canarm_protocol.cell.sensors.base import AnalogueSensor
from canarm_protocol.cell.wiring import CardNode, DirectionBits, HandBits, card_nodes, command_scale

from ..texts import ABSENT, Tone, Word

SLOT_BASE, SLOT_SIZE = 0xC080, 16
"""DEVICE SELECT of slot n is $C080 + 16 n to the byte before the next slot's."""
DEGREES = 180.0 / math.pi
_UNITS = {Quantity.POSITION: ("°", DEGREES), Quantity.VELOCITY: ("rad/s", 1.0), Quantity.CURRENT: ("A", 1.0)}


@dataclass(frozen=True, slots=True)
class CardChannel:
    """A wired channel, and where its code is in a PDO."""

    card: Card
    channel: Channel
    joint: int
    signal: str
    layout: PdoLayout | None
    position: int
    start_bit: int

    @property
    def base(self) -> int:
        """The first address of the card's slot."""
        return SLOT_BASE + SLOT_SIZE * self.card.slot

    @property
    def is_output(self) -> bool:
        """Whether a drive takes it."""
        return self.card.kind.is_output

    @property
    def codec(self) -> Codec:
        """How its code sits in its object."""
        return self.card.codec

    def code(self, data: Mapping[int, bytes]) -> int | None:
        """Its code in the newest data of its PDO, by COB-ID; None where none came, or one that is too short."""
        layout = self.layout
        found = None if layout is None else data.get(layout.cob_id)
        if layout is None or found is None or len(found) < layout.size:
            return None
        value: int = layout.unpack(found[: layout.size])[self.position]
        if self.card.kind.is_output:
            return value >> self.start_bit + self.codec.shift & self.codec.full_scale
        return self.codec.code(value)

    def registers(self, code: int) -> tuple[RegisterByte, ...]:
        """The bytes at the card's addresses."""
        return self.card.kind.registers(self.card, self.channel.number, code)


def card_channels(cell: Cell) -> list[CardChannel]:
    """All wired channels, by slot and number."""
    found = [_channel(cell, node, channel) for node in card_nodes(cell) for channel in node.card.channel]
    return sorted(found, key=lambda each: (each.card.robot, each.card.slot, each.channel.number))


def _channel(cell: Cell, node: CardNode, channel: Channel) -> CardChannel:
    card, joint = node.card, cell.far_joint(node.card, channel)
    place = card.kind.place(card, channel.number)
    signal = f"{cell.joint_names[joint]}.{channel.leaf}"
    for layout in (*node.rpdos, *node.tpdos):
        for position, mapped in enumerate(layout.objects):
            if (mapped.index, mapped.subindex) == (place.index, place.subindex):
                return CardChannel(card, channel, joint, signal, layout, position, place.start_bit)
    return CardChannel(card, channel, joint, signal, None, 0, place.start_bit)


def volts_of(cell: Cell, each: CardChannel, code: int) -> float | None:
    """Nominal volts at the card's pin, or behind its op-amp; None where there is no voltage."""
    if each.channel.leaf == Command.CURRENT:
        return cell.joints[each.joint].drive.opamp_full_scale_v * code / each.codec.full_scale
    sensor = fitted_sensor(cell, each.card, each.channel)
    if isinstance(sensor, AnalogueSensor):
        return float(sensor.full_scale_v) * code / each.codec.full_scale
    return None


def value_text(cell: Cell, each: CardChannel, code: int) -> str:
    """What the code stands for, by the nominal scale."""
    if each.channel.leaf == Command.DIRECTION:
        return DirectionBits(code).name.lower().replace("_", "-")
    if each.channel.leaf == Command.GRIP:
        return HandBits(code).name.lower()
    if each.channel.leaf == Command.CURRENT:
        return f"{command_scale(cell, each.joint)(code):.3f} A"
    sensor = fitted_sensor(cell, each.card, each.channel)
    if sensor is None:
        return ABSENT
    unit, factor = _UNITS[sensor.quantity]
    return f"{channel_scale(cell, each.card, each.channel)(code) * factor:.3f} {unit}"


def channel_cells(
    cell: Cell, each: CardChannel, code: int | None, pending: int | None, is_fresh: bool
) -> tuple[Sequence[Word], ...]:
    """Slot, card, channel, signal, code, bits, registers, volts, value. `pending` acts at the next step."""
    head = (
        (Word(f"{each.card.slot}  ${each.base:04X}", Tone.DIM),),
        (Word(each.card.name),),
        (Word(str(each.channel.number), Tone.DIM),),
        (Word("→ " if each.is_output else "← ", Tone.DIM), Word(each.signal)),
    )
    if code is None:
        nothing = (Word(ABSENT, Tone.DIM),)
        return *head, nothing, nothing, nothing, nothing, nothing
    tone = Tone.CHANGED if is_fresh else Tone.PLAIN
    shown = [Word(f"{code}", tone), Word(f"  ${code & 0xFFFFFFFF:02X}", Tone.DIM)]
    if pending is not None and pending != code:
        shown.append(Word(f" ▸{pending}", Tone.WARNING))
    volts = volts_of(cell, each, code)
    registers = " ".join(_register_text(each.base, byte) for byte in each.registers(code))
    return (
        *head,
        shown,
        (Word(_bits(code, each.codec.bits), Tone.DIM),),
        (Word(registers, Tone.DIM),),
        (Word(ABSENT, Tone.DIM) if volts is None else Word(f"{volts:.3f} V"),),
        (Word(value_text(cell, each, code)),),
    )


def _bits(code: int, bits: int) -> str:
    if bits > 16:
        return ABSENT
    text = f"{code & (1 << bits) - 1:0{bits}b}"
    return " ".join(text[max(0, end - 4) : end] for end in range(len(text) % 4 or 4, len(text) + 1, 4))


def _register_text(base: int, byte: RegisterByte) -> str:
    """The byte, the nibble, or the bits: $C0A0=3F, $C0A0=3, $C0B0.3-2=01."""
    where, low = f"${base + byte.address:04X}", (byte.mask & -byte.mask).bit_length() - 1
    high = byte.mask.bit_length() - 1
    if low or high not in (3, 7):
        return f"{where}.{high}-{low}={byte.value >> low:0{high - low + 1}b}"
    return f"{where}={byte.value:0{(high + 1) // 4}X}"
