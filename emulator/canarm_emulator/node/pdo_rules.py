"""What a client may write into the parameters of a node's PDOs (CiA 301, 7.5.2.35 to 7.5.2.38).

A wrong value is refused when it is written, so that a node never has PDOs that it cannot serve.
"""

from collections.abc import Callable

from canarm_protocol.canopen.frames import Cob
from canarm_protocol.canopen.pdo import COB_ID_MASK, COMMUNICATION, DISABLED, MAPPING, PDO_COUNT, Kind, mapped_object
from canarm_protocol.canopen.sdo import AbortCode
from canarm_protocol.errors import DictionaryError

from .store import ObjectStore, SdoRefused

CanMap = Callable[[Kind, int, int], bool]
"""Whether the card can serve an object (index, sub-index) in a PDO of that kind."""

KINDS: tuple[Kind, ...] = ("rpdo", "tpdo")
SYNCHRONOUS_TYPES = range(241)
EVENT_DRIVEN_TYPES = (254, 255)
SYNCHRONOUS_ON_REQUEST, ON_REQUEST = 252, 253
"""TPDOs that are sent on a remote frame only, sampled at the last SYNC or at the request."""
TRANSMISSION_TYPES: dict[Kind, frozenset[int]] = {
    "rpdo": frozenset((*SYNCHRONOUS_TYPES, *EVENT_DRIVEN_TYPES)),
    "tpdo": frozenset((*SYNCHRONOUS_TYPES, SYNCHRONOUS_ON_REQUEST, ON_REQUEST, *EVENT_DRIVEN_TYPES)),
}
FIXED_WHILE_ENABLED = (3, 6)
"""Inhibit time and SYNC start value (CiA 301, 7.5.2.37: not to be changed while the PDO exists)."""
RESTRICTED_COB_IDS = (
    range(0x081),  # NMT, reserved, and SYNC, which 0x1005 fixes at 0x080
    range(0x100, 0x181),  # TIME, reserved
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x800),
)
"""CAN-IDs that no PDO may take (CiA 301, 7.3.5, restricted CAN-IDs)."""
NO_REMOTE = 0x4000_0000
"""Bit 30: no answer to remote frames."""
MAPPED_BYTES = 8


def check_pdo_write(
    store: ObjectStore, can_map: CanMap, is_operational: bool, index: int, subindex: int, value: int
) -> None:
    """Raises `SdoRefused` for a write that breaks a PDO; writes to other objects pass."""
    for kind in KINDS:
        communication, mapping = index - COMMUNICATION[kind], index - MAPPING[kind]
        if 0 <= communication < PDO_COUNT or 0 <= mapping < PDO_COUNT:
            if is_operational:
                raise SdoRefused(AbortCode.DEVICE_STATE)
            if 0 <= mapping < PDO_COUNT:
                _check_mapping(store, can_map, kind, mapping, subindex, value)
            elif subindex == 1:
                _check_cob_id(value, store.number(index, 1))
            elif subindex == 2 and value not in TRANSMISSION_TYPES[kind]:
                raise SdoRefused(AbortCode.INVALID_VALUE)
            elif subindex in FIXED_WHILE_ENABLED and not store.number(index, 1) & DISABLED:
                raise SdoRefused(AbortCode.DEVICE_STATE)


def check_emergency_cob_id(value: int, present: int) -> None:
    """0x1014 (CiA 301, 7.5.2.17): bit 31 disables EMCY. Raises `SdoRefused`."""
    if value & NO_REMOTE:
        raise SdoRefused(AbortCode.INVALID_VALUE)
    _check_cob_id(value, present)


def check_sync_cob_id(value: int) -> None:
    """0x1005 (CiA 301, 7.5.2.5): a consumer (bit 30 is 0) of 0x080; bit 31 means nothing. Raises `SdoRefused`."""
    if value & ~DISABLED != Cob.SYNC:
        raise SdoRefused(AbortCode.INVALID_VALUE)


def check_sync_overflow(value: int, cycle_us: int) -> None:
    """0x1019 (CiA 301, 7.5.2.22): 1 is reserved; it is fixed while 0x1006 is not 0. Raises `SdoRefused`."""
    if cycle_us:
        raise SdoRefused(AbortCode.DEVICE_STATE)
    if value == 1:
        raise SdoRefused(AbortCode.INVALID_VALUE)


def _check_cob_id(value: int, present: int) -> None:
    """Only 11-bit CAN-IDs; one that is enabled keeps its CAN-ID until it is disabled."""
    if value & ~(DISABLED | NO_REMOTE | COB_ID_MASK):
        raise SdoRefused(AbortCode.INVALID_VALUE)
    if value & DISABLED:
        return
    cob_id = value & COB_ID_MASK
    moved = not present & DISABLED and cob_id != present & COB_ID_MASK
    if moved or any(cob_id in restricted for restricted in RESTRICTED_COB_IDS):
        raise SdoRefused(AbortCode.INVALID_VALUE)


def _check_mapping(store: ObjectStore, can_map: CanMap, kind: Kind, offset: int, subindex: int, value: int) -> None:
    """Disable the PDO, set the number of objects to 0, write the objects, then their number, then enable."""
    mapping = MAPPING[kind] + offset
    if not store.number(COMMUNICATION[kind] + offset, 1) & DISABLED:
        raise SdoRefused(AbortCode.DEVICE_STATE)
    if subindex:
        if store.number(mapping, 0):
            raise SdoRefused(AbortCode.UNSUPPORTED_ACCESS)
        if value:  # CiA 301, 7.5.2.36: 0 clears an entry
            _check_entry(store, can_map, kind, value)
        return
    entries = range(1, value + 1)
    if any(entry not in store.dictionary[mapping].subindices for entry in entries):
        raise SdoRefused(AbortCode.PDO_TOO_LONG)
    if sum(_check_entry(store, can_map, kind, store.number(mapping, entry)) for entry in entries) > 8 * MAPPED_BYTES:
        raise SdoRefused(AbortCode.PDO_TOO_LONG)


def _check_entry(store: ObjectStore, can_map: CanMap, kind: Kind, entry: int) -> int:
    """Length of a mapped object in bits."""
    index, subindex = entry >> 16, entry >> 8 & 0xFF
    variable = store.variable(index, subindex)
    try:
        mapped_object(store.dictionary, entry)
    except DictionaryError:
        raise SdoRefused(AbortCode.NOT_MAPPABLE) from None
    accessible = variable.writable if kind == "rpdo" else variable.readable
    if not accessible or not can_map(kind, index, subindex):
        raise SdoRefused(AbortCode.NOT_MAPPABLE)
    return entry & 0xFF
