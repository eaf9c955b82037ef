"""SDO transfers in words: what is asked for and answered, by the names of objects, aborts by their texts.

Segments and acknowledgements do not say which object they are about; `SdoFollower` remembers it for each channel.
"""

from collections.abc import Callable
from typing import NamedTuple

from canopen.sdo.exceptions import SdoAbortedError

from ..canopen.dictionary import Dictionary, variable_at
from ..canopen.eds_file import COMMUNICATION_PROFILE
from ..canopen.sdo import ABORT_TEXT
from ..canopen.values import value_text
from ..shown import printable
from .meaning import Field, Meaning, Sort

SIZE = 8
_ABORT, _BLOCK_DOWN, _BLOCK_UP = 4, 5, 6
"""Command specifiers of both sides; of block transfers, those of the server."""
_NAME_AN_OBJECT = {True: {0x20, 0x40, 0x80, 0xA0, 0xC0}, False: {0x40, 0x60, 0x80, 0xA0, 0xC0}}
"""Command specifiers in place, by whether the client sends, of messages that name their object (CiA 301, 7.2.4.3)."""
_BLOCK_SUBCOMMAND = 0x01
"""Of block transfers only those with this bit 0 begin one, and name its object."""
_START_UPLOAD = 0xA3
_LAST_OF_BLOCKS = 0x80


class SdoWay(NamedTuple):
    """One direction of an SDO channel: the server's node-ID, and whether the client sends."""

    node_id: int
    is_request: bool
    channel: int = 0


Where = tuple[int, int] | None
"""Index and sub-index of the object of a transfer, where they are known."""


class About(NamedTuple):
    """What one SDO message is about: an object, and whether it is a numbered segment of a block transfer."""

    where: Where = None
    is_block: bool = False


class SdoFollower:
    """The object that the transfer of each channel is about. `follow` has to see all SDO frames, in order."""

    def __init__(self) -> None:
        self._where: dict[tuple[int, int], tuple[int, int]] = {}
        self._blocks: dict[tuple[int, int], bool] = {}
        """Channels in a block transfer, and whether the client sends its segments."""

    def follow(self, way: SdoWay, data: bytes) -> About:
        """What `data` is about."""
        key = way.node_id, way.channel
        if len(data) != SIZE:
            return About(self._where.get(key))
        command = data[0]
        if self._blocks.get(key) is way.is_request and command != _ABORT << 5:
            if command & _LAST_OF_BLOCKS:
                del self._blocks[key]
            return About(self._where.get(key), is_block=True)
        if command == _ABORT << 5:
            self._blocks.pop(key, None)
        elif way.is_request and command == _START_UPLOAD:
            self._blocks[key] = False
        elif not way.is_request and command >> 5 == _BLOCK_DOWN and not command & 0x03:
            self._blocks[key] = True
        if _names_object(way, data):
            self._where[key] = _named(data)
        return About(self._where.get(key))


def sdo(way: SdoWay, data: bytes, about: About, name: str, dictionary: Dictionary | None) -> Meaning:
    """One SDO message; `about` is its object, `dictionary` that of its server."""
    channel = f", channel {way.channel}" if way.channel else ""
    title = f"SDO {'to' if way.is_request else 'of'} {name}{channel}"
    if len(data) != SIZE:
        return Meaning(Sort.SDO, title, said=f"malformed: {len(data)} bytes instead of {SIZE}", is_wrong=True)
    if about.is_block:
        last = ", the last" if data[0] & _LAST_OF_BLOCKS else ""
        number = Field("number", str(data[0] & ~_LAST_OF_BLOCKS), 0, 7)
        said = f"block segment {number.text} of {_object(about.where, dictionary)}: {data[1:].hex(' ')}{last}"
        return Meaning(Sort.SDO, title, (number,), said)
    specifier = data[0] >> 5
    if specifier == _ABORT:
        code = int.from_bytes(data[4:], "little")
        said = f"abort {_object(_named(data), dictionary)}: {abort_text(code)} (0x{code:08X})"
        return Meaning(Sort.SDO, title, (*_head(data), Field("abort code", f"0x{code:08X}", 32, 32)), said, True)
    texts = _REQUESTS if way.is_request else _RESPONSES
    said_by = texts.get(specifier)
    if said_by is None:
        said = f"unknown command 0x{data[0]:02X}"
        return Meaning(Sort.SDO, title, (Field("command", f"0x{data[0]:02X}", 0, 8),), said, True)
    fields = _head(data) if _names_object(way, data) else (Field("command", f"0x{data[0]:02X}", 0, 8),)
    where = _named(data) if _names_object(way, data) else about.where
    return Meaning(Sort.SDO, title, fields, said_by(data, where, dictionary))


