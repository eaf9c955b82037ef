"""What all converters have in common as CiA 401 modules: left-adjusted values, settings, error values.

Channels, registers and resolutions of a particular card never enter.
"""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from ..canopen.dictionary import (
    ANALOGUE_ERROR_MODE,
    ANALOGUE_ERROR_VALUE,
    ANALOGUE_INPUT,
    ANALOGUE_INPUT_32,
    ANALOGUE_OUTPUT,
    ANALOGUE_OUTPUT_32,
    Dictionary,
)
from .kind import Codec, ErrorValues, ObjectValue, Place, Settings

FEWEST_BITS, MOST_BITS = 8, 16
BITS_16, BITS_32 = 15, 31
"""Bits for a code in CiA 401's signed 16-bit and 32-bit values: the sign bit is 0 (CiA 401, 6.3.4)."""

Bits = Annotated[int, Field(ge=FEWEST_BITS, le=MOST_BITS)]
ConversionTime = Annotated[int, Field(ge=1, le=10_000)]


class ConversionSettings(Settings):
    """How long an analogue input takes to convert, in µs."""

    conversion_us: ConversionTime = 100


class ResolutionSettings(Settings):
    """Resolution of a converter."""

    bits: Bits = 12


class AdcSettings(ConversionSettings, ResolutionSettings):
    """Resolution and conversion time of an analogue input card."""


def left_adjusted(bits: int) -> Codec:
    """The codec of an unsigned code. Up to 15 bits travel in a 16-bit value, 16 bits in a 32-bit value."""
    return Codec(bits, (BITS_16 if bits <= BITS_16 else BITS_32) - bits)


def codec_of_8_bits(_: Settings) -> Codec:
    """The codec of an 8-bit part."""
    return left_adjusted(8)


def codec_of_bits(settings: Settings) -> Codec:
    """The codec of a card with `bits` among its settings."""
    assert isinstance(settings, ResolutionSettings)
    return left_adjusted(settings.bits)


def input_place_16(_: Settings, number: int) -> Place:
    """Channel `number` (from 1) of an analogue input card of at most 15 bits."""
    return Place(ANALOGUE_INPUT, number)


def output_place_16(_: Settings, number: int) -> Place:
    """Channel `number` (from 1) of an analogue output card of at most 15 bits."""
    return Place(ANALOGUE_OUTPUT, number)


def input_place(settings: Settings, number: int) -> Place:
    """Channel `number` (from 1) of an analogue input card with `bits`."""
    return Place(ANALOGUE_INPUT if codec_of_bits(settings).bits <= BITS_16 else ANALOGUE_INPUT_32, number)


def output_place(settings: Settings, number: int) -> Place:
    """Channel `number` (from 1) of an analogue output card with `bits`."""
    return Place(ANALOGUE_OUTPUT if codec_of_bits(settings).bits <= BITS_16 else ANALOGUE_OUTPUT_32, number)


def conversion_us(settings: Settings) -> int:
    """Conversion time of one channel, µs."""
    assert isinstance(settings, ConversionSettings)
    return settings.conversion_us


def error_values(bits: int, dictionary: Dictionary, values: ErrorValues) -> Iterator[ObjectValue]:
    """Every output takes its error value when the controller is lost, or keeps what it has: 0x6443, 1 or 0; then
    0x6444, left-adjusted in 32 bits.
    """
    outputs = sorted(set(dictionary[ANALOGUE_ERROR_MODE].subindices) - {0})
    yield from ((ANALOGUE_ERROR_MODE, output, int(values.get(output, 0) is not None)) for output in outputs)
    for output in outputs:
        yield ANALOGUE_ERROR_VALUE, output, (values.get(output) or 0) << BITS_32 - bits
