"""The client's side of SDO transfers (CiA 301, 7.2.4), as generators: requests come out, responses go in.

A transfer yields the eight bytes to send and is sent the eight bytes that came back; its return value is the result.
Its caller owns the bus, the COB-IDs and the time-out.
"""

import struct
from collections.abc import Generator
from enum import IntEnum

from ..errors import ProtocolError

Transfer = Generator[bytes, bytes, bytes]
"""Yields request data, takes response data, returns the object's value (empty for a download)."""

LARGEST_UPLOAD = 1 << 20
"""Most bytes of an object that a client accepts by default; the longest object here has 110 kB."""
LARGEST_NUMBER = 8
"""Most bytes of a numeric object."""
_HEAD = struct.Struct("<BHB")
_EXPEDITED, _SIZED, _TOGGLE, _LAST = 0x02, 0x01, 0x10, 0x01


class AbortCode(IntEnum):
    """SDO abort codes in use (CiA 301, table 22)."""

    TOGGLE = 0x0503_0000
    TIMED_OUT = 0x0504_0000
    COMMAND = 0x0504_0001
    BLOCK_SIZE = 0x0504_0002
    SEQUENCE = 0x0504_0003
    CRC = 0x0504_0004
    OUT_OF_MEMORY = 0x0504_0005
    UNSUPPORTED_ACCESS = 0x0601_0000
    WRITE_ONLY = 0x0601_0001
    READ_ONLY = 0x0601_0002
    NO_OBJECT = 0x0602_0000
    NOT_MAPPABLE = 0x0604_0041
    PDO_TOO_LONG = 0x0604_0042
    INCOMPATIBLE_PARAMETER = 0x0604_0043
    LENGTH = 0x0607_0010
    TOO_LONG = 0x0607_0012
    TOO_SHORT = 0x0607_0013
    NO_SUBINDEX = 0x0609_0011
    INVALID_VALUE = 0x0609_0030
    TOO_HIGH = 0x0609_0031
    TOO_LOW = 0x0609_0032
    NO_RESOURCE = 0x060A_0023
    GENERAL = 0x0800_0000
    CANNOT_STORE = 0x0800_0020
    DEVICE_STATE = 0x0800_0022
    NO_DATA = 0x0800_0024


ABORT_TEXT: dict[int, str] = {
    AbortCode.TOGGLE: "toggle bit not alternated",
    AbortCode.TIMED_OUT: "SDO protocol timed out",
    AbortCode.COMMAND: "client/server command specifier not valid or unknown",
    AbortCode.BLOCK_SIZE: "invalid block size",
    AbortCode.SEQUENCE: "invalid sequence number",
    AbortCode.CRC: "CRC error",
    AbortCode.OUT_OF_MEMORY: "out of memory",
    AbortCode.UNSUPPORTED_ACCESS: "unsupported access to an object",
    AbortCode.WRITE_ONLY: "attempt to read a write-only object",
    AbortCode.READ_ONLY: "attempt to write a read-only object",
    AbortCode.NO_OBJECT: "object does not exist in the object dictionary",
    AbortCode.NOT_MAPPABLE: "object cannot be mapped to the PDO",
    AbortCode.PDO_TOO_LONG: "the objects to be mapped would exceed the PDO's length",
    AbortCode.INCOMPATIBLE_PARAMETER: "general parameter incompatibility",
    AbortCode.LENGTH: "data type does not match, length of service parameter does not match",
    AbortCode.TOO_LONG: "data type does not match, length of service parameter too high",
    AbortCode.TOO_SHORT: "data type does not match, length of service parameter too low",
    AbortCode.NO_SUBINDEX: "sub-index does not exist",
    AbortCode.INVALID_VALUE: "invalid value for parameter",
    AbortCode.TOO_HIGH: "value of parameter written too high",
    AbortCode.TOO_LOW: "value of parameter written too low",
    AbortCode.NO_RESOURCE: "resource not available",
    AbortCode.GENERAL: "general error",
    AbortCode.CANNOT_STORE: "data cannot be transferred or stored to the application",
    AbortCode.DEVICE_STATE: "data cannot be transferred because of the present device state",
    AbortCode.NO_DATA: "no data available",
}
"""SDO abort codes in words."""


