"""What the cards hold, asked by SDO, and how it reads in a line of text. Conversations as the master's."""

import contextlib
import math
from collections.abc import Generator

from canarm_controller.bus.master import Ask, Silence
from canarm_controller.errors import ControllerError
from canarm_protocol.canopen.dictionary import ANALOGUE_OUTPUT, CODE_SHIFT, DIGITAL_OUTPUT, ERROR_REGISTER, variable_at
from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.sdo import SdoAborted, Transfer, abort_request, download, upload
from canarm_protocol.cell.model import Cell, Command, Joint, Quantity
from canarm_protocol.cell.wiring import BITS_A_JOINT, CardNode, DirectionBits, InputSlot, current_scale, sensor_scale

from .parsing import DIRECTION_NAMES, SdoRead, SdoWrite

UNITS = {Quantity.POSITION: "deg", Quantity.VELOCITY: "rad/s", Quantity.CURRENT: "A"}
ABORT_SENT_NS = 0
"""An abort of ours is not answered."""


class JogError(ControllerError):
    """A command could not be carried out; the outputs are as they were, or off where the message says so."""


def error_register(node: CardNode) -> Generator[Ask, Frame, int]:
    """Object 0x1001. Raises `JogError`."""
    return (yield from _transfer(node, upload(ERROR_REGISTER, 0)))[0]


def read_outputs(
    cell: Cell, node: CardNode, codes: list[int], directions: list[DirectionBits]
) -> Generator[Ask, Frame, None]:
    """What the card's outputs hold now, into `codes` and `directions` of the joints. Raises `JogError`."""
    for channel in node.card.channel:
        joint = cell.far_joint(node.card, channel)
        if channel.leaf == Command.CURRENT:
            data = yield from _transfer(node, upload(ANALOGUE_OUTPUT, channel.number))
            codes[joint] = int.from_bytes(data, "little") >> CODE_SHIFT
        elif channel.leaf == Command.DIRECTION:
            data = yield from _transfer(node, upload(DIGITAL_OUTPUT, 1))
            directions[joint] = DirectionBits(data[0] >> BITS_A_JOINT * (channel.number - 1) & 0b11)


def access_object(command: SdoRead | SdoWrite) -> Generator[Ask, Frame, str]:
    """Read or write any object; a value in words, as the EDS types it. Raises `JogError`."""
    node, index, subindex = command.node, command.index, command.subindex
    variable = variable_at(node.dictionary, index, subindex)
    name = "" if variable is None else f" {variable.name}"
    where = f"{node.card.name} 0x{index:04X}:{subindex:02X}{name}"
    if isinstance(command, SdoWrite):
        yield from _transfer(node, download(index, subindex, command.value))
        return f"{where}: written"
    data = yield from _transfer(node, upload(index, subindex))
    text = data.hex(" ")
    if variable is not None and not variable.fixed_size:
        text = data.decode("ascii", "replace")
    elif variable is not None and len(data) * 8 == len(variable):
        text = f"{variable.decode_raw(data)!s} (0x{data[::-1].hex().upper()})"
    return f"{where} = {text}"


def input_text(cell: Cell, slot: InputSlot, code: int) -> str:
    """Signal, code and physical value."""
    joint = cell.joints[slot.joint]
    value = sensor_scale(joint, slot.quantity)(code)
    if slot.quantity is Quantity.POSITION:
        value = math.degrees(value)
    sensor = joint.sensor(slot.quantity)
    signal = f"{cell.joint_names[slot.joint]}.{sensor.kind if sensor else slot.quantity}"
    return f"{signal:<24} {code:>3}  {value:8.3f} {UNITS[slot.quantity]}"


def output_text(joint: Joint, code: int, direction: DirectionBits) -> str:
    """Code, direction and the current that both ask for."""
    sign = {DirectionBits.CLOCKWISE: -1.0, DirectionBits.COUNTER_CLOCKWISE: 1.0}.get(direction, 0.0)
    name = DIRECTION_NAMES.get(direction, "illegal")
    return f"{joint.name}: code {code}, {name}, {sign * current_scale(joint)(code) + 0.0:.3f} A"


def _transfer(node: CardNode, transfer: Transfer) -> Generator[Ask, Frame, bytes]:
    card = f"card {node.card.name!r} (node 0x{node.card.node_id:02X})"
    request_id, answer_id = Cob.SDO_TO_SERVER + node.card.node_id, Cob.SDO_TO_CLIENT + node.card.node_id
    request = next(transfer)
    while True:
        try:
            answer = yield Ask((Frame(request_id, request),), lambda frame: frame.can_id == answer_id)
            request = transfer.send(answer.data)
        except StopIteration as done:
            return bytes(done.value)
        except SdoAborted as error:
            if not error.by_server:
                abort = Frame(request_id, abort_request(error.index, error.subindex, error.code))
                with contextlib.suppress(Silence):
                    yield Ask((abort,), lambda frame: False, ABORT_SENT_NS)
            raise JogError(f"{card}: {error}") from None
        except Silence:
            raise JogError(f"{card} does not answer SDO") from None
