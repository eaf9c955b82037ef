"""CAN frames and the CANopen messages that are not PDOs or SDOs: NMT, SYNC, TIME, EMCY, heartbeat (CiA 301).

Values only: nothing here knows a bus, a clock or a node's state.
"""

import functools
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from ..errors import FrameError

ERROR_FLAG = 0x2000_0000
"""Marks the `can_id` of an error frame; it is above all identifiers (CAN_ERR_FLAG of linux/can.h)."""
EXTENDED_FLAG = 0x2000_0000
"""Marks a COB-ID in an object as a 29-bit identifier (CiA 301, 7.5.2.35, bit 29)."""
HIGHEST_NODE_ID = 0x7F
"""Node-IDs are 1 to 127 (CiA 301, 7.3.3). As a mask it takes the node-ID out of a predefined COB-ID."""


class Frame(NamedTuple):
    """A classical CAN frame. `can_id` has 11 bits, or 29 when `is_extended`.

    A remote frame carries no data: only the length of its `data` counts, the length that it asks for (DLC).

    An error frame looks as in Linux: `ERROR_FLAG` and the error classes in `can_id`, and 8 bytes of details.
    """

    can_id: int
    data: bytes = b""
    is_extended: bool = False
    is_remote: bool = False

    @property
    def is_error(self) -> bool:
        """Whether it reports an error on the bus. Such a frame is never sent."""
        return self.can_id >= ERROR_FLAG


_new = tuple.__new__  # takes a third of the time of a named tuple's own


def data_frame(can_id: int, data: bytes) -> Frame:
    """`Frame(can_id, data)`, faster, for frames that are sent every cycle."""
    return _new(Frame, (can_id, data, False, False))


class Cob(IntEnum):
    """COB-IDs of the predefined connection set (CiA 301, 7.3.3). For a node's messages, add its node-ID."""

    NMT = 0x000
    SYNC = 0x080
    EMERGENCY = 0x080
    TIME = 0x100
    SDO_TO_CLIENT = 0x580
    SDO_TO_SERVER = 0x600
    HEARTBEAT = 0x700


class NmtCommand(IntEnum):
    """NMT node control commands (CiA 301, 7.2.8.3.1)."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """NMT states as a heartbeat carries them (CiA 301, 7.2.8.3.2.2). `BOOT_UP` is the boot-up message."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class ErrorCode(IntEnum):
    """EMCY error codes in use (CiA 301, table 26)."""

    NO_ERROR = 0x0000
    ERROR_PASSIVE = 0x8120
    LIFE_GUARD_OR_HEARTBEAT = 0x8130
    RECOVERED_FROM_BUS_OFF = 0x8140
    PDO_LENGTH = 0x8210
    SYNC_LENGTH = 0x8240
    RPDO_TIMEOUT = 0x8250
    OUTPUT_REFUSED = 0xFF00
    """Device-specific: an RPDO asks for outputs that the device never gives."""


@dataclass(frozen=True, slots=True)
class Emergency:
    """An EMCY message: error code, error register (0x1001), five manufacturer-specific bytes."""

    code: int
    register: int
    manufacturer: bytes = bytes(5)

    def frame(self, node_id: int) -> Frame:
        """The message as sent by `node_id`."""
        return Frame(Cob.EMERGENCY + node_id, struct.pack("<HB5s", self.code, self.register, self.manufacturer))

    @classmethod
    def parse(cls, data: bytes) -> "Emergency":
        """Decode eight bytes. Raises `FrameError` on another length."""
        if len(data) != 8:
            raise FrameError(f"EMCY with {len(data)} bytes; CiA 301 says 8")
        return cls(*struct.unpack("<HB5s", data))


def nmt_frame(command: NmtCommand, node_id: int = 0) -> Frame:
    """NMT node control for one node, or for all with `node_id` 0."""
    return Frame(Cob.NMT, bytes((command, node_id)))


def parse_nmt(data: bytes) -> tuple[NmtCommand, int]:
    """Command and node-ID (0 = all) of an NMT message. Raises `FrameError`."""
    if len(data) != 2:
        raise FrameError(f"NMT command with {len(data)} bytes; CiA 301 says 2")
    try:
        return NmtCommand(data[0]), data[1]
    except ValueError:
        raise FrameError(f"NMT command specifier 0x{data[0]:02X} is not one of CiA 301's") from None


@functools.cache
def sync_frame(counter: int | None) -> Frame:
    """SYNC, with its counter (1 to 240) or without."""
    return Frame(Cob.SYNC, b"" if counter is None else bytes((counter,)))


@functools.cache
def heartbeat_frame(node_id: int, state: NmtState) -> Frame:
    """Heartbeat of `node_id`; with `NmtState.BOOT_UP` its boot-up message."""
    return Frame(Cob.HEARTBEAT + node_id, bytes((state,)))


DAY_NS = 86_400 * 10**9
_TIME = Cob.TIME
_TIME_OF_DAY = struct.Struct("<IH")
_pack_time, _unpack_time = _TIME_OF_DAY.pack, _TIME_OF_DAY.unpack


def time_frame(time_ns: int) -> Frame:
    """TIME object: milliseconds after midnight (28 bit) and days since 1984-01-01 (16 bit) of `time_ns`."""
    days, of_day = divmod(time_ns, DAY_NS)
    return data_frame(_TIME, _pack_time(of_day // 1_000_000, days & 0xFFFF))


def parse_time(data: bytes) -> int:
    """Time in ns, to the millisecond, of a TIME object. Raises `FrameError`."""
    if len(data) != 6:
        raise FrameError(f"TIME with {len(data)} bytes; CiA 301 says 6")
    milliseconds, days = _unpack_time(data)
    return int((milliseconds & 0x0FFF_FFFF) * 1_000_000 + days * DAY_NS)
