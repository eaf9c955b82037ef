"""A classical CAN frame as bits on the wire (ISO 11898-1): fields, CRC-15, bit stuffing, exact and worst-case length.

Bit 0 is dominant, bit 1 recessive. Bit rates, nodes and transmission errors never enter.
"""

from functools import lru_cache

from ..canopen.frames import Frame
from ..errors import FrameError

INTERMISSION_BITS = 3
"""Recessive bits between two frames (ISO 11898-1, interframe space). No length here includes them."""
END_OF_FRAME_BITS = 7
ACK_DELIMITER_BITS = 1
TAIL_BITS = 3 + END_OF_FRAME_BITS
"""CRC delimiter, ACK slot, ACK delimiter and end of frame: sent without stuffing."""
CRC_BITS = 15
CRC_POLYNOMIAL = 0x4599
"""x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1, the leading term left out (ISO 11898-1, CRC sequence)."""
BASE_HEADER_BITS = 1 + 11 + 1 + 2 + 4
"""SOF, identifier, RTR, IDE and r0, DLC."""
EXTENDED_HEADER_BITS = 1 + 11 + 2 + 18 + 1 + 2 + 4
"""SOF, base identifier, SRR and IDE, identifier extension, RTR, r1 and r0, DLC."""
BASE_ARBITRATION_BITS, EXTENDED_ARBITRATION_BITS = 1 + 11 + 1, 1 + 11 + 2 + 18 + 1
"""SOF to RTR: bits in which a node may lose arbitration without an error."""
STUFF_RUN = 5
"""After this many equal bits the transmitter inserts one of the other value (ISO 11898-1, bit stuffing)."""

MAX_BASE_ID, MAX_EXTENDED_ID, MAX_DATA = 0x7FF, 0x1FFF_FFFF, 8
_EXTENSION_MASK = 0x3_FFFF
_CRC_MASK = 0x7FFF


@lru_cache(maxsize=1024)
def frame_bits(frame: Frame) -> int:
    """Length of `frame` from SOF to end of frame with its own stuff bits, without intermission.

    Raises `FrameError` for an identifier or a data length that classical CAN does not have.
    """
    can_id, data, is_extended, is_remote = frame
    length, crc, entry, stuffed = _after_header(can_id, len(data), is_extended, is_remote)
    if not is_remote:
        for octet in data:
            crc = _CRC[crc >> 7 ^ octet] ^ (crc << 8 & _CRC_MASK)
            entry = _STUFFING[entry & 0x700 | octet]
            stuffed += entry >> 11
    entry = _STUFFING[entry & 0x700 | crc >> 7]
    last = _STUFFING[entry & 0x700 | crc << 1 & 0xFE | ~crc & 1]
    return length + stuffed + (entry >> 11) + (last >> 11)


def worst_case_bits(data_length: int, is_extended: bool = False) -> int:
    """Bound of `frame_bits` for n data bytes: 8n + 44 + ⌊(34 + 8n - 1) / 4⌋; extended, with 64 and 54.

    Of the 34 + 8n (54 + 8n) bits exposed to stuffing, every fourth after the first may cause a stuff bit (Davis, Burns,
    Bril, Lukkien 2007, equation 1; intermission is left out here). The fixed bits of the header keep real frames a
    little below.
    """
    exposed = (EXTENDED_HEADER_BITS if is_extended else BASE_HEADER_BITS) + 8 * data_length + CRC_BITS
    return exposed + TAIL_BITS + (exposed - 1) // (STUFF_RUN - 1)


def arbitration_key(frame: Frame) -> int:
    """The arbitration field as a number: the lowest wins among frames that start together.

    With the same base identifier a data frame beats a remote frame, and both beat every extended frame (RTR, IDE
    dominant).
    """
    can_id = frame.can_id
    if frame.is_extended:
        return (can_id >> 18) << 21 | 3 << 19 | (can_id & _EXTENSION_MASK) << 1 | frame.is_remote
    return can_id << 21 | frame.is_remote << 20


def identifier(key: int) -> tuple[int, bool]:
    """Identifier of an `arbitration_key`, and whether it is extended."""
    base = key >> 21
    return (base << 18 | key >> 1 & _EXTENSION_MASK, True) if key >> 19 & 1 else (base, False)


def crc15(octets: bytes) -> int:
    """CRC-15 over whole bytes. Leading zero bits change nothing, so any field may be padded in front."""
    crc = 0
    for octet in octets:
        crc = _CRC[crc >> 7 ^ octet] ^ (crc << 8 & _CRC_MASK)
    return crc


