"""The text of the socketcand protocol, bytes in and values out: every element that is written, and what a client reads.

`socketcand_server` has what a server reads. Source: linux-can/socketcand, doc/protocol.md and src/state_raw.c. Elements
look like `< send 123 2 11 22 >`. No sockets, clocks or waiting enter here. Text that makes no sense is counted, never
raised. Each parser has a fast path for the usual read (whole elements of one kind, single blanks) and parses anything
else word by word.
"""

from binascii import hexlify
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from ..canopen.frames import Frame
from ..errors import FrameError

DEFAULT_PORT = 29536
MAX_ELEMENT = 1024
"""Longest element in bytes. The longest that is valid here, a `send` from SavvyCAN, has about 100."""

_MAX_SECONDS_DIGITS = 12  # 30 000 years; keeps every time stamp within a float's range
STANDARD_MASK = 0x7FF
EXTENDED_MASK = 0x1FFF_FFFF
HEX_DIGITS = frozenset("0123456789abcdefABCDEF")
# The generated __new__ of a NamedTuple takes three times as long.
_tuple = tuple.__new__


class ErrorFrame(NamedTuple):
    """`< error 004 12.345678 >`: an error frame with SocketCAN's error class bits."""

    time_ns: int
    error_class: int


def format_frame(frame: Frame, time_ns: int) -> bytes:
    """Return the element that tells a client of `frame`, with the time stamp `time_ns` (>= 0).

    The time stamp is rounded down to microseconds. Raises `FrameError` for a remote frame: the protocol has none.
    """
    can_id, data, is_extended, is_remote = frame
    if is_remote:
        raise FrameError(f"remote frame 0x{can_id:03X}: socketcand carries data frames only")
    time_us = time_ns // 1000
    text = b"< frame %08X %d.%06d %b >" if is_extended else b"< frame %03X %d.%06d %b >"
    return text % (can_id, time_us // 1_000_000, time_us % 1_000_000, hexlify(data).upper())


def format_error(error_class: int, time_ns: int) -> bytes:
    """Return the element that tells a client of an error frame (SocketCAN's class bits) at `time_ns` (>= 0)."""
    time_us = time_ns // 1000
    return b"< error %03X %d.%06d >" % (error_class & EXTENDED_MASK, time_us // 1_000_000, time_us % 1_000_000)


def format_send(frame: Frame) -> bytes:
    """Return the element with which a client sends `frame`. Raises `FrameError` for a remote frame or over 8 bytes."""
    can_id, data, is_extended, is_remote = frame
    if is_remote or len(data) > 8:
        kind = "remote frame" if is_remote else f"frame of {len(data)} bytes"
        raise FrameError(f"{kind} 0x{can_id:03X}: socketcand carries data frames of at most 8 bytes only")
    text = b"< send %08X %d %b >" if is_extended else b"< send %03X %d %b >"
    if not data:
        return (b"< send %08X 0 >" if is_extended else b"< send %03X 0 >") % can_id
    return text % (can_id, len(data), hexlify(data, b" "))


class ClientParser:
    """What a client reads: frames. Error frames go to `errors`, replies to the client's commands to `replies`."""

    def __init__(self) -> None:
        self._cutter = Cutter()
        self.errors: deque[ErrorFrame] = deque(maxlen=1024)
        self.replies: deque[str] = deque(maxlen=64)

    @property
    def malformed(self) -> int:
        """Elements and stretches of text so far that could not be read."""
        return self._cutter.malformed

    def feed(self, data: bytes) -> list[tuple[int, Frame]]:
        """Take the next bytes of the stream, return (time in ns, frame) of those completed, in order. Never raises."""
        text = self._cutter.whole_elements(data)
        if text.startswith("< frame "):
            try:
                return _read_frames(text)
            except ValueError:
                pass
        frames = []
        for words in self._cutter.split(text):
            try:
                match words:
                    case ["frame", id_text, time_text, *byte_texts]:
                        can_id, is_extended = _IDS[id_text]
                        payload = _payload("".join(byte_texts))
                        frames.append((_read_time(time_text), Frame(can_id, payload, is_extended)))
                    case ["error", class_text, time_text] if _is_time(time_text):
                        self.errors.append(ErrorFrame(_read_time(time_text), _read_hex(class_text) & EXTENDED_MASK))
                    case ["frame", *_] | []:
                        raise ValueError
                    case _:
                        self.replies.append(" ".join(words))
            except ValueError:
                self._cutter.reject(len(" ".join(words)))
        return frames


class Cutter:
    """Cuts a stream of bytes at the ends of elements, with bounded memory, and counts what was refused."""

    def __init__(self) -> None:
        self._rest = b""
        self.garbage_bytes = 0
        self.malformed = 0

    def reject(self, size: int) -> None:
        """Count `size` bytes that made no sense."""
        self.garbage_bytes += size
        self.malformed += 1

    def whole_elements(self, data: bytes) -> str:
        """Everything up to the last `>`. The beginning of an element after that is kept for the next call."""
        if self._rest:
            data = self._rest + data
        end = data.rfind(b">") + 1
        if end == len(data):
            self._rest = b""
        else:
            self._rest = self._beginning_of_element(data[end:])
            data = data[:end]
        return data.decode("latin-1")

    def _beginning_of_element(self, tail: bytes) -> bytes:
        start = tail.rfind(b"<")
        outside = tail if start < 0 else tail[:start]
        if outside and not outside.isspace():
            self.reject(len(outside))
        rest = b"" if start < 0 else tail[start:]
        if len(rest) > MAX_ELEMENT:
            self.reject(len(rest))
            return b""
        return rest

    def split(self, text: str) -> Iterator[list[str]]:
        """The words of each element, none for one that is too long or cut off. Text between elements is refused."""
        for piece in text.split(">")[:-1]:
            start = piece.rfind("<")
            if start < 0 or len(piece) - start > MAX_ELEMENT:
                self.garbage_bytes += len(piece) + 1
                yield []
                continue
            if start > 0 and not piece[:start].isspace():
                self.reject(start)
            yield piece[start + 1 :].split()


class _IdTable(dict[str, tuple[int, bool]]):
    """(CAN ID, is extended) by its text, filled on demand. Raises `ValueError` for what is no ID."""

    def __missing__(self, text: str) -> tuple[int, bool]:
        # Eight digits mean extended (state_raw.c, element_length).
        value = _read_hex(text)
        is_extended = len(text) == 8
        if is_extended:
            value &= EXTENDED_MASK
        elif value > STANDARD_MASK:
            raise ValueError(text)
        if len(self) >= 8192:
            self.clear()
        self[text] = value, is_extended
        return value, is_extended


_IDS = _IdTable()


def _read_hex(text: str) -> int:
    """One to eight hex digits; `int` would also accept signs, underscores and 0x."""
    if not 0 < len(text) <= 8 or not HEX_DIGITS.issuperset(text):
        raise ValueError(text)
    return int(text, 16)


def _is_time(text: str) -> bool:
    seconds, point, fraction = text.partition(".")
    return point == "." and seconds.isdecimal() and fraction.isdecimal()


def _read_time(text: str) -> int:
    seconds, _, fraction = text.partition(".")
    if not _is_time(text) or len(seconds) > _MAX_SECONDS_DIGITS or len(fraction) > 9:
        raise ValueError(text)
    return int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0"))


def _payload(hex_text: str) -> bytes:
    data = bytes.fromhex(hex_text)
    if len(data) > 8:
        raise ValueError(hex_text)
    return data


def _read_frames(text: str) -> list[tuple[int, Frame]]:
    """Nothing but well-formed `< frame … >` without gaps, or `ValueError`."""
    frames = []
    last_time_text = " "
    time_ns = 0
    from_hex = bytes.fromhex
    for element in text.split("< frame ")[1:]:
        id_text, time_text, hex_text, end = element.split(" ")
        # Frames of one cycle often have the same time stamp.
        if time_text != last_time_text:
            time_ns = _read_time(time_text)
            last_time_text = time_text
        can_id, is_extended = _IDS[id_text]
        data = from_hex(hex_text)
        if end != ">" or len(data) > 8:
            raise ValueError(element)
        frames.append((time_ns, _tuple(Frame, (can_id, data, is_extended, False))))
    return frames
