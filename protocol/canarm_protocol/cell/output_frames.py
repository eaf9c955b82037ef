"""The frames that carry the commands of all joints to the cards."""

from collections.abc import Sequence

from ..canopen.frames import Frame, data_frame
from ..canopen.pdo import PdoLayout
from ..cards import Wire
from .model import Cell, Command
from .wiring import CardNode

Part = tuple[int, int]
"""A joint (a hand: the number of joints and its own), and how far its code is shifted in the value of an object."""


class OutputFrames:
    """Packs DAC codes and direction bits of all joints into the cards' RPDOs."""

    def __init__(self, cell: Cell, nodes: Sequence[CardNode]) -> None:
        self.grips = [0] * len(cell.joints)
        """Bits of the hands at the joints, see `HandBits`; 0 where there is none."""
        self._frames: list[tuple[PdoLayout, bool, list[Part], list[list[Part]]]] = []
        """For each RPDO: its layout, whether it carries directions, and the part of each object; or instead of the
        latter, where an object has several parts, all parts of each object."""
        for node in nodes:
            card = node.card
            parts: dict[tuple[int, int], list[Part]] = {}
            for channel in card.channel:
                place, joint = card.kind.place(card, channel.number), cell.far_joint(card, channel)
                shift = place.start_bit + card.codec.shift
                joint += len(cell.joints) * (channel.leaf == Command.GRIP)
                parts.setdefault((place.index, place.subindex), []).append((joint, shift))
            for layout in node.rpdos:
                objects = [parts[mapped.index, mapped.subindex] for mapped in layout.objects]
                is_single = all(len(each) == 1 for each in objects)
                only, several = ([each[0] for each in objects], []) if is_single else ([], objects)
                self._frames.append((layout, card.kind.takes is Wire.DIRECTION, only, several))

    def frames(self, codes: Sequence[int], directions: Sequence[int]) -> list[Frame]:
        """The RPDOs that carry DAC `codes` and 2-bit `directions`, one of each per joint."""
        frames, bits = [], [*directions, *self.grips]
        for layout, is_direction, only, several in self._frames:
            source = bits if is_direction else codes
            values = [source[joint] << shift for joint, shift in only]
            for parts in several:
                value = 0
                for joint, shift in parts:
                    value |= source[joint] << shift
                values.append(value)
            frames.append(data_frame(layout.cob_id, layout.pack(*values)))
        return frames
