"""The D/A card: four DAC0808 converters, each behind two 4-bit latches.

Registers of channel c (0 to 3): 2c is the LSB latch (bits 3-0 of the code), 2c+1 the MSB latch (bits 7-4); data on
D3-D0. The converters follow their latches at once: 150 ns settling (DAC0808 data sheet) is far below a bus cycle, so a
code that changes in both nibbles passes through an intermediate value between the two writes, as on the real card.
"""

from collections.abc import Callable

from canarm_protocol.cell.model import Card

from .dac_converters import DacConverters
from .device import DacDevice
from .plugged import Connections, Plugged

CHANNELS = 4
BITS = 8
NIBBLE = 4


class Dac0808Card(DacConverters):
    """Latches and converters. `on_output(channel, fraction)` is told of every change of I_out / I_ref.

    `nonlinearity` is the largest deviation from the end-point line, as a fraction of full scale (data sheet: 0.19 % at
    most); its shape is a bow over the codes.
    """

    def __init__(self, on_output: Callable[[int, float], None], nonlinearity: float = 0.0) -> None:
        super().__init__(BITS, on_output, nonlinearity)
        self._latches = [0] * (2 * CHANNELS)

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Load one 4-bit latch."""
        if address < 2 * CHANNELS and self._latches[address] != value & 0x0F:
            self._latches[address] = value & 0x0F
            self.refresh(address >> 1)

    def load(self, channel: int, code: int, now_ns: int) -> None:
        """Write both latches of a channel, as the Apple II's program does."""
        latches, low, high = self._latches, code & 0x0F, code >> NIBBLE
        if latches[2 * channel] != low:
            latches[2 * channel] = low
            self.refresh(channel)
        if latches[2 * channel + 1] != high:
            latches[2 * channel + 1] = high
            self.refresh(channel)

    def code(self, channel: int) -> int:
        """The 8-bit code in front of a converter."""
        return self._latches[2 * channel] | self._latches[2 * channel + 1] << NIBBLE


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    registers = Dac0808Card(connections.set_output, connections.dac.nonlinearity)
    device = DacDevice(registers, card.codec.bits, CHANNELS, connections.clock)
    return Plugged(registers, device, registers.distort, registers.refresh)
