"""What a socketcand server reads: the commands of one client, bytes in and values out.

Source: linux-can/socketcand, doc/protocol.md, src/state_raw.c and src/state_bcm.c. It reads numbers with scanf, so a
client may write any number of digits, `0x` and leading zeros, and a number that is too wide loses its upper bits:
SavvyCAN sends the byte 0x80 as `ffffffffffffff80`. No sockets, clocks or waiting enter here. Text that makes no sense
is counted, never raised. The modes raw, BCM (subscriptions without throttling) and control (statistics) are served;
send jobs, content filters and ISO-TP are `Unknown`.
"""

from enum import Enum
from typing import NamedTuple

from ..canopen.frames import Frame
from .socketcand import EXTENDED_MASK, HEX_DIGITS, STANDARD_MASK, Cutter

LONGEST_INTERVAL_MS = 1 << 31
_EXTENDED_FLAG, _REMOTE_FLAG, _ERROR_FLAG = 0x8000_0000, 0x4000_0000, 0x2000_0000
"""CAN_EFF_FLAG, CAN_RTR_FLAG and CAN_ERR_FLAG of linux/can.h in an ID, which state_raw.c sends as it was given."""
_WIDEST_HEX, _WIDEST_DECIMAL = (1 << 64) - 1, 20
"""strtoul's value for anything larger, and the decimal digits of 64 bits."""
_GAPS = {str(length): " " * length for length in range(1, 9)}
"""What stands after each byte where all of them have two digits."""
_LENGTH_TEXT = tuple(str(length) for length in range(9))
_BYTE_OF = {spelling % byte: byte for byte in range(256) for spelling in ("%x", "%X", "%02x", "%02X")}
_byte_of = _BYTE_OF.__getitem__
# The generated __new__ of a NamedTuple takes three times as long.
_tuple = tuple.__new__


class Mode(Enum):
    """What a client that has opened a bus is sent (doc/protocol.md)."""

    BCM = "bcmmode"
    """The frames that it has subscribed to."""
    RAW = "rawmode"
    """Every frame."""
    CONTROL = "controlmode"
    """Statistics."""


_MODES = {mode.value: mode for mode in Mode}


class Send(NamedTuple):
    """`< send … >`: a client puts a frame on the bus."""

    frame: Frame


class Open(NamedTuple):
    """`< open can0 >`: a client chooses its bus."""

    channel: str


class ChangeMode(NamedTuple):
    """`< rawmode >` and its like."""

    mode: Mode


class Subscribe(NamedTuple):
    """`< subscribe 0 0 123 >`: a client wants the frames of this ID."""

    can_id: int
    is_extended: bool


class Unsubscribe(NamedTuple):
    """`< unsubscribe 123 >`: it does not want them any more."""

    can_id: int
    is_extended: bool


class Statistics(NamedTuple):
    """`< statistics 1000 >`: a client wants statistics of the bus at this interval in ms; 0 ends them."""

    interval_ms: int


class Echo(NamedTuple):
    """`< echo >`, to be sent back as it is."""


class Unknown(NamedTuple):
    """A well-formed element that is not served here."""

    text: str


class Bad(NamedTuple):
    """An element with a known command and wrong arguments, or text outside any element."""

    text: str


Command = Send | Open | ChangeMode | Subscribe | Unsubscribe | Statistics | Echo | Unknown | Bad


def format_statistics(received_bytes: int, received: int, sent_bytes: int, sent: int) -> bytes:
    """Return the element with a bus's statistics: bytes and frames, received and sent."""
    return b"< stat %d %d %d %d >" % (received_bytes, received, sent_bytes, sent)


class ServerParser:
    """What a server reads: the commands of one client."""

    def __init__(self) -> None:
        self._cutter = Cutter()

    @property
    def garbage_bytes(self) -> int:
        """Bytes so far that belonged to no well-formed element."""
        return self._cutter.garbage_bytes

    @property
    def malformed(self) -> int:
        """Elements and stretches of text so far that could not be read."""
        return self._cutter.malformed

    def feed(self, data: bytes) -> list[Command]:
        """Take the next bytes of the stream, return the commands completed by them, in order. Never raises."""
        text = self._cutter.whole_elements(data)
        if text.startswith("< send "):
            try:
                return _read_sends(text)
            except (ValueError, LookupError):
                pass
        return [self._command(words) for words in self._cutter.split(text)]

    def _command(self, words: list[str]) -> Command:
        try:
            command = _read_command(words)
        except ValueError:
            command = None
        if command is not None:
            return command
        text = " ".join(words)
        self._cutter.reject(len(text))
        return Bad(text)


