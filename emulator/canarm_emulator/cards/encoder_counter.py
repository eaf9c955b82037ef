"""An encoder counter card: four quadrature decoders, each with a counter, a latch for its index and flags.

Registers of channel c (0 to 3): a write to 4c latches the count, to 4c+1 the count at the last index, to 4c+2 the
flags, which it clears; a write to 4c+3 sets the counter to 0. Reads of 4c to 4c+3 give the latched bytes, lowest first.
Flags: bit 0 overflow, bit 1 underflow, bit 2 the index has passed. A decoder counts every edge of both tracks (x4) or
one edge per period (x1); counters wrap around.
"""

from collections.abc import Callable
from math import floor, tau

from canarm_protocol.cards.encoder_counter import (
    INDEX_PULSES,
    INDEX_VALUES,
    OVERFLOWS,
    POSITION_VALUES,
    PRESET_VALUES,
    CounterSettings,
)
from canarm_protocol.cell.model import Card
from canarm_protocol.cell.sensors.encoder import ON_EDGE

from ..node.io_device import Getter, ReadObject, Refusal, Setter
from ..signals import Distortion
from .plugged import Connections, Plugged, Samples
from .registers import Clock

CHANNELS = 4
SPACING = 4
"""Addresses per channel."""
COUNT, INDEX, FLAGS, CLEAR = range(SPACING)
_SIGN = 1 << 8 * SPACING - 1
_ALL_BYTES = (1 << 8 * SPACING) - 1
WENT_OVER, WENT_UNDER, INDEX_PASSED = 0x01, 0x02, 0x04


class _Channel:
    """One decoder of `edges_per_turn`; the index comes once per turn, at angle 0 of the shaft."""

    def __init__(self, edges_per_turn: int, bits: int) -> None:
        self._edges_per_turn = edges_per_turn
        self._half, self._range = 1 << bits - 1, 1 << bits
        self._edge: int | None = None
        self.count = self.index = self.overflows = self.flags = self.pulses = 0

    def follow(self, angle_rad: float) -> None:
        """Count the edges since the last call, with the shaft at `angle_rad` now. The first call counts none."""
        per_turn = self._edges_per_turn
        edge = floor(angle_rad / tau * per_turn + ON_EDGE) if per_turn else 0
        before, self._edge = self._edge, edge
        if before is None or edge == before:
            return
        turn, turn_before = edge // per_turn, before // per_turn
        if turn != turn_before:
            boundary = turn if turn > turn_before else turn + 1
            self.index = self._wrapped(self.count + boundary * per_turn - before)
            self.flags |= INDEX_PASSED
            self.pulses = self.pulses + abs(turn - turn_before) & 0xFFFF
        self._take(self.count + edge - before)

    def preset(self, count: int) -> None:
        """The counter holds another count from now on."""
        self.count = self._wrapped(count)

    def _take(self, count: int) -> None:
        rounds = (count + self._half) // self._range
        if rounds:
            self.overflows += rounds
            self.flags |= WENT_OVER if rounds > 0 else WENT_UNDER
        self.count = self._wrapped(count)

    def _wrapped(self, count: int) -> int:
        return (count + self._half) % self._range - self._half


