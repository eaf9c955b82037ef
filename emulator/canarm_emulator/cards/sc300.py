"""The direction latch SC300: an octal latch behind an I/O selector, two bits per joint.

No data sheet of the part is known; it is modelled like a 74LS374. Register 0 is the latch; every address of the slot
selects it, since an I/O selector decodes none of A3-A0.
"""

from collections.abc import Callable

from canarm_protocol.cards.sc300 import BITS_PER_JOINT
from canarm_protocol.cell.model import Card

from ..signals import Distortion
from .device import LatchDevice
from .plugged import Connections, Plugged
from .registers import OPEN_BUS

CHANNELS = 4


class Sc300Card:
    """Eight latched outputs. `on_output(channel, bits)` is told of every change of a channel's two direction bits."""

    def __init__(self, on_output: Callable[[int, int], None]) -> None:
        self._on_output = on_output
        self.value = 0
        self._bits = [0] * CHANNELS
        self._distortions: dict[int, Distortion] = {}

    def read(self, address: int, now_ns: int) -> int:
        """The latch has no way back to the data bus."""
        return OPEN_BUS

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Load the latch."""
        changed = self.value ^ value
        if not changed:
            return
        self.value = value & 0xFF
        for channel in range(CHANNELS):
            if changed >> BITS_PER_JOINT * channel & 0b11:
                self.refresh(channel)

    def refresh(self, channel: int) -> None:
        """Put out a channel's bits again, with the faults behind the latch."""
        bits = self.value >> BITS_PER_JOINT * channel & 0b11
        if self._distortions and channel in self._distortions:
            bits = int(self._distortions[channel](bits))
        if bits != self._bits[channel]:
            self._bits[channel] = bits
            self._on_output(channel, bits)

    def distort(self, channel: int, distortion: Distortion | None) -> None:
        """Change the bits (0 to 3) that go out, from the next `refresh` on."""
        if distortion is None:
            self._distortions.pop(channel, None)
        else:
            self._distortions[channel] = distortion


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    registers = Sc300Card(connections.set_output)
    device = LatchDevice(registers, [channel.number - 1 for channel in card.channel], connections.clock)
    return Plugged(registers, device, registers.distort, registers.refresh)