def abort_text(code: int) -> str:
    """An abort code in words, ours or those of the `canopen` library."""
    text: str | None = ABORT_TEXT.get(code) or SdoAbortedError.CODES.get(code)
    return text or "unknown abort code"


def object_name(where: tuple[int, int], dictionary: Dictionary | None) -> str:
    """The name of an object; empty if it is not known."""
    if dictionary is None:
        return ""
    entry, variable = dictionary.get(where[0]), variable_at(dictionary, *where)
    if entry is None or variable is None:
        return ""
    # Members of communication objects have names such as "COB-ID used by PDO", which say little by themselves.
    name = variable.qualname if where[0] in COMMUNICATION_PROFILE else variable.name
    return printable(str(name), 60)


def _names_object(way: SdoWay, data: bytes) -> bool:
    begins = data[0] & 0xE0
    is_block = begins in (0xA0, 0xC0)
    return begins in _NAME_AN_OBJECT[way.is_request] and not (is_block and data[0] & _BLOCK_SUBCOMMAND)


def _named(data: bytes) -> tuple[int, int]:
    return int.from_bytes(data[1:3], "little"), data[3]


def _object(where: Where, dictionary: Dictionary | None) -> str:
    if where is None:
        return "an object"
    name = object_name(where, dictionary)
    return f"0x{where[0]:04X}:{where[1]:02X}" + (f" {name}" if name else "")


def _head(data: bytes) -> tuple[Field, ...]:
    index, subindex = _named(data)
    return (
        Field("command", f"0x{data[0]:02X}", 0, 8),
        Field("index", f"0x{index:04X}", 8, 16),
        Field("sub-index", str(subindex), 24, 8),
    )


def _value(data: bytes, where: Where, dictionary: Dictionary | None) -> str:
    """What an initiating message carries: the value, or how many bytes follow."""
    command = data[0]
    if command & 0x02:
        carried = data[4 : 8 - (command >> 2 & 3)] if command & 0x01 else data[4:]
        variable = None if where is None or dictionary is None else variable_at(dictionary, *where)
        return f"= {value_text(variable, carried)}"
    size = f"of {int.from_bytes(data[4:], 'little')} bytes" if command & 0x01 else ""
    return f"{size} in segments".lstrip()


def _segment(data: bytes, where: Where, dictionary: Dictionary | None) -> str:
    last = ", the last" if data[0] & 0x01 else ""
    return f"segment of {_object(where, dictionary)}: {data[1 : 8 - (data[0] >> 1 & 7)].hex(' ')}{last}"


_Words = Callable[[bytes, Where, Dictionary | None], str]
_REQUESTS: dict[int, _Words] = {
    0: _segment,
    1: lambda data, where, known: f"write {_object(where, known)} {_value(data, where, known)}",
    2: lambda data, where, known: f"read {_object(where, known)}",
    3: lambda data, where, known: f"next segment of {_object(where, known)}",
    5: lambda data, where, known: f"block upload of {_object(where, known)}",
    6: lambda data, where, known: f"block download of {_object(where, known)}",
}
_RESPONSES: dict[int, _Words] = {
    0: _segment,
    1: lambda data, where, known: f"segment of {_object(where, known)} taken",
    2: lambda data, where, known: f"{_object(where, known)} {_value(data, where, known)}",
    3: lambda data, where, known: f"{_object(where, known)} written",
    5: lambda data, where, known: f"block download of {_object(where, known)}",
    6: lambda data, where, known: f"block upload of {_object(where, known)}",
}
"""By command specifier (CiA 301, 7.2.4.3)."""
