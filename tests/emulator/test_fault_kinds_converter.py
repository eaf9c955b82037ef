"""Faults of converters, over all 256 codes."""

from collections.abc import Callable

import pytest

from canarm_emulator.faults.declaration import SignalFault

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
