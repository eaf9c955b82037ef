"""What cards are to put out when the controller is gone, kept up to date while it lives: what carries the present pose.

Owns the arithmetic from a pose to the error values of the cards, and the turns in which they are written by SDO, one
object in flight at a time. What a card does with its error values never enters.
"""

from collections.abc import Callable, Collection, Mapping, Sequence

from canarm_protocol.canopen.dictionary import variable_at
from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.sdo import SdoAborted, Transfer, download
from canarm_protocol.cell.model import Cell, Command
from canarm_protocol.cell.wiring import CardNode, DirectionBits, bridge_directions, command_codec

ANSWER_CYCLES = 40
"""A card that has not answered after so many cycles is asked again when its turn comes."""

_OFF = int(DirectionBits.OFF)
Weight = Callable[[Sequence[float]], Sequence[float]]
"""Torques, N·m, that bear the arms' weight at angles in rad."""


class CarryingCodes:
    """Error values of all drives: the codes of the currents that give torques, and the bits of their directions."""

    def __init__(self, cell: Cell) -> None:
        self._drives = [
            (
                joint.motor.torque_per_ampere,
                joint.drive.max_current_a,
                command_codec(cell, index).full_scale,
                tuple(map(int, bridge_directions(cell, index))),
                (index, Command.CURRENT),
                (index, Command.DIRECTION),
            )
            for index, joint in enumerate(cell.joints)
        ]

    def of(self, torque_nm: Sequence[float]) -> dict[tuple[int, str], int]:
        """By joint and command; a torque beyond what the amplifier has is that."""
        values: dict[tuple[int, str], int] = {}
        for torque, drive in zip(torque_nm, self._drives, strict=True):
            per_ampere, most_a, full_scale, (back, forth), current, direction = drive
            values[current] = code = round(min(abs(torque / per_ampere) / most_a, 1.0) * full_scale)
            values[direction] = (forth if torque > 0.0 else back) if code else _OFF
        return values


class CarryingRefresh:
    """Writes error values for the present pose to the cards of robots that are carried without a controller.

    Every `Cell.carry_refresh_cycles` at most one object is written, to one card after the other, and only where it is
    another value than the card has. A card that refuses, or does not answer, keeps what it has until its next turn.
    """

    def __init__(self, cell: Cell, nodes: Sequence[CardNode], weight_nm: Weight) -> None:
        robots = {robot.name for robot in cell.robot if robot.when_lost == "carry"}
        self._nodes = [node for node in nodes if node.card.robot in robots and node.card.kind.is_output]
        self._every = cell.carry_refresh_cycles
        self._codes, self._weight_nm = CarryingCodes(cell), weight_nm
        self._joints = [
            [
                (channel.number, (cell.far_joint(node.card, channel), channel.leaf), channel.error_value)
                for channel in node.card.channel
            ]
            for node in self._nodes
        ]
        self._has: list[dict[tuple[int, int], int | None]] = [
            dict(self._values(place, {channel.number: channel.error_value for channel in node.card.channel}))
            for place, node in enumerate(self._nodes)
        ]
        """What each card has, by index and sub-index; None where that is not known."""
        self._found: list[list[int] | None] = [None] * len(self._nodes)
        """Of each card, the error values by channel that it was last found to have; None once it is written to."""
        self._place, self._left = -1, list[tuple[int, int, int]]()
        self._transfer: Transfer | None = None
        self._written, self._asked_at, self._due_at = (0, 0, 0), 0, 0
        self._trusted_rad: Sequence[float] = ()

    def frames(self, tick: int, position_rad: Sequence[float], doubted: Collection[int] = ()) -> tuple[Frame, ...]:
        """What to send in cycle `tick`: a request, or nothing. Joints in doubt are where they were before."""
        if doubted:
            rows = enumerate(zip(position_rad, self._trusted_rad or position_rad, strict=True))
            position_rad = [before if joint in doubted else angle for joint, (angle, before) in rows]
        self._trusted_rad = position_rad
        if tick < self._due_at or (self._transfer is not None and tick - self._asked_at < ANSWER_CYCLES):
            return ()
        self._due_at = tick + self._every
        if self._transfer is not None:
            self._left.clear()
        if not self._left and not self._look():
            return ()
        index, subindex, value = self._written = self._left.pop(0)
        node = self._nodes[self._place]
        variable = variable_at(node.dictionary, index, subindex)
        assert variable is not None, "it is in the card's EDS"
        self._has[self._place][index, subindex] = self._found[self._place] = None
        self._transfer, self._asked_at = download(index, subindex, bytes(variable.encode_raw(value))), tick
        return (Frame(Cob.SDO_TO_SERVER + node.card.node_id, next(self._transfer)),)

    def take(self, frame: Frame) -> bool:
        """Take a frame if it is the answer that is awaited."""
        if self._transfer is None or frame.can_id != Cob.SDO_TO_CLIENT + self._nodes[self._place].card.node_id:
            return False
        try:
            self._transfer.send(frame.data)
        except StopIteration:
            index, subindex, value = self._written
            self._has[self._place][index, subindex] = value
        except SdoAborted:
            self._left.clear()
        self._transfer = None
        return True

    def _look(self) -> bool:
        """Find the next card that has other values than it should, and what they should be."""
        needed = self._codes.of(self._weight_nm(self._trusted_rad))
        for _ in self._nodes:
            self._place = (self._place + 1) % len(self._nodes)
            channels, has = self._joints[self._place], self._has[self._place]
            values = [needed.get(far, given) for _, far, given in channels]
            if values == self._found[self._place]:
                continue
            numbers = (number for number, *_ in channels)
            wanted = self._values(self._place, dict(zip(numbers, values, strict=True)))
            self._left = [(*key, value) for key, value in wanted.items() if has[key] != value]
            if self._left:
                return True
            self._found[self._place] = values
        return False

    def _values(self, place: int, error_values: Mapping[int, int]) -> dict[tuple[int, int], int]:
        card = self._nodes[place].card
        rows = card.kind.application_values(card, self._nodes[place].dictionary, error_values)
        return {(index, subindex): value for index, subindex, value in rows}
