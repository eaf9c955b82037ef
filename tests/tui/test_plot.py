"""Plots against dots, labels and times worked out by hand."""

import re

import numpy as np
import pytest

from canarm_tui.plot import LABEL_WIDTH, Part, Plot, Stroke, nice_range, nice_scale, plot_rows, scale_labels, time_row
from canarm_tui.texts import Tone, Word


def text_of(row):
    return "".join(run.text for run in row)


def constant(value, columns):
    return Stroke(np.full(columns, value), np.full(columns, value))


@pytest.mark.parametrize(
    ("greatest", "scale"),
    [(np.nan, 2), (0.0, 2), (0.3, 0.5), (1.2, 2), (2.0, 2), (2.1, 5), (5.1, 10), (11, 20), (49, 50), (51, 100)],
)
def test_a_scale_about_zero_ends_at_the_least_of_1_2_5_10_that_holds_all(greatest, scale):
    assert nice_scale(greatest) == pytest.approx(scale)


@pytest.mark.parametrize(
    ("low", "high", "ends"),
    [(-28.0, 44.9, (-30.0, 50.0)), (0.11, 0.19, (0.11, 0.19)), (np.nan, np.nan, (-1.0, 1.0))],
)
def test_another_scale_goes_from_one_round_number_to_the_next_beyond(low, high, ends):
    found = nice_range(low, high)
    assert found == pytest.approx(ends, abs=1e-5)
    assert found[1] > found[0]


@pytest.mark.parametrize("value", [0.0, 3.0, -1.2345, 57.29578, 1.5707963, 0.02, 123.456, -2048.0, 1e-7])
def test_the_ends_of_a_constant_signal_have_labels_that_differ_and_fit(value):
    low, high = nice_range(value, value)
    most, *_, least = scale_labels(low, high, 5)
    assert low < value < high
    assert len({most, least} - {""}) == 2
    assert max(len(most), len(least)) < LABEL_WIDTH


def test_labels_name_the_ends_the_limits_and_zero():
    assert scale_labels(-2.0, 2.0, 9, [1.0, -1.0]) == ["+2", "", "+1", "", "0", "", "−1", "", "−2"]
    assert scale_labels(-50.0, 50.0, 4, [1.0, -1.0]) == ["+50", "+1", "−1", "−50"], "limits keep theirs"
    assert scale_labels(-2.0, 2.0, 9, [1.5, -1.5])[1] == "+1.5"
    assert scale_labels(10.0, 30.0, 3) == ["+30", "", "+10"], "zero is not in it"


def test_a_second_line_is_dotted_and_the_first_one_covers_it():
    # One row of four dot rows for ±1.5: +0.5 is the second from the top, −0.5 the third; the left dots are 2 and 3.
    plot = Plot([constant(0.5, 4), constant(-0.5, 4)], -1.5, 1.5)
    assert text_of(plot_rows(plot, 1, 2)[0])[LABEL_WIDTH:] == "⠖⠖"
    alone = Plot([constant(np.nan, 4), constant(-0.5, 4)], -1.5, 1.5)
    label, line = plot_rows(alone, 1, 2)[0]
    assert (line.text, line.part, label.part) == ("⠄⠄", Part.SECOND, Part.SCALE)


def test_signs_stand_over_all_and_a_cursor_over_the_line():
    plot = Plot([constant(1.5, 8)], -1.5, 1.5, signs={1: Word("▲", Tone.WARNING)}, cursor=3)
    top, bottom = plot_rows(plot, 2, 4)
    assert text_of(top)[LABEL_WIDTH:] == "⠉▲⠉⠉"
    assert [run.part for run in top[1:]] == [Part.FIRST, Part.SIGN + 1, Part.FIRST, Part.CURSOR]
    assert text_of(bottom)[LABEL_WIDTH:] == "   │"


def test_limits_beyond_the_scale_are_not_drawn_at_its_end():
    assert text_of(plot_rows(Plot([], -1.0, 1.0, limits=(3.0, -3.0)), 1, 4)[0])[LABEL_WIDTH:].strip() == ""


def test_times_stand_where_they_belong():
    # 40 cells for 10 s are four a second; a label every 5 s is every 20 cells.
    assert time_row(0.0, 10.0, 40) == "╵0 s" + " " * 16 + "╵5 s" + " " * 16
    assert time_row(0.0, 1.0, 5) == " " * 5, "there is no room"
    assert time_row(0.25, 0.35, 60).split("╵")[1].strip() == "0.26 s"


@pytest.mark.parametrize("cells", [24, 30, 36, 43, 60, 90])
def test_there_are_two_times_wherever_the_stretch_ends(cells):
    """Two labels of up to eight characters, such as ╵119.5 s, and a blank between them have room in 24 cells."""
    for tenths in range(0, 1200, 7):
        for span_s in (0.1, 1.0, 10.0, 60.0, 120.0):
            end_s = tenths / 10 + span_s
            row = time_row(end_s - span_s, end_s, cells)
            labels = re.findall(r"╵(\d+(?:\.\d+)?) s(?= |$)", row)
            assert len(labels) == row.count("╵") >= 2, (row, end_s, span_s)
            starts = [place for place, letter in enumerate(row) if letter == "╵"]
            for start, label in zip(starts, labels, strict=True):
                assert abs(end_s - span_s + start * span_s / cells - float(label)) <= span_s / cells + 1e-9
