"""Storing a node's parameters and restoring their defaults (CiA 301, 0x1010 and 0x1011).

The memory outlasts resets of the emulated card, but not the end of the process.
"""

from canarm_protocol.canopen.dictionary import ERROR_HISTORY, ERROR_REGISTER, RESTORE_DEFAULTS, STORE_PARAMETERS
from canarm_protocol.canopen.sdo import AbortCode

from .store import ObjectStore, SdoRefused

SIGNATURES = {
    STORE_PARAMETERS: int.from_bytes(b"save", "little"),
    RESTORE_DEFAULTS: int.from_bytes(b"load", "little"),
}
COMMUNICATION, APPLICATION = range(0x1000, 0x2000), range(0x2000, 0xA000)
GROUPS = {1: (COMMUNICATION, APPLICATION), 2: (COMMUNICATION,), 3: (APPLICATION,)}
"""Groups of objects by the sub-indices of both objects."""
NO_PARAMETERS = (ERROR_REGISTER, ERROR_HISTORY)


def obey(store: ObjectStore, index: int, subindex: int, signature: int) -> None:
    """A client wrote 0x1010 or 0x1011. Raises `SdoRefused` for a wrong signature.

    Restored defaults take effect at the next reset, stored values at every one.
    """
    if signature != SIGNATURES[index]:
        raise SdoRefused(AbortCode.CANNOT_STORE)

    def is_meant(stored: int) -> bool:
        return stored not in NO_PARAMETERS and any(stored in group for group in GROUPS[subindex])

    if index == STORE_PARAMETERS:
        store.save(is_meant)
    else:
        store.forget_saved(is_meant)
