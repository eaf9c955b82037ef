"""Messages that are laid out by signals, least significant byte first: PDOs of a cell and of EDS files."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from ..cell.dbc_file import Signal
from ..errors import FrameError
from .meaning import Field, Sort

MOST_DECIMALS = 4
_SINGLE, _DOUBLE = struct.Struct("<f"), struct.Struct("<d")


@dataclass(frozen=True, slots=True)
class SignalMessage:
    """A message of `size` bytes; longer data are read as far as it goes (CiA 301, 7.2.2.5, PDO length exceeded)."""

    title: str
    size: int
    signals: Sequence[Signal]
    sort: Sort = Sort.PDO

    def fields(self, data: bytes) -> tuple[Field, ...]:
        """Each signal's value. Raises `FrameError` for fewer than `size` bytes."""
        if len(data) < self.size:
            raise FrameError(f"{len(data)} bytes instead of {self.size}")
        number = int.from_bytes(data, "little")
        return tuple(
            Field(each.name, signal_text(each, number >> each.start_bit), each.start_bit, each.bit_length)
            for each in self.signals
        )


def signal_text(signal: Signal, bits: int) -> str:
    """The value in the lowest bits of `bits`, in words or as a number with its unit."""
    raw = bits & (1 << signal.bit_length) - 1
    if signal.is_float:
        layout = _SINGLE if signal.bit_length == 32 else _DOUBLE
        return number_text(layout.unpack(raw.to_bytes(layout.size, "little"))[0], 0.0, signal.unit)
    if signal.is_signed and raw >> signal.bit_length - 1:
        raw -= 1 << signal.bit_length
    if raw in signal.choices:
        return signal.choices[raw]
    if signal.factor == 1.0 and signal.offset == 0.0:
        return f"{raw} {signal.unit}".rstrip()
    return number_text(raw * signal.factor + signal.offset, abs(signal.factor), signal.unit)


def number_text(value: float, step: float, unit: str) -> str:
    """`value` with as many decimals as one `step` needs; seven digits if it has none."""
    if 0.0 < step < math.inf and abs(value) < 1e9:
        decimals = min(MOST_DECIMALS, max(0, math.ceil(-math.log10(step))))
        text = f"{value:.{decimals}f}"
    else:
        text = f"{value:.7g}"
    return f"{text} {unit}".rstrip()
