"""The server's side of SDO transfers (CiA 301, 7.2.4), expedited and segmented: request in, answer out.

Block transfer is refused with the abort code that tells a client to fall back on segments. Objects and their rules
belong to the store.
"""

import struct
from dataclasses import dataclass, field

from canarm_protocol.canopen.sdo import AbortCode

from .store import ObjectStore, SdoRefused

LARGEST_DOWNLOAD = 1 << 20
"""Bytes of one download that are taken; no object here is longer."""

_HEAD = struct.Struct("<BHB")
_EXPEDITED, _SIZED, _TOGGLE, _LAST = 0x02, 0x01, 0x10, 0x01
_SEGMENT = 7


@dataclass(slots=True)
class _Transfer:
    """A segmented transfer that is under way. An upload holds what is left to send, a download what has come."""

    index: int
    subindex: int
    is_upload: bool
    data: bytearray = field(default_factory=bytearray)
    announced: int | None = None
    length: int | None = None
    """Bytes of the object, where it has a fixed length."""
    toggle: int = 0


class SdoServer:
    """One SDO channel of a node: the state between two requests of its client."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._transfer: _Transfer | None = None

    def reset(self) -> None:
        """Forget a transfer that is under way."""
        self._transfer = None

    def answer(self, request: bytes) -> bytes | None:
        """The answer to eight bytes of a client; None to an abort."""
        command, index, subindex = _HEAD.unpack_from(request)
        specifier = command >> 5
        if specifier in (0, 3):  # a segment, which names no object
            index, subindex = 0, 0
            if self._transfer is not None:
                index, subindex = self._transfer.index, self._transfer.subindex
        try:
            if specifier == 0:
                return self._download_segment(command, request)
            if specifier == 1:
                return self._start_download(command, index, subindex, request)
            if specifier == 2:
                return self._start_upload(index, subindex)
            if specifier == 3:
                return self._upload_segment(command)
            if specifier == 4:
                self._transfer = None
                return None
            raise SdoRefused(AbortCode.COMMAND)
        except SdoRefused as refusal:
            self._transfer = None
            return struct.pack("<BHBI", 0x80, index, subindex, refusal.code)

    def refuse(self, request: bytes, code: AbortCode) -> bytes | None:
        """An abort with `code` whatever is asked for; nothing is read or written. None to an abort."""
        command, index, subindex = _HEAD.unpack_from(request)
        transfer, self._transfer = self._transfer, None
        if command >> 5 == 4:
            return None
        if command >> 5 in (0, 3):
            index, subindex = (transfer.index, transfer.subindex) if transfer is not None else (0, 0)
        return struct.pack("<BHBI", 0x80, index, subindex, code)

    def _start_upload(self, index: int, subindex: int) -> bytes:
        self._transfer = None
        data = self._store.read(index, subindex)
        size = len(data)
        if not size:
            raise SdoRefused(AbortCode.NO_DATA)
        if size <= 4:
            return _HEAD.pack(0x40 | (4 - size) << 2 | _EXPEDITED | _SIZED, index, subindex) + data.ljust(4, b"\0")
        self._transfer = _Transfer(index, subindex, True, bytearray(data))
        return _HEAD.pack(0x40 | _SIZED, index, subindex) + struct.pack("<I", size)

    def _upload_segment(self, command: int) -> bytes:
        transfer = self._continued(command, is_upload=True)
        part = bytes(transfer.data[:_SEGMENT])
        del transfer.data[:_SEGMENT]
        if not transfer.data:
            self._transfer = None
        answer = command & _TOGGLE | (_SEGMENT - len(part)) << 1 | (0 if transfer.data else _LAST)
        return bytes((answer,)) + part.ljust(_SEGMENT, b"\0")

    def _start_download(self, command: int, index: int, subindex: int, request: bytes) -> bytes:
        self._transfer = None
        if command & _EXPEDITED:
            size = 4 - (command >> 2 & 3) if command & _SIZED else self._size_of(index, subindex)
            self._store.write(index, subindex, bytes(request[4 : 4 + size]))
        else:
            self._store.check_writable(index, subindex)
            announced = struct.unpack_from("<I", request, 4)[0] if command & _SIZED else None
            length = self._length(index, subindex)
            if announced is not None and length is not None and announced != length:
                raise SdoRefused(AbortCode.TOO_LONG if announced > length else AbortCode.TOO_SHORT)
            if announced is not None and announced > LARGEST_DOWNLOAD:
                raise SdoRefused(AbortCode.OUT_OF_MEMORY)
            self._transfer = _Transfer(index, subindex, False, announced=announced, length=length)
        return _HEAD.pack(0x60, index, subindex) + bytes(4)

    def _download_segment(self, command: int, request: bytes) -> bytes:
        transfer = self._continued(command, is_upload=False)
        transfer.data += request[1 : 8 - (command >> 1 & 7)]
        size, announced = len(transfer.data), transfer.announced
        if transfer.length is not None and size > transfer.length:
            raise SdoRefused(AbortCode.TOO_LONG)
        if announced is None and size > LARGEST_DOWNLOAD:
            raise SdoRefused(AbortCode.OUT_OF_MEMORY)
        if announced is not None and (size > announced or (command & _LAST and size < announced)):
            raise SdoRefused(AbortCode.LENGTH)
        if command & _LAST:
            self._store.write(transfer.index, transfer.subindex, bytes(transfer.data))
            self._transfer = None
        return bytes((0x20 | command & _TOGGLE,)) + bytes(_SEGMENT)

    def _continued(self, command: int, is_upload: bool) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.is_upload is not is_upload:
            raise SdoRefused(AbortCode.COMMAND)
        if command & _TOGGLE != transfer.toggle:
            raise SdoRefused(AbortCode.TOGGLE)
        transfer.toggle ^= _TOGGLE
        return transfer

    def _size_of(self, index: int, subindex: int) -> int:
        """Bytes that count in an expedited download that does not say: as many as the object has, four at most."""
        return min(self._length(index, subindex) or 4, 4)

    def _length(self, index: int, subindex: int) -> int | None:
        """Bytes of an object that always has as many."""
        variable = self._store.variable(index, subindex)
        return len(variable) // 8 if variable.fixed_size else None
