"""The CANopen master's services for its cards before and after a run, as conversations.

A conversation is a generator. It yields what to send and which answer to wait for, and is sent that answer, or has
`Silence` thrown into it if none comes in time. Sockets and clocks belong to the caller.
"""

import contextlib
from collections.abc import Callable, Generator
from dataclasses import dataclass, field

from canarm_protocol.canopen.dictionary import (
    CLOCK_MODE,
    DEVICE_TYPE,
    IDENTITY,
    default_value,
    variable_at,
)
from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand, NmtState, heartbeat_frame, nmt_frame
from canarm_protocol.canopen.sdo import LARGEST_NUMBER, SdoAborted, Transfer, abort_request, download, upload
from canarm_protocol.cell.configuration import Setting, card_settings
from canarm_protocol.cell.model import Bus
from canarm_protocol.cell.wiring import CardNode

from ..errors import BringUpError, ClockMismatchError, ControllerError

ANSWER_NS = 3_000_000_000
"""How long a card may take to answer."""
UNANSWERED_NS = 0
ALL_BITS = 0xFF
CLOCK_NAMES = {0: "wall", 1: "sync"}


class Silence(Exception):
    """Thrown into a conversation: nobody answered in time."""


@dataclass(frozen=True, slots=True)
class Ask:
    """Frames to send, and whether a received frame is the answer; `limit_ns` bounds the wait."""

    frames: tuple[Frame, ...]
    is_answer: Callable[[Frame], bool]
    limit_ns: int = ANSWER_NS
    awaited: str = field(default="")


Conversation = Generator[Ask, Frame, None]


def bring_up(nodes: tuple[CardNode, ...], bus: Bus, clock_mode: int, listen_ns: int) -> Conversation:
    """Find, identify and configure the cards, and leave them in PRE-OPERATIONAL with heartbeats monitored both ways.

    Raises `BringUpError` if another controller is on the bus, or a card is missing, has another identity or refuses
    its configuration, and `ClockMismatchError` if the emulated world follows another clock than the controller.
    """
    if listen_ns:
        yield from _listen_for_another(bus.controller_node_id, listen_ns)
    for node in nodes:
        yield from _reset(node, nodes)
        yield from _check_identity(node)
        yield from _check_clock(node, clock_mode)
    for node in nodes:
        for index, subindex, value in _configuration(node, bus):
            yield from _transfer(node, download(index, subindex, value))


def read_input(node: CardNode, channel: int) -> Generator[Ask, Frame, int]:
    """The present code of one of the card's inputs, by SDO. Raises `BringUpError`."""
    card = node.card
    place = card.kind.place(card, channel)
    return card.codec.code((yield from read_number(node, place.index, place.subindex)))


