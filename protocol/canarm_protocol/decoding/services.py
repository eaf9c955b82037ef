"""NMT, SYNC, TIME, EMCY and heartbeat in words (CiA 301). Data that break the protocol are named, never refused."""

from collections.abc import Callable

from ..canopen.frames import DAY_NS, Emergency, NmtCommand, NmtState, parse_time
from ..errors import FrameError
from .meaning import Field, Meaning, Sort

_RESERVED_TOGGLE = 0x80
"""Bit 7 of node guarding's answer toggles; in a heartbeat it is 0 (CiA 301, 7.2.8.3.2.1)."""
EMERGENCY_TEXTS: dict[int, str] = {
    0x0000: "no error, or error reset",
    0x1000: "generic error",
    0x2000: "current",
    0x2100: "current, device input side",
    0x2200: "current inside the device",
    0x2300: "current, device output side",
    0x3000: "voltage",
    0x3100: "mains voltage",
    0x3200: "voltage inside the device",
    0x3300: "output voltage",
    0x4000: "temperature",
    0x4100: "ambient temperature",
    0x4200: "device temperature",
    0x5000: "device hardware",
    0x6000: "device software",
    0x6100: "internal software",
    0x6200: "user software",
    0x6300: "data set",
    0x7000: "additional modules",
    0x8000: "monitoring",
    0x8100: "communication",
    0x8110: "CAN overrun, objects lost",
    0x8120: "CAN in error-passive mode",
    0x8130: "life guard or heartbeat error",
    0x8140: "recovered from bus-off",
    0x8150: "CAN-ID collision",
    0x8200: "protocol error",
    0x8210: "PDO not processed, length error",
    0x8220: "PDO length exceeded",
    0x8230: "DAM MPDO not processed, destination object not available",
    0x8240: "unexpected SYNC data length",
    0x8250: "RPDO timeout",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "device-specific",
}
"""EMCY error codes (CiA 301, table 26)."""
LARGEST_NO_ERROR = 0x00FF
"""The class 0x00xx; what is between it and 0x1000 is reserved."""
ERROR_REGISTER_BITS = (
    "generic",
    "current",
    "voltage",
    "temperature",
    "communication",
    "device profile",
    "reserved",
    "manufacturer",
)
"""The bits of 0x1001 (CiA 301, table 48)."""


def emergency_text(code: int) -> str:
    """An EMCY error code in words: its own, or those of its class."""
    for mask in (0xFFFF, 0xFF00, 0xF000):
        if code & mask in EMERGENCY_TEXTS and (code & mask or code <= LARGEST_NO_ERROR):
            return EMERGENCY_TEXTS[code & mask]
    return "reserved code"


def register_text(register: int) -> str:
    """The bits of an error register that are set."""
    return ", ".join(name for bit, name in enumerate(ERROR_REGISTER_BITS) if register >> bit & 1) or "none"


def state_name(state: NmtState | NmtCommand) -> str:
    """A state or a command as CiA 301 spells it."""
    return state.name.lower().replace("_", "-")


def nmt(data: bytes, name_of: Callable[[int], str]) -> Meaning:
    """NMT node control."""
    if len(data) != 2:
        return Meaning(Sort.NMT, "NMT", said=f"malformed: {len(data)} bytes instead of 2", is_wrong=True)
    to = name_of(data[1]) if data[1] else "all nodes"
    try:
        command, is_wrong = state_name(NmtCommand(data[0])), False
    except ValueError:
        command, is_wrong = f"unknown command 0x{data[0]:02X}", True
    fields = Field("command", command, 0, 8), Field("node", to, 8, 8)
    return Meaning(Sort.NMT, "NMT", fields, f"{command} to {to}", is_wrong)


def sync(data: bytes) -> Meaning:
    """SYNC, with or without its counter."""
    if not data:
        return Meaning(Sort.SYNC, "SYNC")
    if len(data) == 1:
        return Meaning(Sort.SYNC, "SYNC", (Field("counter", str(data[0]), 0, 8),))
    return Meaning(Sort.SYNC, "SYNC", said=f"malformed: {len(data)} bytes instead of 0 or 1", is_wrong=True)


def time(data: bytes) -> Meaning:
    """TIME of day, since midnight of a day of 1984."""
    try:
        days, of_day = divmod(parse_time(data), DAY_NS)
    except FrameError:
        return Meaning(Sort.TIME, "TIME", said=f"malformed: {len(data)} bytes instead of 6", is_wrong=True)
    fields = Field("since midnight", f"{of_day * 1e-9:.3f} s", 0, 28), Field("day", str(days), 32, 16)
    return Meaning(Sort.TIME, "TIME", fields)


def emergency(data: bytes, name: str) -> Meaning:
    """EMCY of a node. Every one but the reset of an error is marked."""
    title = f"EMCY of {name}"
    try:
        message = Emergency.parse(data)
    except FrameError:
        return Meaning(Sort.EMERGENCY, title, said=f"malformed: {len(data)} bytes instead of 8", is_wrong=True)
    fields = (
        Field("code", f"0x{message.code:04X} {emergency_text(message.code)}", 0, 16),
        Field("error register", f"0x{message.register:02X} {register_text(message.register)}", 16, 8),
        Field("manufacturer", message.manufacturer.hex(" "), 24, 40),
    )
    said = f"0x{message.code:04X} {emergency_text(message.code)}"
    if message.register:
        said += f", error register 0x{message.register:02X} ({register_text(message.register)})"
    if any(message.manufacturer):
        said += f", {message.manufacturer.hex(' ')}"
    return Meaning(Sort.EMERGENCY, title, fields, said, message.code != 0)


def heartbeat(data: bytes, name: str) -> Meaning:
    """Heartbeat, boot-up message or node guarding of a node."""
    title = f"heartbeat of {name}"
    if len(data) != 1:
        return Meaning(Sort.HEARTBEAT, title, said=f"malformed: {len(data)} bytes instead of 1", is_wrong=True)
    try:
        text, is_wrong = state_name(NmtState(data[0] & ~_RESERVED_TOGGLE)), False
    except ValueError:
        text, is_wrong = f"unknown state 0x{data[0]:02X}", True
    return Meaning(Sort.HEARTBEAT, title, (Field("state", text, 0, 7),), text, is_wrong)
