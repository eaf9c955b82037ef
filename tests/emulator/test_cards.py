"""The cards as an Apple II sees them, sixteen registers each, against the data sheets of their parts."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm_emulator.cards.adc0809 import DATA, END_OF_CONVERSION, STATUS, Adc0809Card
from canarm_emulator.cards.dac0808 import Dac0808Card
from canarm_emulator.cards.device import AdcDevice, DacDevice, LatchDevice
from canarm_emulator.cards.registers import OPEN_BUS, REGISTERS
from canarm_emulator.cards.sc300 import Sc300Card
from canarm_emulator.robot.truth import AdcTruth

FULL_SCALE_V = 5.0
CONVERSION_NS = 100_000


class Outputs(list):
    """What a card told of its outputs: (channel, value) in order."""

    def __call__(self, channel: int, value: float) -> None:
        self.append((channel, value))


def load(card: Dac0808Card, channel: int, code: int) -> None:
    card.write(2 * channel, code & 0x0F, 0)
    card.write(2 * channel + 1, code >> 4, 0)


class PowerOn:
    """A clock that stands at power-on."""

    time_ns = 0


def adc_device(volts: Callable[[int], float]) -> AdcDevice:
    return AdcDevice(Adc0809Card(volts, FULL_SCALE_V, CONVERSION_NS), volts, 8, 8, PowerOn())


def ideal_adc(volts: float = 0.0, **errors: float) -> Adc0809Card:
    return Adc0809Card(lambda channel: volts, FULL_SCALE_V, CONVERSION_NS, AdcTruth(**errors))


def test_dac_follows_each_4_bit_latch_at_once_so_a_code_passes_through_an_intermediate_one() -> None:
    outputs = Outputs()
    card = Dac0808Card(outputs)
    load(card, 1, 0x7F)
    load(card, 1, 0x80)
    assert outputs == [(1, 0x0F / 256), (1, 0x7F / 256), (1, 0x70 / 256), (1, 0x80 / 256)]
    assert card.code(1) == 0x80
    assert [card.code(channel) for channel in (0, 2, 3)] == [0, 0, 0]


def test_dac_tells_of_changes_only_and_takes_four_bits_a_latch() -> None:
    outputs = Outputs()
    card = Dac0808Card(outputs)
    for value in (0xF5, 0xF5, 0x05):
        card.write(0, value, 0)
    assert outputs == [(0, 5 / 256)]


def test_dac_full_scale_is_255_of_256_of_the_reference() -> None:
    outputs = Outputs()
    load(Dac0808Card(outputs), 3, 0xFF)
    assert outputs[-1] == (3, 255 / 256)


@pytest.mark.parametrize("nonlinearity", [0.0019, -0.0019])
def test_dac_stays_within_its_nonlinearity_of_the_line_between_its_end_points(nonlinearity: float) -> None:
    """DAC0808 data sheet: relative accuracy ±0.19 % of full scale, monotonic."""
    outputs = Outputs()
    card = Dac0808Card(outputs, nonlinearity)
    transfer = {0: 0.0}
    for code in range(1, 256):
        load(card, 0, code)
        transfer[code] = outputs[-1][1]
    deviations = [(transfer[code] - code / 256) / (255 / 256) for code in range(256)]
    assert deviations[0] == deviations[255] == 0.0
    worst = max(deviations, key=abs)
    assert worst == pytest.approx(nonlinearity, rel=1e-3)
    assert abs(worst) <= abs(nonlinearity)
    assert all(transfer[code] < transfer[code + 1] for code in range(255))


def test_dac_and_latch_cannot_be_read_back_and_ignore_other_addresses() -> None:
    outputs = Outputs()
    card = Dac0808Card(outputs)
    for address in range(8, REGISTERS):
        card.write(address, 0xFF, 0)
    assert outputs == []
    assert {card.read(address, 0) for address in range(REGISTERS)} == {OPEN_BUS}
    assert {Sc300Card(outputs).read(address, 0) for address in range(REGISTERS)} == {OPEN_BUS}


def test_latch_holds_two_bits_a_joint_and_tells_of_those_that_change() -> None:
    outputs = Outputs()
    card = Sc300Card(outputs)
    card.write(0, 0b11_00_01_10, 0)
    assert outputs == [(0, 0b10), (1, 0b01), (3, 0b11)]
    outputs.clear()
    card.write(0x0F, 0b11_00_10_10, 0)  # an I/O selector decodes none of A3 to A0
    assert outputs == [(1, 0b10)]
    assert card.value == 0b11_00_10_10


def test_adc_converts_one_channel_after_the_other_and_says_when_it_is_done() -> None:
    volts = [channel * 0.51 for channel in range(8)]
    card = Adc0809Card(lambda channel: volts[channel], FULL_SCALE_V, CONVERSION_NS)
    now_ns = 1_000
    for channel in (3, 5):
        before = card.read(DATA, now_ns)
        card.write(channel, 0, now_ns)
        done_ns = now_ns + CONVERSION_NS
        assert card.read(STATUS, done_ns - 1) & END_OF_CONVERSION == 0
        assert card.read(DATA, done_ns - 1) == before
        assert card.read(STATUS, done_ns) & END_OF_CONVERSION
        assert card.read(DATA, done_ns) == round(volts[channel] / FULL_SCALE_V * 255)
        now_ns = done_ns


def test_adc_takes_its_input_at_the_start_of_a_conversion() -> None:
    volts = [1.0]
    card = Adc0809Card(lambda channel: volts[0], FULL_SCALE_V, CONVERSION_NS)
    card.write(0, 0, 0)
    volts[0] = 4.0
    assert card.read(DATA, CONVERSION_NS) == 51


def test_adc_abandons_a_conversion_when_another_is_started() -> None:
    volts = [1.0, 4.0]
    card = Adc0809Card(lambda channel: volts[channel], FULL_SCALE_V, CONVERSION_NS)
    card.write(0, 0, 0)
    card.write(1, 0, CONVERSION_NS // 2)
    assert card.read(STATUS, CONVERSION_NS) & END_OF_CONVERSION == 0
    assert card.read(DATA, CONVERSION_NS) == 0
    assert card.read(DATA, CONVERSION_NS * 3 // 2) == 204


def test_adc_keeps_a_finished_result_while_the_next_conversion_runs() -> None:
    volts = [1.0, 4.0]
    card = Adc0809Card(lambda channel: volts[channel], FULL_SCALE_V, CONVERSION_NS)
    card.write(0, 0, 0)
    card.write(1, 0, CONVERSION_NS)
    assert card.read(DATA, CONVERSION_NS + 1) == 51


def test_adc_has_no_register_beyond_its_data() -> None:
    card = ideal_adc(2.5)
    for address in range(8, REGISTERS):
        card.write(address, 0, 0)
    assert card.read(DATA, CONVERSION_NS) == 0
    assert {card.read(address, 0) for address in (*range(8), *range(10, REGISTERS))} == {OPEN_BUS}


@given(st.floats(0.0, FULL_SCALE_V))
def test_adc_quantises_to_half_a_step(volts: float) -> None:
    step_v = FULL_SCALE_V / 255
    assert abs(ideal_adc().code(volts) * step_v - volts) <= step_v / 2 * (1 + 1e-9)


@pytest.mark.parametrize(("volts", "code"), [(-1.0, 0), (0.0, 0), (5.0, 255), (5.1, 255), (1e3, 255), (2.5, 128)])
def test_adc_ends_at_its_ends(volts: float, code: int) -> None:
    assert ideal_adc().code(volts) == code


def test_adc_errors_shift_stretch_and_bow_the_codes() -> None:
    def error_lsb(volts: float, **errors: float) -> float:
        """Where the code's step begins to differ from ideal, as a mean over one step's width."""
        samples = 200
        card, ideal = ideal_adc(**errors), ideal_adc()
        inputs = [volts + FULL_SCALE_V / 255 * k / samples for k in range(samples)]
        return sum(card.code(v) - ideal.code(v) for v in inputs) / samples

    assert error_lsb(2.0, offset_lsb=0.5) == pytest.approx(0.5, abs=0.01)
    assert error_lsb(4.0, gain_error=0.005) == pytest.approx(0.005 * 4.0 / 5.0 * 255, abs=0.02)
    assert error_lsb(2.5, nonlinearity_lsb=1.0) == pytest.approx(1.0, abs=0.02)
    assert error_lsb(0.02, nonlinearity_lsb=1.0) == pytest.approx(0.0, abs=0.05)
    assert error_lsb(4.96, nonlinearity_lsb=1.0) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize(
    ("value", "code"), [(0, 0), (0x7FFF, 255), (0x4000, 128), (0x7F, 0), (0x80, 1), (-1, 0), (-0x8000, 0)]
)
def test_dac_as_cia_401_takes_the_upper_eight_of_fifteen_bits_and_no_negative_value(value: int, code: int) -> None:
    card = Dac0808Card(Outputs())
    device = DacDevice(card, 8, 4, PowerOn())
    device.setter(0x6411, 2)(value)
    assert card.code(1) == code
    assert device.getter(0x6411, 2)() == code << 7


def test_each_device_has_its_objects_and_no_other() -> None:
    dac, latch, adc = (
        DacDevice(Dac0808Card(Outputs()), 8, 4, PowerOn()),
        LatchDevice(Sc300Card(Outputs()), (0, 1), PowerOn()),
        adc_device(float),
    )
    assert [sub for sub in range(6) if dac.setter(0x6411, sub)] == [1, 2, 3, 4]
    assert [sub for sub in range(6) if dac.getter(0x6411, sub)] == [1, 2, 3, 4]
    assert [sub for sub in range(3) if latch.setter(0x6200, sub)] == [1]
    assert [sub for sub in range(3) if latch.getter(0x6200, sub)] == [1]
    assert [sub for sub in range(10) if adc.getter(0x6401, sub)] == list(range(1, 9))
    assert adc.setter(0x6401, 1) is None
    assert dac.setter(0x6200, 1) is latch.setter(0x6411, 1) is adc.getter(0x6411, 1) is None


def test_latch_error_values_replace_the_bits_that_the_error_mode_selects() -> None:
    """CiA 401: a bit of 0x6206 that is 1 takes the bit of 0x6207; one that is 0 keeps its output."""
    card = Sc300Card(Outputs())
    device = LatchDevice(card, (0, 1), PowerOn())
    device.setter(0x6200, 1)(0b1010_1010)
    objects = {(0x6206, 1): 0b0000_1111, (0x6207, 1): 0b0101_0101}
    device.take_error_values(lambda index, subindex: objects[index, subindex])
    assert card.value == 0b1010_0101


def test_dac_error_values_are_the_upper_half_of_32_bits_where_the_error_mode_is_1() -> None:
    """CiA 401: 0x6444 is 32 bits wide and left-adjusted, whatever the width of the output."""
    card = Dac0808Card(Outputs())
    device = DacDevice(card, 8, 4, PowerOn())
    for channel in range(1, 5):
        device.setter(0x6411, channel)(0x7FFF)
    objects = {(0x6443, n): mode for n, mode in enumerate((1, 0, 1, 1), 1)}
    objects |= {(0x6444, n): value for n, value in enumerate((0, 0, 0x4000_0000, -1), 1)}
    device.take_error_values(lambda index, subindex: objects[index, subindex])
    assert [card.code(channel) for channel in range(4)] == [0, 255, 128, 0]


def test_adc_as_cia_401_shows_the_last_scan_until_it_is_refreshed() -> None:
    volts = [0.0] * 8
    device = adc_device(lambda channel: volts[channel])
    read = device.getter(0x6401, 3)
    device.scan(0, ((2, 0, 0),), [5.0])
    assert read() == 255 << 7
    volts[2] = 2.5
    assert read() == 255 << 7
    device.refresh(0x6401, 3)
    assert read() == 128 << 7
    device.refresh(0x6401, 9)
    device.refresh(0x2000, 0)
