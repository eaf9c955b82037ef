"""The bytes at a card's addresses, as the descriptors say, are those that the emulated cards take and give.

The cards' register maps are tested against their data sheets in tests/emulator.
"""

import pytest

from canarm_emulator.cards.adc import AdcCard
from canarm_emulator.cards.adc0809 import Adc0809Card
from canarm_emulator.cards.dac import DacCard
from canarm_emulator.cards.dac0808 import Dac0808Card
from canarm_emulator.cards.encoder_counter import COUNT, EncoderCounterCard
from canarm_emulator.cards.sc300 import Sc300Card
from canarm_emulator.robot.truth import AdcTruth
from canarm_protocol.cards.analogue import AdcSettings, ResolutionSettings
from canarm_protocol.cards.encoder_counter import CounterSettings
from canarm_protocol.cards.kind import Settings
from canarm_protocol.cards.registry import KINDS

CHANNELS = (1, 2, 4)


def written(card, kind, settings, number, code):
    """What the card has after the bytes for `code` were written to its addresses."""
    for byte in KINDS[kind].registers(settings, number, code):
        card.write(byte.address, byte.value, 0)
    return card.code(number - 1)


@pytest.mark.parametrize("number", CHANNELS)
def test_what_is_written_to_the_converters_is_the_code(number):
    for code in (0, 1, 0x5A, 0xFF):
        assert written(Dac0808Card(lambda *_: None), "dac0808", Settings(), number, code) == code
    for code in (0, 1, 0x5A5, 0xFFF):
        assert written(DacCard(12, lambda *_: None), "dac", ResolutionSettings(bits=12), number, code) == code


def test_the_latchs_bits_are_those_of_its_joints():
    told = {}
    card = Sc300Card(told.__setitem__)
    bits = [1, 2, 3, 0]
    card.write(
        0, sum(KINDS["sc300"].registers(Settings(), number, bits[number - 1])[0].value for number in (1, 2, 3, 4)), 0
    )
    assert [told.get(channel, 0) for channel in range(4)] == bits
    assert [KINDS["sc300"].registers(Settings(), number, 0)[0].mask for number in (1, 2, 3, 4)] == [3, 12, 48, 192]


def test_what_is_read_of_the_converters_is_the_code():
    """2.5 V of 5 V at the pin: half of the codes."""
    errors = AdcTruth()
    card = Adc0809Card(lambda _: 2.5, 5.0, 100_000, errors)
    card.write(3, 0, 0)
    code = card.read(9, 200_000)
    assert [(each.address, each.value) for each in KINDS["adc0809"].registers(Settings(), 4, code)] == [(9, code)]
    wide = AdcCard(12, lambda _: 2.5, 5.0, 100_000, errors)
    wide.write(3, 0, 0)
    read = {address: wide.read(address, 200_000) for address in (9, 10)}
    code = read[9] | read[10] << 8
    assert abs(code - 0x800) <= 1
    assert {each.address: each.value for each in KINDS["adc"].registers(AdcSettings(bits=12), 4, code)} == read


@pytest.mark.parametrize("turns", [0.25, -0.25])
def test_what_is_latched_of_a_counter_is_the_count(turns):
    """A quarter of a turn of 500 lines, four edges each, is 500 counts."""
    angle = [0.0]
    card = EncoderCounterCard(lambda _: angle[0], lambda _: 500, 32, 4)
    card.write(4 * 2 + COUNT, 0, 0)
    angle[0] = turns * 6.283185307179586
    card.write(4 * 2 + COUNT, 0, 0)
    settings = CounterSettings(counter_bits=32, decoding=4)
    for byte in KINDS["encoder_counter"].registers(settings, 3, round(turns * 2000)):
        assert card.read(byte.address, 0) == byte.value