class EncoderCounterCard:
    """Decoders and counters. `shaft(channel)` gives the angle (rad) of an encoder's shaft now, `lines` its periods."""

    def __init__(self, shaft: Callable[[int], float], lines: Callable[[int], int], bits: int, decoding: int) -> None:
        self._shaft = shaft
        self.channels = [_Channel(lines(channel) * decoding, bits) for channel in range(CHANNELS)]
        self._latched = [0] * CHANNELS

    def read(self, address: int, now_ns: int) -> int:
        """A byte of what was latched."""
        channel, byte = divmod(address, SPACING)
        return self._latched[channel] >> 8 * byte & 0xFF

    def latched(self, channel: int) -> int:
        """What the four bytes that were latched of a channel make together, with a sign."""
        return (self._latched[channel] + _SIGN & _ALL_BYTES) - _SIGN

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Bring a counter up to date, then latch or clear it."""
        channel, register = divmod(address, SPACING)
        self.latch(channel, register, self._shaft(channel))

    def latch(self, channel: int, register: int, angle_rad: float) -> None:
        """The effect of a write, with the shaft at `angle_rad`."""
        decoder = self.channels[channel]
        decoder.follow(angle_rad)
        if register == CLEAR:
            decoder.preset(0)
            return
        self._latched[channel] = (decoder.count, decoder.index, decoder.flags)[register]
        if register == FLAGS:
            decoder.flags = 0


class CounterDevice:
    """CiA 406: 0x6020 is the count of each channel, writing 0x6010 sets it.

    0x2100 is the count at its last index, 0x2101 its overflows, 0x2102 how many pulses its index has given.
    """

    def __init__(self, card: EncoderCounterCard, clock: Clock) -> None:
        self._card, self._clock = card, clock
        self._counts, self._presets = [0] * CHANNELS, [0] * CHANNELS
        self._distortions: dict[int, Distortion] = {}

    def scan(self, begin_ns: int, samples: Samples, values: list[float]) -> None:
        """Latch and read counts; `values` are where the shafts were (rad)."""
        for channel, _, place in samples:
            self._card.latch(channel, COUNT, values[place])
            self._read(channel)

    def distort(self, channel: int, distortion: Distortion | None) -> None:
        """Let another count be read than that of `channel` (from 0)."""
        if distortion is None:
            self._distortions.pop(channel, None)
        else:
            self._distortions[channel] = distortion

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to set a counter."""
        if index != PRESET_VALUES or not 1 <= subindex <= CHANNELS:
            return None
        return lambda count: self._preset(subindex - 1, count)

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """Every value can be counted from."""
        return None

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a count, and what goes with it."""
        if not 1 <= subindex <= CHANNELS:
            return None
        number, channel = subindex - 1, self._card.channels[subindex - 1]
        counts, presets = self._counts, self._presets
        getters: dict[int, Getter] = {
            POSITION_VALUES: lambda: counts[number],
            PRESET_VALUES: lambda: presets[number],
            INDEX_VALUES: lambda: channel.index,
            OVERFLOWS: lambda: channel.overflows,
            INDEX_PULSES: lambda: channel.pulses,
        }
        return getters.get(index)

    def refresh(self, index: int, subindex: int) -> None:
        """Count up to the present."""
        if index in (POSITION_VALUES, INDEX_VALUES, OVERFLOWS, INDEX_PULSES) and 1 <= subindex <= CHANNELS:
            now_ns = self._clock.time_ns
            self._card.write(SPACING * (subindex - 1) + COUNT, 0, now_ns)
            self._read(subindex - 1)

    def configure(self, read: ReadObject) -> None:
        """No parameter acts on the values in passing."""

    def power_off(self) -> None:
        """Counters that have lost their power begin at 0 where the shafts are then."""
        for channel in range(CHANNELS):
            self._preset(channel, 0)

    def take_error_values(self, read: ReadObject) -> None:
        """Inputs have no error values."""

    def _read(self, channel: int) -> None:
        count = self._card.latched(channel)
        if self._distortions and channel in self._distortions:
            count = int(self._distortions[channel](count))
        self._counts[channel] = count

    def _preset(self, channel: int, count: int) -> None:
        self.refresh(POSITION_VALUES, channel + 1)
        self._card.channels[channel].preset(count)
        self._presets[channel] = count
        self.refresh(POSITION_VALUES, channel + 1)


def plug_in(card: Card, connections: Connections) -> Plugged:
    """The card in its slot, with all counters at 0 where the shafts are."""
    assert isinstance(card, CounterSettings)
    registers = EncoderCounterCard(connections.sample, connections.lines, card.counter_bits, card.decoding)
    device = CounterDevice(registers, connections.clock)
    device.power_off()
    return Plugged(registers, device, device.distort, None, frozenset({POSITION_VALUES}), device.scan)