def read_number(node: CardNode, index: int, subindex: int) -> Generator[Ask, Frame, int]:
    """The number in an object of the card's EDS, by SDO. Raises `BringUpError`."""
    variable = variable_at(node.dictionary, index, subindex)
    assert variable is not None, "it is in the card's EDS"
    data = yield from _read(node, index, subindex, len(variable) // 8)
    return int(variable.decode_raw(data))


def start_frames(nodes: tuple[CardNode, ...], node_id: int) -> list[Frame]:
    """The controller's first heartbeat, then NMT start for each card."""
    starts = [nmt_frame(NmtCommand.START, node.card.node_id) for node in nodes]
    return [heartbeat_frame(node_id, NmtState.OPERATIONAL), *starts]


def stop_frames(nodes: tuple[CardNode, ...]) -> list[Frame]:
    """The cards leave OPERATIONAL by way of STOPPED, in which their outputs take their error values."""
    commands = (NmtCommand.STOP, NmtCommand.PRE_OPERATIONAL)
    return [nmt_frame(command, node.card.node_id) for command in commands for node in nodes]


def _listen_for_another(node_id: int, listen_ns: int) -> Conversation:
    def is_other_master(frame: Frame) -> bool:
        return frame.can_id in (Cob.SYNC, Cob.HEARTBEAT + node_id)

    try:
        other = yield Ask((), is_other_master, listen_ns, "another controller")
    except Silence:
        return
    what = "SYNC" if other.can_id == Cob.SYNC else f"heartbeats of node {node_id}"
    raise BringUpError(f"another controller is on the bus ({what} seen): stop it first, two masters would fight")


def _reset(node: CardNode, nodes: tuple[CardNode, ...]) -> Conversation:
    card = node.card
    boot_up = Cob.HEARTBEAT + card.node_id
    try:
        yield Ask(
            (nmt_frame(NmtCommand.RESET_NODE, card.node_id),),
            lambda frame: frame.can_id == boot_up and frame.data == bytes((NmtState.BOOT_UP,)),
            awaited=_name(node),
        )
    except Silence:
        hint = "is an emulator with this cell on this bus?"
        if node is not nodes[0]:
            hint = f"{_name(nodes[0])} does: is it a card of another cell? give emulator and controller the same --cell"
        raise BringUpError(
            f"{_name(node)} does not answer: no boot-up within {ANSWER_NS / 1e9:g} s of NMT reset; {hint}"
        ) from None


def _check_identity(node: CardNode) -> Conversation:
    expected = [
        (DEVICE_TYPE, 0, "device type"),
        (IDENTITY, 1, "vendor-ID"),
        (IDENTITY, 2, "product code"),
        (IDENTITY, 3, "revision"),
    ]
    for index, subindex, what in expected:
        data = yield from _read(node, index, subindex, 4)
        found, wanted = int.from_bytes(data, "little"), default_value(node.dictionary, index, subindex)
        if found != wanted:
            raise BringUpError(
                f"{_name(node)} is another device: {what} (0x{index:04X}:{subindex:02X}) is 0x{found:08X}; "
                f"the cell says {node.card.model}, 0x{wanted:08X}"
            )


def _check_clock(node: CardNode, clock_mode: int) -> Conversation:
    data = yield from _read(node, CLOCK_MODE, 0, 1)
    if data[0] != clock_mode:
        theirs, ours = CLOCK_NAMES.get(data[0], str(data[0])), CLOCK_NAMES[clock_mode]
        raise ClockMismatchError(
            f"{_name(node)} runs on --clock {theirs}, its master on --clock {ours}: start both with the same --clock"
        )


def _configuration(node: CardNode, bus: Bus) -> list[tuple[int, int, bytes]]:
    """Index, sub-index and bytes of every object that the master sets, in an order that the cards accept."""
    return [(each.index, each.subindex, _encoded(node, each)) for each in card_settings(node, bus)]


def _encoded(node: CardNode, setting: Setting) -> bytes:
    variable = variable_at(node.dictionary, setting.index, setting.subindex)
    assert variable is not None
    return bytes(variable.encode_raw(setting.value))


def _read(node: CardNode, index: int, subindex: int, size: int) -> Generator[Ask, Frame, bytes]:
    data = yield from _transfer(node, upload(index, subindex, LARGEST_NUMBER))
    if len(data) != size:
        raise BringUpError(f"{_name(node)}: SDO 0x{index:04X}:{subindex:02X} has {len(data)} bytes; must be {size}")
    return data


def _transfer(node: CardNode, transfer: Transfer) -> Generator[Ask, Frame, bytes]:
    silence = f"stopped answering: no SDO response within {ANSWER_NS / 1e9:g} s"
    return (yield from carry_out(node, transfer, BringUpError, silence))


def carry_out(
    node: CardNode, transfer: Transfer, failure: type[ControllerError], silence: str
) -> Generator[Ask, Frame, bytes]:
    """A whole SDO transfer with a card. Raises `failure` for an abort, and with the text `silence` without an answer.

    A wrong answer of the card is aborted; it does not answer an abort.
    """
    request_id, answer_id = Cob.SDO_TO_SERVER + node.card.node_id, Cob.SDO_TO_CLIENT + node.card.node_id
    request = next(transfer)
    while True:
        try:
            answer = yield Ask(
                (Frame(request_id, request),), lambda frame: frame.can_id == answer_id, awaited=_name(node)
            )
            request = transfer.send(answer.data)
        except StopIteration as done:
            return bytes(done.value)
        except SdoAborted as error:
            if not error.by_server:
                abort = Frame(request_id, abort_request(error.index, error.subindex, error.code))
                with contextlib.suppress(Silence):
                    yield Ask((abort,), lambda frame: False, UNANSWERED_NS)
            raise failure(f"{_name(node)}: {error}") from None
        except Silence:
            raise failure(f"{_name(node)} {silence}") from None


def _name(node: CardNode) -> str:
    return f"card {node.card.name!r} (node 0x{node.card.node_id:02X})"
