"""SDO block transfer, the server's side (CiA 301, 7.2.4.3.10 to 7.2.4.3.16): sub-blocks of 7-byte segments, with CRC.

The client's frames in, the server's frames out. `sdo_server` decides about objects, whose values are in the store.
"""

import binascii
import struct
from dataclasses import dataclass, field
from enum import Enum

from canarm_protocol.canopen.sdo import AbortCode

from .store import SdoRefused

INITIATE_DOWNLOAD, INITIATE_UPLOAD = 0xC0, 0xA0
"""Upper three bits of the client's command bytes, and of the server's answers for the other direction."""
MOST_SEGMENTS = 127
"""Most segments of a sub-block, and the number that this server asks for."""
_SEGMENT = 7
_LAST, _SEQUENCE = 0x80, 0x7F
_CRC, _SIZED, _END, _RESPONSE, _START = 0x04, 0x02, 0x01, 0x02, 0x03
_SUBCOMMAND = 0x03
_HEAD = struct.Struct("<BHB")


def crc_of(data: bytes) -> int:
    """CRC-16 with the polynomial x^16 + x^12 + x^5 + 1, from 0 (CiA 301, 7.2.4.3.16)."""
    return binascii.crc_hqx(data, 0)


class _Stage(Enum):
    SEGMENTS = "segments"
    END = "end"


@dataclass(slots=True)
class BlockDownload:
    """A client writes an object. `largest` bounds its bytes."""

    index: int
    subindex: int
    has_crc: bool
    announced: int | None
    largest: int
    data: bytearray = field(default_factory=bytearray)
    _sequence: int = 0
    _stage: _Stage = _Stage.SEGMENTS

    @property
    def takes_segments(self) -> bool:
        """Whether a frame of the client is a segment, whatever its first byte."""
        return self._stage is _Stage.SEGMENTS

    def is_next(self, frame: bytes) -> bool:
        """Whether a frame has the sequence number of the segment that is to come."""
        return frame[0] & _SEQUENCE == self._sequence + 1

    def start(self) -> bytes:
        """The answer to the client's first request."""
        crc = _CRC if self.has_crc else 0
        return _HEAD.pack(INITIATE_UPLOAD | crc, self.index, self.subindex) + bytes((MOST_SEGMENTS, 0, 0, 0))

    def segment(self, frame: bytes) -> bytes | None:
        """Take a segment; returns the answer at the end of a sub-block. Segments after a lost one are requested again.

        Raises `SdoRefused`.
        """
        sequence, is_last = frame[0] & _SEQUENCE, bool(frame[0] & _LAST)
        is_next = self.is_next(frame)
        if is_next:
            self._sequence = sequence
            self.data += frame[1:8]
            if len(self.data) > self.largest + _SEGMENT:
                raise SdoRefused(AbortCode.OUT_OF_MEMORY)
        if not is_last and sequence != MOST_SEGMENTS:
            return None
        if is_last and is_next:
            self._stage = _Stage.END
        received, self._sequence = self._sequence, 0
        return bytes((INITIATE_UPLOAD | _RESPONSE, received, MOST_SEGMENTS)) + bytes(5)

    def end(self, frame: bytes) -> tuple[bytes, bytes]:
        """The client's last request: the object's bytes, and the answer. Raises `SdoRefused`."""
        if frame[0] & _SUBCOMMAND != _END or not self.data:
            raise SdoRefused(AbortCode.COMMAND)
        data = bytes(self.data[: len(self.data) - (frame[0] >> 2 & 7)])
        if self.announced is not None and len(data) != self.announced:
            raise SdoRefused(AbortCode.TOO_LONG if len(data) > self.announced else AbortCode.TOO_SHORT)
        if self.has_crc and crc_of(data) != struct.unpack_from("<H", frame, 1)[0]:
            raise SdoRefused(AbortCode.CRC)
        return data, bytes((INITIATE_UPLOAD | _END,)) + bytes(7)


@dataclass(slots=True)
class BlockUpload:
    """A client reads an object, whose bytes are `data`."""

    index: int
    subindex: int
    has_crc: bool
    data: bytes
    segments: int
    """Segments per sub-block, as requested by the client."""
    _sent: int = 0
    _stage: _Stage | None = None

    def start(self) -> bytes:
        """The answer to the client's first request."""
        crc = _CRC if self.has_crc else 0
        head = _HEAD.pack(INITIATE_DOWNLOAD | crc | _SIZED, self.index, self.subindex)
        return head + struct.pack("<I", len(self.data))

    def answer(self, frame: bytes) -> tuple[list[bytes], bool]:
        """The server's frames for the client's next request, and whether it was the last. Raises `SdoRefused`."""
        command = frame[0] & _SUBCOMMAND
        if command == _START and self._stage is None:
            self._stage = _Stage.SEGMENTS
            return self._sub_block(), False
        if command == _RESPONSE and self._stage is _Stage.SEGMENTS:
            self._acknowledge(frame[1], frame[2])
            if self._sent < max(len(self.data), 1):
                return self._sub_block(), False
            self._stage = _Stage.END
            empty = -len(self.data) % _SEGMENT if self.data else _SEGMENT
            crc = crc_of(self.data) if self.has_crc else 0
            return [struct.pack("<BH", INITIATE_DOWNLOAD | empty << 2 | _END, crc) + bytes(5)], False
        if command == _END and self._stage is _Stage.END:
            return [], True
        raise SdoRefused(AbortCode.COMMAND)

    def _acknowledge(self, received: int, segments: int) -> None:
        """The client has received this many segments of the sub-block; the rest is sent again."""
        if received > self.segments:
            raise SdoRefused(AbortCode.SEQUENCE)
        self._sent = min(self._sent + received * _SEGMENT, max(len(self.data), 1))
        self.segments = checked_segments(segments)

    def _sub_block(self) -> list[bytes]:
        left = self.data[self._sent : self._sent + self.segments * _SEGMENT]
        parts = [left[start : start + _SEGMENT] for start in range(0, max(len(left), 1), _SEGMENT)]
        is_end = self._sent + len(left) >= len(self.data)
        frames = []
        for sequence, part in enumerate(parts, start=1):
            last = _LAST if is_end and sequence == len(parts) else 0
            frames.append(bytes((last | sequence,)) + part.ljust(_SEGMENT, b"\0"))
        return frames


def checked_segments(count: int) -> int:
    """The segments per sub-block that a client requests. Raises `SdoRefused` unless it is 1 to `MOST_SEGMENTS`."""
    if not 1 <= count <= MOST_SEGMENTS:
        raise SdoRefused(AbortCode.BLOCK_SIZE)
    return count
