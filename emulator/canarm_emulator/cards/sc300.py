"""The direction latch SC300: an octal latch behind an I/O selector, two bits a joint.

No data sheet of the part is known; it is modelled like a 74LS374. Register 0 is the latch; every address of the slot
selects it, since an I/O selector decodes none of A3-A0.
"""

from collections.abc import Callable

from .registers import OPEN_BUS

CHANNELS = 4
BITS = 2


class Sc300Card:
    """Eight latched outputs. `on_output(channel, bits)` is told of every change of a channel's two direction bits."""

    def __init__(self, on_output: Callable[[int, int], None]) -> None:
        self._on_output = on_output
        self.value = 0

    def read(self, address: int, now_ns: int) -> int:
        """The latch has no way back to the data bus."""
        return OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Load the latch."""
        changed = self.value ^ value
        self.value = value & 0xFF
        for channel in range(CHANNELS):
            if changed >> BITS * channel & 0b11:
                self._on_output(channel, value >> BITS * channel & 0b11)
