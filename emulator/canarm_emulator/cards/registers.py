"""A card as the computer sees it: sixteen addresses, the DEVICE SELECT range of its slot from $C080 + 16 x slot.

A card knows its registers and its analogue side, but not CAN; `device.py` makes a CiA 401 device of it.
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
    """Gives the present, the time of register accesses."""

    @property
    def time_ns(self) -> int:
        """The present, in ns."""
        ...


OPEN_BUS = 0xFF
"""Value read at an address without a register: TTL inputs float high."""
