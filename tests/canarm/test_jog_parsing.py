"""The commands of `canarm jog`, and its errors for wrong lines. Limits are konkuk1's: 1.5 A, 255."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from canarm.jogging.parsing import AllOff, Drive, Parser, Quit, Read, SdoRead, SdoWrite, Step
from canarm.usage import UsageError
from canarm_protocol.cards.sc300 import DirectionBits
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import card_nodes

CELL = load_cell("konkuk1")
NODES = card_nodes(CELL)
PARSER = Parser(CELL, NODES)
DAC, _, ADC = NODES
CCW, CW, OFF = DirectionBits.COUNTER_CLOCKWISE, DirectionBits.CLOCKWISE, DirectionBits.OFF


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("read", Read()),
        ("SCAN", Read()),
        ("dac joint2 100", Drive(0, 100, None)),
        ("dac joint3 0xFF", Drive(1, 255, None)),
        # 255 codes for 1.5 A: 0.4 A are 68 codes, 0.3 A are 51.
        ("current joint2 0.4", Drive(0, 68, CCW)),
        ("current joint3 -0.3", Drive(1, 51, CW)),
        ("current joint2 -1.5", Drive(0, 255, CW)),
        ("current joint2 0", Drive(0, 0, OFF)),
        ("dir joint2 cw", Drive(0, None, CW)),
        ("off", AllOff()),
        ("step", Step(1)),
        ("step 10   # ten cycles", Step(10)),
        ("sdo read 0x14 0x6401 1", SdoRead(ADC, 0x6401, 1)),
        ("sdo read adc 0x1008", SdoRead(ADC, 0x1008, 0)),
        ("sdo read 20 25601 1", SdoRead(ADC, 0x6401, 1)),
        ("sdo write dac 0x1017 20", SdoWrite(DAC, 0x1017, 0, b"\x14\x00")),
        ("sdo write 0x12 0x6411 1 -1", SdoWrite(DAC, 0x6411, 1, b"\xff\xff")),
        ("exit # no such thing", None),
    ],
)
def test_a_line_is_a_command(line, command):
    if command is None:
        with pytest.raises(UsageError):
            PARSER.parse(line)
    else:
        assert PARSER.parse(line) == command


def test_empty_lines_and_comments_are_no_commands():
    assert PARSER.parse("  ") is None
    assert PARSER.parse("# a note") is None


def test_semicolons_and_line_ends_part_commands():
    assert PARSER.parse_all("step 2; read;\nquit;") == [Step(2), Read(), Quit()]


@pytest.mark.parametrize(
    ("line", "what", "right"),
    [
        ("raed", "raed", "read"),
        ("jump", "jump", "step"),
        ("read all", "all", "nothing more"),
        ("dac joint2", "dac", "dac JOINT CODE"),
        ("dac joint4 1", "joint4", "joint2, joint3"),
        ("dac joint2 256", "256", "0 to 255"),
        ("dac joint2 -1", "-1", "0 to 255"),
        ("dac joint2 1.5", "1.5", "whole number"),
        ("dac joint2 ١", "١", "whole number"),
        ("current joint2 1.51", "1.51", "-1.5 to 1.5"),
        ("current joint2 nan", "nan", "-1.5 to 1.5"),
        ("current joint2 inf", "inf", "-1.5 to 1.5"),
        ("current joint2 much", "much", "number of A"),
        ("dir joint2 left", "left", "ccw, cw, off"),
        ("step 0", "0", "1 to 100000"),
        ("step 1 2", "step", "step [N]"),
        ("sdo", "sdo", "sdo read NODE INDEX"),
        ("sdo read", "sdo", "sdo read NODE INDEX"),
        ("sdo read 0x15 0x1000", "0x15", "adc (0x14)"),
        ("sdo read adc 0x10000", "0x10000", "INDEX"),
        ("sdo write dac 0x1017", "sdo", "VALUE"),
        ("sdo write dac 0x1017 0 70000", "70000", "0 to 65535"),
        ("sdo write dac 0x5000 0 1", "0x5000", "no such object"),
        ("sdo write dac 0x1008 0 1", "0x1008", "integer"),
    ],
)
def test_a_wrong_line_is_answered_with_what_is_wrong_and_what_would_be_right(line, what, right):
    with pytest.raises(UsageError) as caught:
        PARSER.parse(line)
    text = str(caught.value)
    assert what in text
    assert right in text
    assert "\n" not in text


@given(st.floats())
def test_no_current_beyond_the_amplifiers_limit_becomes_a_command(current_a):
    try:
        command = PARSER.parse(f"current joint2 {current_a!r}")
    except UsageError:
        assert not abs(current_a) <= 1.5
    else:
        assert isinstance(command, Drive)
        # to the nearest code, of which one is 1.5 A / 255
        assert abs(command.code * 1.5 / 255 - abs(current_a)) <= 1.5 / 255 / 2 * 1.000001


@given(st.text())
def test_any_text_is_a_command_or_a_usage_error(text):
    try:
        complaint = str(PARSER.parse_all(text))
    except UsageError as error:
        complaint = str(error)
    assert len(complaint.splitlines()) == 1
