"""The server's side of SDO transfers (CiA 301, 7.2.4), expedited, segmented and in blocks: request in, answers out.

Block transfers are in `sdo_block`, objects and their rules in the store.
"""

import struct
from dataclasses import dataclass, field

from canarm_protocol.canopen.dictionary import variable_at
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.canopen.sdo import AbortCode

from ..timing import MILLISECOND
from .sdo_block import INITIATE_DOWNLOAD, INITIATE_UPLOAD, BlockDownload, BlockUpload, checked_segments
from .store import ObjectStore, SdoRefused

BLOCK_TIMEOUT_NS = 3000 * MILLISECOND
"""After this silence a frame that could be both the next segment of a block download and a new request is the request.

Sooner, and in lockstep, where time stands still, a request for an object that exists is known by its sequence number,
which is not the next one. Nothing else ends a transfer that its client neither continues nor aborts: it may take its
time.
"""
LARGEST_DOWNLOAD = 1 << 20
"""Most bytes of a download; no object here is longer."""

SERVER_PARAMETERS = range(0x1200, 0x1280)
ABORT = 0x80
_BLOCK_CRC, _BLOCK_SIZED = 0x04, 0x02
_HEAD = struct.Struct("<BHB")
_EXPEDITED, _SIZED, _TOGGLE, _LAST = 0x02, 0x01, 0x10, 0x01
_SEGMENT = 7


class SdoServers:
    """The SDO channels of a node, as its dictionary has them (0x1200 and up), by the COB-IDs that they listen on."""

    def __init__(self, store: ObjectStore) -> None:
        dictionary = store.dictionary
        self._servers = {
            dictionary[index][1].default: (SdoServer(store), dictionary[index][2].default)
            for index in SERVER_PARAMETERS
            if index in dictionary
        }

    @property
    def cob_ids(self) -> list[int]:
        """COB-IDs of the clients' requests."""
        return list(self._servers)

    def reset(self) -> None:
        """Forget the transfers that are under way."""
        for server, _ in self._servers.values():
            server.reset()

    def answer(self, cob_id: int, request: bytes, now_ns: int) -> list[Frame]:
        """The answers to eight bytes that came with `cob_id`."""
        server, answer_id = self._servers[cob_id]
        return [Frame(answer_id, answer) for answer in server.answer(request, now_ns)]

    def refuse(self, cob_id: int, request: bytes) -> list[Frame]:
        """An abort, whatever the request on `cob_id`."""
        server, answer_id = self._servers[cob_id]
        refusal = server.refuse(request, AbortCode.GENERAL)
        return [] if refusal is None else [Frame(answer_id, refusal)]


@dataclass(slots=True)
class _Transfer:
    """A segmented transfer in progress. An upload holds what is left to send, a download what has arrived."""

    index: int
    subindex: int
    is_upload: bool
    data: bytearray = field(default_factory=bytearray)
    announced: int | None = None
    length: int | None = None
    """Bytes of the object, if its length is fixed."""
    toggle: int = 0


