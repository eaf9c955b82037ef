"""Cards as CiA 401 I/O modules: objects of the dictionary on one side, registers on the other.

A device turns the value of an object into the register accesses that the Apple II would make, at the time at which it
would make them. Frames, states and time-outs are in `slave.py`; `IoDevice` documents the methods. Each card knows its
own registers.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar, Protocol

from canarm_protocol.canopen.dictionary import (
    ANALOGUE_ERROR_MODE,
    ANALOGUE_ERROR_VALUE,
    ANALOGUE_INPUT,
    ANALOGUE_INPUT_8,
    ANALOGUE_INPUT_32,
    ANALOGUE_OUTPUT,
    ANALOGUE_OUTPUT_8,
    ANALOGUE_OUTPUT_32,
    DIGITAL_ERROR_MODE,
    DIGITAL_ERROR_VALUE,
    DIGITAL_FILTER_MASK,
    DIGITAL_OUTPUT,
)
from canarm_protocol.cards.sc300 import BITS_PER_JOINT

from ..node.io_device import Getter, ReadObject, Refusal, Setter
from ..signals import Distortion
from .plugged import Samples
from .registers import Clock, RegisterCard

INPUT_BITS = {ANALOGUE_INPUT_8: 7, ANALOGUE_INPUT: 15, ANALOGUE_INPUT_32: 31}
OUTPUT_BITS = {ANALOGUE_OUTPUT_8: 7, ANALOGUE_OUTPUT: 15, ANALOGUE_OUTPUT_32: 31}
"""Bits for a left-adjusted code in the objects of CiA 401, without the sign."""
ALL_BITS = 0xFF


class DacRegisters(RegisterCard, Protocol):
    """A card of D/A converters."""

    def load(self, channel: int, code: int, now_ns: int) -> None:
        """Make the register accesses that give a converter (from 0) a code."""
        ...

    def code(self, channel: int) -> int:
        """The code that a converter (from 0) has been given."""
        ...


class LatchRegister(RegisterCard, Protocol):
    """A latch of eight bits at address 0."""

    value: int


class AdcRegisters(RegisterCard, Protocol):
    """A card of one A/D converter behind a multiplexer."""

    def convert(self, begin_ns: int, samples: Samples, volts: Sequence[float]) -> list[int]:
        """Convert one channel after the other: start each, and read its data when they are ready."""
        ...


class DacDevice:
    """0x6411: one signed, left-adjusted 16-bit value per converter. They are unipolar: negative values give 0.

    0x6410 and 0x6412 are the same in 8 and in 32 bits.
    """

    def __init__(self, card: DacRegisters, bits: int, channels: int, clock: Clock) -> None:
        self._card, self._bits, self._channels, self._clock = card, bits, channels, clock

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to write an output."""
        if index not in OUTPUT_BITS or not 1 <= subindex <= self._channels:
            return None
        channel, shift = subindex - 1, OUTPUT_BITS[index] - self._bits
        load, clock = self._card.load, self._clock
        if shift < 0:
            return lambda value: load(channel, value << -shift if value > 0 else 0, clock.time_ns)
        return lambda value: load(channel, value >> shift if value > 0 else 0, clock.time_ns)

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """Every value can be converted."""
        return None

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a value."""
        if index not in OUTPUT_BITS or not 1 <= subindex <= self._channels:
            return None
        channel, shift, code = subindex - 1, OUTPUT_BITS[index] - self._bits, self._card.code
        return lambda: code(channel) << shift if shift >= 0 else code(channel) >> -shift

    def refresh(self, index: int, subindex: int) -> None:
        """Outputs need none."""

    def configure(self, read: ReadObject) -> None:
        """No parameter acts on the values in passing."""

    def power_off(self) -> None:
        """No reference, no current."""
        for channel in range(self._channels):
            self._card.load(channel, 0, self._clock.time_ns)

    def take_error_values(self, read: ReadObject) -> None:
        """0x6443 = 1 selects 0x6444, a left-adjusted 32-bit value."""
        shift = OUTPUT_BITS[ANALOGUE_OUTPUT_32] - self._bits
        for channel in range(self._channels):
            if read(ANALOGUE_ERROR_MODE, channel + 1):
                code = max(read(ANALOGUE_ERROR_VALUE, channel + 1), 0) >> shift
                self._card.load(channel, code, self._clock.time_ns)


class LatchDevice:
    """0x6200: eight latch bits as one byte; writing changes the bits that are 1 in 0x6208.

    `channels` (from 0) are those with a joint: both bits of one at once are a direction that its bridge never takes.
    """

    def __init__(self, card: LatchRegister, channels: Iterable[int], clock: Clock) -> None:
        self._card, self._clock = card, clock
        self._clockwise = sum(1 << BITS_PER_JOINT * channel for channel in channels)
        self._mask = ALL_BITS

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to write an output."""
        if (index, subindex) != (DIGITAL_OUTPUT, 1):
            return None
        return self._write

    def _write(self, value: int) -> None:
        self._card.write(0, self._masked(value), self._clock.time_ns)

    def _masked(self, value: int) -> int:
        mask = self._mask
        return self._card.value & ~mask | value & mask

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """Both directions of a joint at once are refused, also for the time when nobody drives it."""
        if (index, subindex) == (DIGITAL_OUTPUT, 1):
            return self._is_refused
        return self._is_illegal if (index, subindex) == (DIGITAL_ERROR_VALUE, 1) else None

    def _is_refused(self, value: int) -> bool:
        return self._is_illegal(self._masked(value))

    def _is_illegal(self, bits: int) -> bool:
        return bool(bits & bits >> 1 & self._clockwise)

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a value."""
        return (lambda: self._card.value) if (index, subindex) == (DIGITAL_OUTPUT, 1) else None

    def refresh(self, index: int, subindex: int) -> None:
        """Outputs need none."""

    def configure(self, read: ReadObject) -> None:
        """The filter mask."""
        self._mask = read(DIGITAL_FILTER_MASK, 1)

    def power_off(self) -> None:
        """All bridges open."""
        self._card.write(0, 0, self._clock.time_ns)

    def take_error_values(self, read: ReadObject) -> None:
        """Bits that are 1 in 0x6206 take the bit of 0x6207; the others stay."""
        mode = read(DIGITAL_ERROR_MODE, 1)
        self._card.write(0, self._card.value & ~mode | read(DIGITAL_ERROR_VALUE, 1) & mode, self._clock.time_ns)


class AdcDevice:
    """0x6401: one signed, left-adjusted 16-bit value per channel, as of the last scan or read outside the cycle.

    0x6400 and 0x6402 are the same in 8 and in 32 bits.
    `sample(channel)` gives the volts at a pin now.
    """

    INPUTS: ClassVar = frozenset(INPUT_BITS)

    def __init__(
        self, card: AdcRegisters, sample: Callable[[int], float], bits: int, channels: int, clock: Clock
    ) -> None:
        self._card, self._sample, self._bits, self._clock = card, sample, bits, clock
        self._codes = [0] * channels
        self._distortions: dict[int, Distortion] = {}

    def scan(self, begin_ns: int, samples: Samples, values: list[float]) -> None:
        """Convert one channel after the other: start, and read when the conversion is over."""
        codes, distortions = self._codes, self._distortions
        read = self._card.convert(begin_ns, samples, values)
        for (channel, _, _), code in zip(samples, read, strict=True):
            if distortions and channel in distortions:
                code = int(distortions[channel](code))
            codes[channel] = code

    def distort(self, channel: int, distortion: Distortion | None) -> None:
        """Let another code be read than the converter of `channel` (from 0) has given."""
        if distortion is None:
            self._distortions.pop(channel, None)
        else:
            self._distortions[channel] = distortion

    def setter(self, index: int, subindex: int) -> Setter | None:
        """Inputs are not written."""
        return None

    def refusal(self, index: int, subindex: int) -> Refusal | None:
        """Inputs are not written."""
        return None

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a value."""
        if index not in INPUT_BITS or not 1 <= subindex <= len(self._codes):
            return None
        codes, channel, shift = self._codes, subindex - 1, INPUT_BITS[index] - self._bits
        if shift < 0:
            return lambda: codes[channel] >> -shift
        return lambda: codes[channel] << shift

    def refresh(self, index: int, subindex: int) -> None:
        """Convert one channel; nobody waits for it."""
        if index in INPUT_BITS and 1 <= subindex <= len(self._codes):
            channel = subindex - 1
            self.scan(self._clock.time_ns, ((channel, 0, 0),), [self._sample(channel)])

    def configure(self, read: ReadObject) -> None:
        """No parameter acts on the values in passing."""

    def power_off(self) -> None:
        """Inputs have no state that lasts."""

    def take_error_values(self, read: ReadObject) -> None:
        """Inputs have no error values."""
