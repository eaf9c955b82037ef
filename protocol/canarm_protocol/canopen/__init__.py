"""CANopen as data: frames, object dictionaries, PDOs and SDO transfers. No bus, no clock."""

from typing import TYPE_CHECKING

from canarm_protocol.faces import loader

if TYPE_CHECKING:
    from .dictionary import Dictionary, load_dictionary
    from .frames import Cob, Emergency, ErrorCode, Frame, NmtCommand, NmtState, heartbeat_frame, nmt_frame, sync_frame
    from .pdo import MappedObject, PdoLayout
    from .sdo import AbortCode, SdoAborted, download, upload

__all__ = [
    "AbortCode",
    "Cob",
    "Dictionary",
    "Emergency",
    "ErrorCode",
    "Frame",
    "MappedObject",
    "NmtCommand",
    "NmtState",
    "PdoLayout",
    "SdoAborted",
    "download",
    "heartbeat_frame",
    "load_dictionary",
    "nmt_frame",
    "sync_frame",
    "upload",
]

__getattr__ = loader(__name__, __all__, ".frames", ".dictionary", ".sdo", ".pdo")
