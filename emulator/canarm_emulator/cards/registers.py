"""What every card is to the computer: sixteen addresses, the DEVICE SELECT range of its slot from $C080 + 16 x slot.

A card knows registers and its analogue side. It knows nothing of CAN; `device.py` puts a CiA 401 face on it.
"""

from typing import Protocol

REGISTERS = 16


class RegisterCard(Protocol):
    """A card in a slot. `address` is 0 to 15; `now_ns` is the time of the bus access."""

    def read(self, address: int, now_ns: int) -> int:
        """The byte that the card puts on the data bus."""
        ...

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Take a byte from the data bus. Addresses without a register ignore it."""
        ...


class Clock(Protocol):
    """What knows the present: when a register is accessed that is accessed now."""

    @property
    def time_ns(self) -> int:
        """The present, in ns."""
        ...


OPEN_BUS = 0xFF
"""What a read of an address without a register gives: TTL inputs float high."""