class SdoServer:
    """One SDO channel of a node: the state between two requests of its client."""

    def __init__(self, store: ObjectStore) -> None:
        self._store = store
        self._transfer: _Transfer | BlockDownload | BlockUpload | None = None
        self._heard_ns = 0

    def reset(self) -> None:
        """Forget a transfer that is under way."""
        self._transfer = None

    def answer(self, request: bytes, now_ns: int) -> list[bytes]:
        """The answers to eight bytes of a client: normally one, none to an abort, many within a block."""
        transfer, silence_ns = self._transfer, now_ns - self._heard_ns
        self._heard_ns = now_ns
        if isinstance(transfer, BlockDownload | BlockUpload):
            if request[0] != ABORT and self._belongs_to_block(request, transfer, silence_ns):
                try:
                    return self._continue_block(request, transfer)
                except SdoRefused as refusal:
                    self._transfer = None
                    return [struct.pack("<BHBI", ABORT, transfer.index, transfer.subindex, refusal.code)]
            self._transfer = None
        answer = self._answer(request)
        return [] if answer is None else [answer]

    def _answer(self, request: bytes) -> bytes | None:
        command, index, subindex = _HEAD.unpack_from(request)
        specifier = command >> 5
        if specifier in (0, 3):  # a segment, which names no object
            index, subindex = 0, 0
            if isinstance(self._transfer, _Transfer):
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
            if command & ~_BLOCK_CRC == INITIATE_UPLOAD:
                return self._start_block_upload(command, index, subindex, request)
            if command & ~(_BLOCK_CRC | _BLOCK_SIZED) == INITIATE_DOWNLOAD:
                return self._start_block_download(command, index, subindex, request)
            raise SdoRefused(AbortCode.COMMAND)
        except SdoRefused as refusal:
            self._transfer = None
            return struct.pack("<BHBI", ABORT, index, subindex, refusal.code)

    def refuse(self, request: bytes, code: AbortCode) -> bytes | None:
        """An abort with `code` whatever is asked for; nothing is read or written. None to an abort."""
        command, index, subindex = _HEAD.unpack_from(request)
        transfer, self._transfer = self._transfer, None
        if command >> 5 == 4:
            return None
        if command >> 5 in (0, 3) or not isinstance(transfer, _Transfer | None):
            index, subindex = (transfer.index, transfer.subindex) if transfer is not None else (0, 0)
        return struct.pack("<BHBI", ABORT, index, subindex, code)

    def _start_block_upload(self, command: int, index: int, subindex: int, request: bytes) -> bytes:
        segments = checked_segments(request[4])
        data = self._store.read(index, subindex)
        self._transfer = BlockUpload(index, subindex, bool(command & _BLOCK_CRC), data, segments)
        return self._transfer.start()

    def _start_block_download(self, command: int, index: int, subindex: int, request: bytes) -> bytes:
        announced = struct.unpack_from("<I", request, 4)[0] if command & _BLOCK_SIZED else None
        self._check_download(index, subindex, announced)
        largest = LARGEST_DOWNLOAD if announced is None else announced
        has_crc = bool(command & _BLOCK_CRC)
        self._transfer = BlockDownload(index, subindex, has_crc, announced, largest)
        return self._transfer.start()

    def _belongs_to_block(self, request: bytes, transfer: BlockDownload | BlockUpload, silence_ns: int) -> bool:
        """Whether a request continues the transfer instead of starting another."""
        if isinstance(transfer, BlockUpload):
            return request[0] >> 5 == INITIATE_UPLOAD >> 5 and bool(request[0] & 3)
        if not transfer.takes_segments:
            return request[0] >> 5 == INITIATE_DOWNLOAD >> 5 and bool(request[0] & 1)
        if not _is_initiate(request[0]):
            return True
        if silence_ns > BLOCK_TIMEOUT_NS:
            return False
        _, index, subindex = _HEAD.unpack_from(request)
        return transfer.is_next(request) or variable_at(self._store.dictionary, index, subindex) is None

    def _continue_block(self, request: bytes, transfer: BlockDownload | BlockUpload) -> list[bytes]:
        if isinstance(transfer, BlockUpload):
            answers, is_over = transfer.answer(request)
            if is_over:
                self._transfer = None
            return answers
        if transfer.takes_segments:
            answer = transfer.segment(request)
            return [] if answer is None else [answer]
        data, answer = transfer.end(request)
        self._store.write(transfer.index, transfer.subindex, data)
        self._transfer = None
        return [answer]

    def _start_upload(self, index: int, subindex: int) -> bytes:
        self._transfer = None
        data = self._store.read(index, subindex)
        size = len(data)
        if 0 < size <= 4:
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
            announced = struct.unpack_from("<I", request, 4)[0] if command & _SIZED else None
            length = self._check_download(index, subindex, announced)
            self._transfer = _Transfer(index, subindex, False, announced=announced, length=length)
        return _HEAD.pack(0x60, index, subindex) + bytes(4)

    def _check_download(self, index: int, subindex: int, announced: int | None) -> int | None:
        """The object's length if it is fixed. Raises `SdoRefused` for what cannot be written at all."""
        self._store.check_writable(index, subindex)
        length = self._length(index, subindex)
        if announced is not None and length is not None and announced != length:
            raise SdoRefused(AbortCode.TOO_LONG if announced > length else AbortCode.TOO_SHORT)
        if announced is not None and announced > LARGEST_DOWNLOAD:
            raise SdoRefused(AbortCode.OUT_OF_MEMORY)
        return length

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
        if not isinstance(transfer, _Transfer) or transfer.is_upload is not is_upload:
            raise SdoRefused(AbortCode.COMMAND)
        if command & _TOGGLE != transfer.toggle:
            raise SdoRefused(AbortCode.TOGGLE)
        transfer.toggle ^= _TOGGLE
        return transfer

    def _size_of(self, index: int, subindex: int) -> int:
        """Length of an expedited download that does not give it: that of the object, four bytes at most."""
        return min(self._length(index, subindex) or 4, 4)

    def _length(self, index: int, subindex: int) -> int | None:
        """Bytes of an object of fixed length; None for others."""
        variable = self._store.variable(index, subindex)
        return len(variable) // 8 if variable.fixed_size else None


def _is_initiate(command: int) -> bool:
    """Whether a client's first byte can begin a transfer."""
    return (
        command >> 4 == 0x2
        or command == 0x40
        or command & ~_BLOCK_CRC == INITIATE_UPLOAD
        or command & ~(_BLOCK_CRC | _BLOCK_SIZED) == INITIATE_DOWNLOAD
    )
