"""Filters as they are typed."""

import pytest

from canarm_protocol.decoding import Decoder, robot_book
from canarm_tui.bus.filtering import FrameFilter
from tests.tui.bus.frames import frame

SYNC, ADC, HEARTBEAT, EMCY = "080#", "294#00490040803F803F", "714#05", "094#3081110000000000"


@pytest.mark.parametrize(
    ("text", "fitting"),
    [
        ("", [SYNC, ADC, HEARTBEAT, EMCY]),
        ("294", [ADC]),
        ("0x294", [ADC]),
        ("200-2ff", [ADC]),
        ("adc", [ADC, HEARTBEAT, EMCY]),
        ("ADC -heartbeat", [ADC, EMCY]),
        ("wrong", [EMCY]),
        ("-sync -pdo", [HEARTBEAT, EMCY]),
        ("tpdo2", [ADC]),
        ("nothing-at-all", []),
        ("[a-", []),
        ("ffffffffffffffffff", []),
    ],
)
def test_a_filter_keeps_what_all_its_words_fit(cell, text, fitting):
    decoder, wanted = Decoder(robot_book(cell)), FrameFilter.parse(text)
    texts = [SYNC, ADC, HEARTBEAT, EMCY]
    assert [each for each in texts if wanted.fits(frame(each), decoder.meaning(frame(each)))] == fitting


def test_a_filter_is_bounded():
    assert len(FrameFilter.parse("a " * 100_000).terms) == 16
