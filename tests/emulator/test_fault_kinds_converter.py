"""Faults of converters, over all 256 codes."""

from collections.abc import Callable
from random import Random

import pytest

from canarm_emulator.faults.declaration import Context, SignalFault, Tap, TapKind
from canarm_emulator.faults.kinds.converter import MissingCode, StuckBit
from canarm_emulator.faults.parameters import parameters_at
from canarm_emulator.faults.taps import taps_of
from tests.resolutions import cell_of_bits

Begin = Callable[..., SignalFault]
TAPS = ("joint3.dac.code", "adc.channel2")


@pytest.mark.parametrize("tap", TAPS)
@pytest.mark.parametrize("bit", range(8))
@pytest.mark.parametrize("value", [0, 1])
def test_a_stuck_bit_is_the_same_in_every_code_and_the_others_are_right(
    begin: Begin, tap: str, bit: int, value: int
) -> None:
    fault = begin(tap, "stuck-bit", bit=bit, value=value)
    for code in range(256):
        bits = f"{code:08b}"[::-1]
        assert f"{int(fault.apply(code, 0)):08b}"[::-1] == bits[:bit] + str(value) + bits[bit + 1 :]


@pytest.mark.parametrize("tap", TAPS)
def test_a_missing_code_never_comes_and_all_others_do(begin: Begin, tap: str) -> None:
    fault = begin(tap, "missing-code")
    given = [fault.apply(code, 0) for code in range(256)]
    assert set(range(256)) - {int(code) for code in given} == {128}
    assert given == sorted(given)


def test_the_code_below_takes_the_place_of_several_that_are_missing(begin: Begin) -> None:
    fault = begin("adc.channel2", "missing-code", code=64, count=3)
    assert [fault.apply(code, 0) for code in range(62, 69)] == [62, 63, 63, 63, 63, 67, 68]


def test_codes_may_be_missing_up_to_the_end_of_the_range(begin: Begin) -> None:
    fault = begin("adc.channel2", "missing-code", code=250, count=255)
    assert [fault.apply(code, 0) for code in (249, 250, 255)] == [249, 249, 249]


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("tap", TAPS)
def test_bits_and_codes_are_those_of_the_card_at_the_tap(bits: int, tap: str) -> None:
    at = taps_of(cell_of_bits(bits))[tap]
    (bit, _), (code, count) = parameters_at(StuckBit, at), parameters_at(MissingCode, at)
    assert (bit.minimum, bit.default, bit.maximum) == (0, bits // 2, bits - 1)
    assert (code.minimum, code.default, code.maximum) == (1, 2 ** (bits - 1), 2**bits - 1)
    assert (count.minimum, count.maximum) == (1, 2**bits - 1)


@pytest.mark.parametrize(
    ("code", "bit", "value", "stuck"), [(5, 15, 1, 5 - 32_768), (-1, 15, 0, 32_767), (-2, 0, 1, -1)]
)
def test_the_sign_of_a_count_can_be_stuck(code: int, bit: int, value: int, stuck: int) -> None:
    """Two's complement of 16 bits."""
    fault = StuckBit(bit=bit, value=value)
    tap = Tap("counter.channel1", TapKind.ADC_CODE, "count", "LSB", -32_768, 32_767, 1)
    fault.begin(Context(tap, 0, 2_500_000, Random(0)))
    assert fault.apply(code, 0) == stuck
