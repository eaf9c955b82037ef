"""Events of the wire model as error frames of SocketCAN.

Classes and details are those of linux/can/error.h, combined as Linux drivers do.
"""

from enum import IntFlag

from canarm_protocol.canopen.frames import ERROR_FLAG, Frame

from .confinement import PASSIVE_LIMIT, ErrorKind, ErrorState
from .wire_events import ErrorFrame, StateChange
from .wire_node import WireNode


class ErrorClass(IntFlag):
    """Error classes in `can_id` (linux/can/error.h, CAN_ERR_*)."""

    CRTL = 0x004
    PROT = 0x008
    ACK = 0x020
    BUSOFF = 0x040
    BUSERROR = 0x080
    RESTARTED = 0x100
    CNT = 0x200


TX_PASSIVE, RX_PASSIVE, ACTIVE = 0x20, 0x10, 0x40
"""Byte 1 (CAN_ERR_CRTL_*)."""
TYPE_BIT, TYPE_TX = 0x01, 0x80
"""Byte 2 (CAN_ERR_PROT_*): a bit was wrong; it happened while sending."""
LOCATION_CRC, LOCATION_ACK = 0x08, 0x19
"""Byte 3 (CAN_ERR_PROT_LOC_*): CRC sequence, ACK slot."""

_PROTOCOL_ERRORS = {
    ErrorKind.BIT: (ErrorClass(0), TYPE_BIT, 0),
    ErrorKind.CRC: (ErrorClass(0), 0, LOCATION_CRC),
    ErrorKind.ACK: (ErrorClass.ACK, 0, LOCATION_ACK),
}


def error_frame(event: ErrorFrame | StateChange, was: ErrorState, node: WireNode | None) -> Frame:
    """The error frame for an event at `node`, which `was` in that state before; `node` is None if it has left the bus.

    BUSERROR is set if an error on the bus is the cause, not when a node becomes error-active again.
    """
    error_class, control, kind, location = ErrorClass.CNT if node else ErrorClass(0), 0, 0, 0
    tec, rec = (node.tec, node.rec) if node else (0, 0)
    if isinstance(event, ErrorFrame):
        more, kind, location = _PROTOCOL_ERRORS[event.kind]
        error_class |= ErrorClass.PROT | ErrorClass.BUSERROR | more
        kind |= TYPE_TX
    elif event.state is ErrorState.BUS_OFF:
        error_class |= ErrorClass.BUSOFF | ErrorClass.BUSERROR
    elif event.state is ErrorState.PASSIVE:
        error_class |= ErrorClass.CRTL | ErrorClass.BUSERROR
        control = TX_PASSIVE * (tec > PASSIVE_LIMIT) | RX_PASSIVE * (rec > PASSIVE_LIMIT)
    elif was is ErrorState.BUS_OFF:
        error_class |= ErrorClass.RESTARTED
    else:
        error_class |= ErrorClass.CRTL
        control = ACTIVE
    details = bytes((0, control, kind, location, 0, 0, min(tec, 0xFF), min(rec, 0xFF)))
    return Frame(int(ERROR_FLAG | error_class), details, is_extended=True)
