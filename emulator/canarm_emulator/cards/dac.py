"""A D/A card of 8 to 16 bits: four converters, each behind a register that latches its two bytes together.

Registers of channel c (0 to 3): 4c holds the code's low byte; a write to 4c+1 gives the high byte and loads the
converter with both, as in double-buffered converters on 8-bit buses. A code never passes through an intermediate value.
Bits above the resolution are not connected. Settling takes far less than a bus cycle.
"""

from collections.abc import Callable

from canarm_protocol.cards.kind import highest_code
from canarm_protocol.cell.model import Card

from .dac_converters import DacConverters
from .device import DacDevice
from .plugged import Connections, Plugged

CHANNELS = 4
SPACING = 4
"""Addresses per channel."""


class DacCard(DacConverters):
    """Buffers and converters of `bits` bits. `on_output(channel, fraction)` is told of every change of I_out / I_ref.

    Full scale is 255/256 of the reference as with eight bits, so that the op-amp behind it is trimmed in the same way.
    `nonlinearity` is as in `Dac0808Card`.
    """

    def __init__(self, bits: int, on_output: Callable[[int, float], None], nonlinearity: float = 0.0) -> None:
        super().__init__(bits, on_output, nonlinearity)
        self._low = [0] * CHANNELS
        self._codes = [0] * CHANNELS
        self._mask = highest_code(bits)

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Keep a low byte, or load a converter."""
        channel, register = divmod(address, SPACING)
        if register == 0:
            self._low[channel] = value & 0xFF
        elif register == 1:
            code = (self._low[channel] | (value & 0xFF) << 8) & self._mask
            if code != self._codes[channel]:
                self._codes[channel] = code
                self.refresh(channel)

    def load(self, channel: int, code: int, now_ns: int) -> None:
        """Write both bytes of a channel."""
        self.write(SPACING * channel, code & 0xFF, now_ns)
        self.write(SPACING * channel + 1, code >> 8, now_ns)

    def code(self, channel: int) -> int:
        """The code that a converter was loaded with."""
        return self._codes[channel]


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot."""
    registers = DacCard(card.codec.bits, connections.set_output, connections.dac.nonlinearity)
    device = DacDevice(registers, card.codec.bits, CHANNELS, connections.clock)
    return Plugged(registers, device, registers.distort, registers.refresh)