def wire_bits(frame: Frame) -> str:
    """Every bit of `frame`, SOF to end of frame, as a string of `0` and `1`; the ACK slot as the transmitter sends it.

    Raises `FrameError` as `frame_bits`.
    """
    header, length = _header(frame.can_id, len(frame.data), frame.is_extended, frame.is_remote)
    data = b"" if frame.is_remote else frame.data
    stream = header << 8 * len(data) | int.from_bytes(data, "big")
    length += 8 * len(data)
    crc = crc15(stream.to_bytes((length + 7) >> 3, "big"))
    return stuff(f"{stream:0{length}b}{crc:0{CRC_BITS}b}") + "1" * TAIL_BITS


def arbitration_bits(frame: Frame) -> int:
    """How many of `wire_bits` belong to SOF and arbitration field, stuff bits included."""
    exposed = EXTENDED_ARBITRATION_BITS if frame.is_extended else BASE_ARBITRATION_BITS
    header, length = _header(frame.can_id, 0, frame.is_extended, frame.is_remote)
    return len(stuff(f"{header:0{length}b}"[:exposed]))


def stuff(bits: str) -> str:
    """`bits` with the complement inserted after every five equal bits, counting inserted ones (ISO 11898-1)."""
    sent: list[str] = []
    last, run = "", 0
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        sent.append(bit)
        if run == STUFF_RUN:
            last, run = "1" if bit == "0" else "0", 1
            sent.append(last)
    return "".join(sent)


def _header(can_id: int, size: int, is_extended: bool, is_remote: bool) -> tuple[int, int]:
    """SOF to DLC as a number, and its length in bits."""
    if size > MAX_DATA:
        raise FrameError(f"frame 0x{can_id:X} with {size} bytes; classical CAN carries at most {MAX_DATA}")
    if not 0 <= can_id <= (MAX_EXTENDED_ID if is_extended else MAX_BASE_ID):
        raise FrameError(f"identifier 0x{can_id:X} does not fit {29 if is_extended else 11} bits")
    control = is_remote << 6 | size
    if is_extended:
        return (can_id >> 18) << 27 | 3 << 25 | (can_id & _EXTENSION_MASK) << 7 | control, EXTENDED_HEADER_BITS
    return can_id << 7 | control, BASE_HEADER_BITS


@lru_cache(maxsize=4096)
def _after_header(can_id: int, size: int, is_extended: bool, is_remote: bool) -> tuple[int, int, int, int]:
    """Length of the frame before stuffing; CRC, entry of the stuffing table and stuff bits after its header.

    The bits that pad the first byte in front of SOF alternate and end in 1: no stuff bit, and no run into SOF.
    """
    header, length = _header(can_id, size, is_extended, is_remote)
    octets = (length + 7) >> 3
    crc = crc15(header.to_bytes(octets, "big"))
    filling = 0x55 & (1 << 8 * octets - length) - 1
    entry = stuffed = 0
    for octet in (filling << length | header).to_bytes(octets, "big"):
        entry = _STUFFING[entry & 0x700 | octet]
        stuffed += entry >> 11
    return length + 8 * size * (not is_remote) + CRC_BITS + TAIL_BITS, crc, entry, stuffed


def _crc_table() -> list[int]:
    table = []
    for octet in range(256):
        crc = octet << 7
        for _ in range(8):
            crc = (crc << 1 ^ CRC_POLYNOMIAL if crc & 0x4000 else crc << 1) & _CRC_MASK
        table.append(crc)
    return table


def _stuffing_table() -> list[int]:
    """Stuff bits byte by byte: the index is state << 8 | byte, the entry stuff bits << 11 | next state << 8.

    A state is value << 2 | run - 1 of the run of equal bits at the end of the bytes so far; a run of five ends in its
    stuff bit, which begins the next run.
    """
    table = []
    for state in range(8):
        for octet in range(256):
            value, run, stuffed = state >> 2, (state & 3) + 1, 0
            for shift in range(7, -1, -1):
                bit = octet >> shift & 1
                run = run + 1 if bit == value else 1
                value = bit
                if run == STUFF_RUN:
                    value, run, stuffed = 1 - bit, 1, stuffed + 1
            table.append(stuffed << 11 | value << 10 | run - 1 << 8)
    return table


_CRC = _crc_table()
_STUFFING = _stuffing_table()