class SdoAborted(ProtocolError):
    """A transfer ended with an abort: by the server, or by us because its answer broke the protocol."""

    def __init__(self, index: int, subindex: int, code: int, by_server: bool = True) -> None:
        self.index, self.subindex, self.code, self.by_server = index, subindex, code, by_server
        who = "aborted by the server" if by_server else "aborted by the client"
        text = ABORT_TEXT.get(code, "unknown abort code")
        super().__init__(f"SDO 0x{index:04X}:{subindex:02X} {who}: 0x{code:08X} {text}")


def abort_request(index: int, subindex: int, code: int) -> bytes:
    """The abort message that a client sends."""
    return struct.pack("<BHBI", 0x80, index, subindex, code)


def upload(index: int, subindex: int, largest: int = LARGEST_UPLOAD) -> Transfer:
    """Read an object of at most `largest` bytes. Raises `SdoAborted`."""
    response = yield _HEAD.pack(0x40, index, subindex) + bytes(4)
    command = _checked(response, index, subindex, 0x40)
    if command & _EXPEDITED:
        size = 4 - (command >> 2 & 3) if command & _SIZED else 4
        return bytes(response[4 : 4 + size])
    announced = struct.unpack_from("<I", response, 4)[0] if command & _SIZED else None
    if announced is not None and announced > largest:
        raise SdoAborted(index, subindex, AbortCode.OUT_OF_MEMORY, by_server=False)
    value, toggle = bytearray(), 0
    while True:
        response = yield bytes((0x60 | toggle,)) + bytes(7)
        command = _checked(response, index, subindex, 0x00, toggle)
        value += response[1 : 8 - (command >> 1 & 7)]
        if len(value) > largest:
            raise SdoAborted(index, subindex, AbortCode.OUT_OF_MEMORY, by_server=False)
        is_last = bool(command & _LAST)
        if announced is not None and (len(value) > announced or (is_last and len(value) < announced)):
            raise SdoAborted(index, subindex, AbortCode.LENGTH, by_server=False)
        if is_last:
            return bytes(value)
        toggle ^= _TOGGLE


def download(index: int, subindex: int, value: bytes) -> Transfer:
    """Write an object. Raises `SdoAborted`."""
    size = len(value)
    if 0 < size <= 4:
        command = 0x20 | (4 - size) << 2 | _EXPEDITED | _SIZED
        response = yield _HEAD.pack(command, index, subindex) + value.ljust(4, b"\0")
        _checked(response, index, subindex, 0x60)
        return b""
    response = yield _HEAD.pack(0x20 | _SIZED, index, subindex) + struct.pack("<I", size)
    _checked(response, index, subindex, 0x60)
    toggle = 0
    for start in range(0, max(size, 1), 7):
        part = value[start : start + 7]
        command = toggle | (7 - len(part)) << 1 | (_LAST if start + 7 >= size else 0)
        response = yield bytes((command,)) + part.ljust(7, b"\0")
        _checked(response, index, subindex, 0x20, toggle)
        toggle ^= _TOGGLE
    return b""


def _checked(response: bytes, index: int, subindex: int, expected: int, toggle: int | None = None) -> int:
    """The response's command byte, checked to be the answer to our request."""
    if len(response) != 8:
        raise SdoAborted(index, subindex, AbortCode.LENGTH, by_server=False)
    command = response[0]
    if command & 0xE0 == 0x80:
        raise SdoAborted(index, subindex, struct.unpack_from("<I", response, 4)[0])
    if command & 0xE0 != expected:
        raise SdoAborted(index, subindex, AbortCode.COMMAND, by_server=False)
    if toggle is None:
        if _HEAD.unpack_from(response)[1:] != (index, subindex):
            raise SdoAborted(index, subindex, AbortCode.COMMAND, by_server=False)
    elif command & _TOGGLE != toggle:
        raise SdoAborted(index, subindex, AbortCode.TOGGLE, by_server=False)
    return command
