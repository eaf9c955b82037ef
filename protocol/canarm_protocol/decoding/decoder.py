"""From a frame to its meaning, with what a `Book` knows of the bus. The only state is what SDO transfers are about."""

from ..canopen.frames import HIGHEST_NODE_ID, Cob, Frame
from ..errors import FrameError
from . import services
from .book import Book
from .meaning import KnownMessage, Meaning, Sort
from .sdo_texts import About, SdoFollower, sdo

NOTHING = About()
_PDO_BASES = {
    0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2", 0x380: "TPDO3", 0x400: "RPDO3", 0x480: "TPDO4",
    0x500: "RPDO4",
}  # fmt: skip
"""Of the predefined connection set (CiA 301, 7.3.3)."""
_ERROR_CLASSES = (
    "transmit time-out",
    "lost arbitration",
    "controller problem",
    "protocol violation",
    "transceiver",
    "no acknowledge",
    "bus-off",
    "bus error",
    "controller restarted",
)
"""Bits of an error frame's identifier (CAN_ERR_TX_TIMEOUT and on, linux/can/error.h)."""


class Decoder:
    """`follow` each frame in order where SDO segments are to be told by their objects; `meaning` at any time."""

    def __init__(self, book: Book) -> None:
        self.book = book
        self._follower = SdoFollower()

    def follow(self, frame: Frame) -> About:
        """What an SDO frame is about, to be given to `meaning`; nothing for another frame."""
        can_id, data, is_extended, is_remote = frame
        if is_extended or is_remote:
            return NOTHING
        way = self.book.channel(can_id)
        return NOTHING if way is None else self._follower.follow(way, data)

    def meaning(self, frame: Frame, about: About = NOTHING) -> Meaning:
        """What `frame` means. Never raises: what breaks a protocol is said."""
        can_id, data, is_extended, is_remote = frame
        book = self.book
        if frame.is_error:
            return error_meaning(can_id)
        message = book.message(can_id, is_extended)
        if message is not None and not is_remote:
            return known_meaning(message, data)
        if is_extended:
            return Meaning(Sort.OTHER, "29-bit identifier, not CANopen's")
        if is_remote:
            return Meaning(Sort.OTHER, "remote frame")
        way = book.channel(can_id)
        if way is not None:
            return sdo(way, data, about, book.name(way.node_id), book.dictionary(way.node_id))
        return self._predefined(can_id, data)

    def _predefined(self, can_id: int, data: bytes) -> Meaning:
        """By the predefined connection set (CiA 301, 7.3.3)."""
        if can_id == Cob.NMT:
            return services.nmt(data, self.book.name)
        if can_id == Cob.SYNC:
            return services.sync(data)
        if can_id == Cob.TIME:
            return services.time(data)
        base, node_id = can_id & ~HIGHEST_NODE_ID, can_id & HIGHEST_NODE_ID
        name = self.book.name(node_id)
        if node_id and base == Cob.EMERGENCY:
            return services.emergency(data, name)
        if node_id and base == Cob.HEARTBEAT:
            return services.heartbeat(data, name)
        if node_id and base in _PDO_BASES:
            return Meaning(Sort.PDO, f"{_PDO_BASES[base]} of {name}, by its COB-ID")
        return Meaning(Sort.OTHER, "unknown")


def known_meaning(message: KnownMessage, data: bytes) -> Meaning:
    """A described message."""
    try:
        fields = message.fields(data)
    except FrameError as error:
        return Meaning(message.sort, message.title, said=f"malformed: {error}", is_wrong=True)
    return Meaning(message.sort, message.title, fields)


def error_meaning(can_id: int) -> Meaning:
    """An error frame as Linux reports it."""
    names = [name for bit, name in enumerate(_ERROR_CLASSES) if can_id >> bit & 1]
    return Meaning(Sort.ERROR, "error frame", said=", ".join(names), is_wrong=True)


def raw_text(frame: Frame) -> str:
    """The frame as candump's log format has it."""
    can_id, data, is_extended, is_remote = frame
    identifier = f"{can_id:08X}" if is_extended or frame.is_error else f"{can_id:03X}"
    return f"{identifier}#{'R' if is_remote else data.hex().upper()}"
