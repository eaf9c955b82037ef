"""Cards as CiA 401 I/O modules: objects of the dictionary on one side, registers on the other.

A device turns a value of 0x6200, 0x6401 or 0x6411 into the register accesses that the Apple II would make. It knows no
frames, no states and no time-outs; `slave.py` owns those. What its methods do, `IoDevice` says.
"""

from collections.abc import Callable

from canarm_protocol.canopen.dictionary import (
    ANALOGUE_ERROR_MODE,
    ANALOGUE_ERROR_VALUE,
    ANALOGUE_INPUT,
    ANALOGUE_INPUT_8,
    ANALOGUE_OUTPUT,
    ANALOGUE_OUTPUT_8,
    CODE_SHIFT,
    DIGITAL_ERROR_MODE,
    DIGITAL_ERROR_VALUE,
    DIGITAL_FILTER_MASK,
    DIGITAL_OUTPUT,
)

from ..node.io_device import Getter, ReadObject, Setter
from ..signals import Distortion
from .adc0809 import Adc0809Card
from .dac0808 import CHANNELS as DAC_CHANNELS
from .dac0808 import Dac0808Card
from .sc300 import Sc300Card

NIBBLE = 4
TO_8_BITS = 8
"""Left-adjusted 16 bits to left-adjusted 8 bits: of a card's 8-bit code the sign leaves room for the upper seven."""
ALL_BITS = 0xFF


class DacDevice:
    """0x6411: one signed, left-adjusted 16-bit value a converter. They are unipolar: negative values give 0.

    0x6410 is the same in 8 bits.
    """

    def __init__(self, card: Dac0808Card) -> None:
        self._card = card

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to write an output."""
        if index not in (ANALOGUE_OUTPUT, ANALOGUE_OUTPUT_8) or not 1 <= subindex <= DAC_CHANNELS:
            return None
        if index == ANALOGUE_OUTPUT_8:
            return lambda value: self._load(subindex, value << TO_8_BITS)
        return lambda value: self._load(subindex, value)

    def _load(self, subindex: int, value: int) -> None:
        code = value >> CODE_SHIFT if value > 0 else 0
        lsb_latch = 2 * (subindex - 1)
        self._card.write(lsb_latch, code & 0x0F, 0)
        self._card.write(lsb_latch + 1, code >> NIBBLE, 0)

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a value."""
        if index not in (ANALOGUE_OUTPUT, ANALOGUE_OUTPUT_8) or not 1 <= subindex <= DAC_CHANNELS:
            return None
        if index == ANALOGUE_OUTPUT_8:
            return lambda: self._card.code(subindex - 1) << CODE_SHIFT >> TO_8_BITS
        return lambda: self._card.code(subindex - 1) << CODE_SHIFT

    def refresh(self, index: int, subindex: int) -> None:
        """Outputs need none."""

    def configure(self, read: ReadObject) -> None:
        """No parameter acts on the values in passing."""

    def power_off(self) -> None:
        """No reference, no current."""
        for channel in range(1, DAC_CHANNELS + 1):
            self._load(channel, 0)

    def take_error_values(self, read: ReadObject) -> None:
        """0x6443 = 1 selects 0x6444, a 32-bit value of which the upper 16 bits are the output's."""
        for channel in range(1, DAC_CHANNELS + 1):
            if read(ANALOGUE_ERROR_MODE, channel):
                self._load(channel, read(ANALOGUE_ERROR_VALUE, channel) >> 16)


class LatchDevice:
    """0x6200: eight latch bits as one byte, of which writing changes those that are 1 in 0x6208."""

    def __init__(self, card: Sc300Card) -> None:
        self._card = card
        self._mask = ALL_BITS

    def setter(self, index: int, subindex: int) -> Setter | None:
        """How to write an output."""
        if (index, subindex) != (DIGITAL_OUTPUT, 1):
            return None
        return self._write

    def _write(self, value: int) -> None:
        card, mask = self._card, self._mask
        card.write(0, value if mask == ALL_BITS else card.value & ~mask | value & mask, 0)

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
        self._card.write(0, 0, 0)

    def take_error_values(self, read: ReadObject) -> None:
        """Bits that are 1 in 0x6206 take the bit of 0x6207; the others stay."""
        mode = read(DIGITAL_ERROR_MODE, 1)
        self._card.write(0, self._card.value & ~mode | read(DIGITAL_ERROR_VALUE, 1) & mode, 0)


class AdcDevice:
    """0x6401: one signed, left-adjusted 16-bit value a channel, as of the last scan or the last read outside the cycle.

    0x6400 is the same in 8 bits.
    `sample(channel)` gives the volts at an input pin now.
    """

    def __init__(self, card: Adc0809Card, sample: Callable[[int], float]) -> None:
        self._card = card
        self._sample = sample
        self._values = [0] * 8
        self._distortions: dict[int, Distortion] = {}

    def store(self, channel: int, volts: float) -> None:
        """Convert the volts that the multiplexer saw at `channel` (from 0)."""
        code = self._card.code(volts)
        if self._distortions and channel in self._distortions:
            code = int(self._distortions[channel](code))
        self._values[channel] = code << CODE_SHIFT

    def distort(self, channel: int, distortion: Distortion | None) -> None:
        """Let another code, 0 to 255, be read than the converter of `channel` (from 0) has given."""
        if distortion is None:
            self._distortions.pop(channel, None)
        else:
            self._distortions[channel] = distortion

    def setter(self, index: int, subindex: int) -> Setter | None:
        """Inputs are not written."""
        return None

    def getter(self, index: int, subindex: int) -> Getter | None:
        """How to read a value."""
        if index not in (ANALOGUE_INPUT, ANALOGUE_INPUT_8) or not 1 <= subindex <= len(self._values):
            return None
        values, channel = self._values, subindex - 1
        if index == ANALOGUE_INPUT_8:
            return lambda: values[channel] >> TO_8_BITS
        return lambda: values[channel]

    def refresh(self, index: int, subindex: int) -> None:
        """Convert one channel."""
        if index in (ANALOGUE_INPUT, ANALOGUE_INPUT_8) and 1 <= subindex <= len(self._values):
            self.store(subindex - 1, self._sample(subindex - 1))

    def configure(self, read: ReadObject) -> None:
        """No parameter acts on the values in passing."""

    def power_off(self) -> None:
        """Inputs have no state that lasts."""

    def take_error_values(self, read: ReadObject) -> None:
        """Inputs have no error values."""
