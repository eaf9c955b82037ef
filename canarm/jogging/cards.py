"""What the cards hold, read by SDO, as a line of text. Conversations are generators, as in the master."""

import math
from collections.abc import Generator

from canarm_controller.bus.master import Ask, carry_out
from canarm_controller.errors import ControllerError
from canarm_protocol.canopen.dictionary import ERROR_REGISTER, variable_at
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import LARGEST_NUMBER, download, upload
from canarm_protocol.canopen.values import value_text
from canarm_protocol.cards import Wire
from canarm_protocol.cell.model import Cell, Command, Quantity
from canarm_protocol.cell.sensing import joint_sensors
from canarm_protocol.cell.wiring import CardNode, DirectionBits, InputSlot, bridge_directions, command_scale
from canarm_protocol.errors import ExitStatus

from .parsing import DIRECTION_NAMES, SdoRead, SdoWrite

SILENCE = "does not answer SDO"
UNITS = {Quantity.POSITION: "deg", Quantity.VELOCITY: "rad/s", Quantity.CURRENT: "A"}


class JogError(ControllerError):
    """A command could not be carried out; the outputs are unchanged, or off if the message says so."""

    exit_status = ExitStatus.FAILED


def error_register(node: CardNode) -> Generator[Ask, Frame, int]:
    """Object 0x1001. Raises `JogError`."""
    return (yield from carry_out(node, upload(ERROR_REGISTER, 0, LARGEST_NUMBER), JogError, SILENCE))[0]


def read_outputs(
    cell: Cell, node: CardNode, codes: list[int], directions: list[DirectionBits]
) -> Generator[Ask, Frame, None]:
    """Read the card's present outputs into `codes` and `directions` of the joints. Raises `JogError`."""
    card = node.card
    if not card.kind.is_output:
        return
    for channel in card.channel:
        if channel.leaf == Command.GRIP:
            continue
        joint, place = cell.far_joint(card, channel), card.kind.place(card, channel.number)
        data = yield from carry_out(node, upload(place.index, place.subindex, LARGEST_NUMBER), JogError, SILENCE)
        code = int.from_bytes(data, "little") >> place.start_bit + card.codec.shift & card.codec.full_scale
        if card.kind.takes is Wire.DIRECTION:
            directions[joint] = DirectionBits(code)
        else:
            codes[joint] = code


def access_object(command: SdoRead | SdoWrite) -> Generator[Ask, Frame, str]:
    """Read or write any object; returns its value as text, by its type in the EDS. Raises `JogError`."""
    node, index, subindex = command.node, command.index, command.subindex
    variable = variable_at(node.dictionary, index, subindex)
    name = "" if variable is None else f" {variable.name}"
    where = f"{node.card.name} 0x{index:04X}:{subindex:02X}{name}"
    if isinstance(command, SdoWrite):
        yield from carry_out(node, download(index, subindex, command.value), JogError, SILENCE)
        return f"{where}: written"
    data = yield from carry_out(node, upload(index, subindex), JogError, SILENCE)
    return f"{where} = {value_text(variable, data)}"


def input_text(cell: Cell, slot: InputSlot, code: int) -> str:
    """Signal, code and physical value."""
    wired = joint_sensors(cell)[slot.joint].measuring(slot.quantity)
    assert wired is not None, "a slot is made of a wired sensor"
    value = wired.scale(code)
    if slot.quantity is Quantity.POSITION:
        value = math.degrees(value)
    return f"{wired.signal:<24} {code:>3}  {value:8.3f} {UNITS[slot.quantity]}"


def output_text(cell: Cell, joint: int, code: int, direction: DirectionBits) -> str:
    """Code, direction and the current that they command."""
    sign = dict(zip(bridge_directions(cell, joint), (-1.0, 1.0), strict=True)).get(direction, 0.0)
    name = DIRECTION_NAMES.get(direction, "illegal")
    current_a = sign * command_scale(cell, joint)(code) + 0.0
    return f"{cell.joint_names[joint]}: code {code}, {name}, {current_a:.3f} A"
