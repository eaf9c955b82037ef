"""A row of the table of joints: units, marks, and that it fits where it is shown."""

import math

import pytest

from canarm_tui.joint_texts import COLUMNS, columns_for, joint_words, limit_word, turn_word
from canarm_tui.snapshot import JointNow


def texts(joint, width=200, inner=0):
    return [word.text for word in joint_words(joint, columns_for(width), inner)]


@pytest.mark.parametrize(
    ("joint", "text"),
    [
        (JointNow(current_a=1.4, command_a=1.5, saturation=1, limit_a=1.5), "▲ 93 % +"),
        (JointNow(current_a=-1.5, command_a=-1.5, saturation=-1, limit_a=1.5), "▲ 100 % −"),
        (JointNow(current_a=-0.3, command_a=0.2, limit_a=1.5), "20 %"),
        (JointNow(), "–"),
    ],
)
def test_a_current_is_compared_with_the_amplifiers_limit_and_a_command_at_it_is_marked(joint, text):
    assert limit_word(joint).text == text


@pytest.mark.parametrize(("command_a", "text"), [(0.2, "+"), (-0.2, "−"), (0.0, "off"), (math.nan, "–")])
def test_the_bridge_turns_one_way_the_other_or_not_at_all(command_a, text):
    assert turn_word(JointNow(command_a=command_a)).text == text


def test_a_row_is_in_degrees_and_marks_an_error_beyond_one_step():
    joint = JointNow(
        math.pi / 6, -0.5, math.pi / 4, -1.25, 0.5, 1.25, 0.75, -1.5, -1, math.pi / 3, 1.5, 255, (0.0, 2.5)
    )
    assert texts(joint, inner=1) == [
        "+45.00", "+30.00", "+60.00", "▲ −1.25", "0.50", "−0.500", "+0.750", "▲ 50 % −", "−1.500", "255", "−",
        "+2.5000",
    ]  # fmt: skip
    assert texts(joint, width=80) == [
        "+45.00", "+30.00", "+60.00", "▲ −1.25", "−0.500", "+0.750", "▲ 50 % −", "255", "−",
    ]  # fmt: skip


def test_every_text_of_a_row_fits_its_column_and_the_row_its_terminal():
    far = JointNow(-math.pi, -10.0, -math.pi, -255.0, 255.0, 255.0, -10.0, -10.0, -1, -math.pi, 1.5, 255, (-99.0,))
    for text, column in zip(texts(far), COLUMNS, strict=True):
        assert len(text) < column.width, column.title
    for width in (80, 100, 110, 120):
        assert sum(column.width for column in columns_for(width)) + len("joint2") < width - 1