def _read_command(words: list[str]) -> Command | None:
    """The command in the words of one element; None, or `ValueError`, for a known command with wrong arguments."""
    match words:
        case ["send", id_text, length_text, *byte_texts]:
            return Send(_read_send(id_text, length_text, byte_texts))
        case ["sendrtr", id_text, length_text]:
            return Send(_remote_frame(id_text, _read_decimal(length_text) & 0xFF))
        case ["open", channel]:
            return Open(channel)
        case [name] if name in _MODES:
            return ChangeMode(_MODES[name])
        case ["subscribe", seconds, microseconds, id_text]:
            # The interval, which would throttle an ID, is ignored: every frame is sent.
            _read_decimal(seconds), _read_decimal(microseconds)
            return Subscribe(*_IDS[id_text])
        case ["unsubscribe", id_text]:
            return Unsubscribe(*_IDS[id_text])
        case ["statistics", interval_text]:
            return Statistics(min(_read_decimal(interval_text), LONGEST_INTERVAL_MS))
        case ["echo"]:
            return Echo()
        case [name, *_] if name not in _WITH_ARGUMENTS:
            return Unknown(" ".join(words))
    return None


_WITH_ARGUMENTS = ("send", "sendrtr", "open", "subscribe", "unsubscribe", "statistics")


class _IdTable(dict[str, tuple[int, bool]]):
    """(CAN ID, is extended) by its text, filled on demand. Raises `ValueError` for what is no ID."""

    def __missing__(self, text: str) -> tuple[int, bool]:
        value, is_extended, is_remote = _read_id(text)
        if is_remote:
            raise ValueError(text)
        if len(self) >= 8192:
            self.clear()
        if len(text) <= 16:
            self[text] = value, is_extended
        return value, is_extended


_IDS = _IdTable()


def _read_id(text: str) -> tuple[int, bool, bool]:
    """CAN ID, is extended, is remote. Raises `ValueError` for what is no ID, and for that of an error frame.

    Only a controller makes error frames: what SocketCAN passes on of a client's reaches nobody as data.
    """
    # Eight characters mean extended (state_raw.c, element_length), and so does bit 31, which SavvyCAN sets.
    value = _read_hex(text)
    is_extended = len(text) == 8 or bool(value & _EXTENDED_FLAG)
    is_remote = bool(value & _REMOTE_FLAG)
    if value & _ERROR_FLAG:
        raise ValueError(text)
    if is_extended:
        value &= EXTENDED_MASK
    else:
        value &= ~_REMOTE_FLAG
        if value > STANDARD_MASK:
            raise ValueError(text)
    return value, is_extended, is_remote


def _read_hex(text: str) -> int:
    """As scanf's `%x`, but without signs; `int` would also accept underscores."""
    digits = text[2:] if text[:2] in ("0x", "0X") else text
    if not digits or not HEX_DIGITS.issuperset(digits):
        raise ValueError(text)
    return min(int(digits, 16), _WIDEST_HEX)


def _read_decimal(text: str) -> int:
    """As scanf's `%u`, but without signs; `int` would raise an error of its own for thousands of digits."""
    digits = text.lstrip("0")
    if not text.isascii() or not text.isdecimal() or len(digits) > _WIDEST_DECIMAL:
        raise ValueError(text)
    return int(digits or "0")


def _read_sends(text: str) -> list[Command]:
    """Nothing but well-formed `< send … >` without gaps, or `ValueError` or `LookupError`."""
    commands: list[Command] = []
    for element in text.split("< send ")[1:]:
        id_text, length_text, byte_texts = element.split(" ", 2)
        can_id, is_extended = _IDS[id_text]
        if byte_texts in (">", " >"):
            data = b""
        elif not byte_texts.endswith(" >"):
            raise ValueError(element)
        elif byte_texts[2::3] == _GAPS.get(length_text):
            data = bytes.fromhex(byte_texts[:-2])
        else:
            data = bytes(map(_byte_of, byte_texts[:-2].split(" ")))
        if length_text != _LENGTH_TEXT[len(data)]:
            raise ValueError(element)
        commands.append(_tuple(Send, (_tuple(Frame, (can_id, data, is_extended, False)),)))
    return commands


def _read_send(id_text: str, length_text: str, byte_texts: list[str]) -> Frame:
    """As scanf's %x, %hhu and %hhx would: length and bytes keep their lowest eight bits."""
    can_id, is_extended, is_remote = _read_id(id_text)
    data = bytes(_read_hex(text) & 0xFF for text in byte_texts)
    if len(data) > 8 or _read_decimal(length_text) & 0xFF != len(data):
        raise ValueError(length_text)
    return _remote_frame(id_text, len(data)) if is_remote else Frame(can_id, data, is_extended)


def _remote_frame(id_text: str, length: int) -> Frame:
    """A remote frame that asks for `length` bytes; the flag in the ID may be set or not (state_raw.c, sendrtr)."""
    can_id, is_extended, _ = _read_id(id_text)
    if length > 8:
        raise ValueError(id_text)
    return Frame(can_id, bytes(length), is_extended, is_remote=True)
