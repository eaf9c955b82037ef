"""Braille lines against dots worked out by hand; bit values are those of Unicode's Braille Patterns chart (U+2800)."""

import numpy as np
import pytest

from canarm_tui.braille import decimate, limit_cells, pack_dots, trace_cells

NAN = np.nan


def characters(cells):
    return ["".join(chr(0x2800 + bits) for bits in row) for row in cells.tolist()]


@pytest.mark.parametrize(
    ("row", "column", "character"),
    [(0, 0, "⠁"), (1, 0, "⠂"), (2, 0, "⠄"), (3, 0, "⡀"), (0, 1, "⠈"), (1, 1, "⠐"), (2, 1, "⠠"), (3, 1, "⢀")],
)
def test_each_dot_has_unicodes_bit(row, column, character):
    dots = np.zeros((4, 2), dtype=bool)
    dots[row, column] = True
    assert characters(pack_dots(dots)) == [character]


def test_a_stroke_fills_its_column_from_least_to_greatest():
    # One character row, scale ±1.5: dot rows 0..3 are +1.5, +0.5, -0.5, -1.5.
    low, high = np.array([-1.5, 0.5, -0.5, NAN]), np.array([1.5, 0.5, 0.5, NAN])
    # column 0: dots 1237, column 1: dot 5; column 2: dots 2 and 3; column 3: none
    assert characters(trace_cells(low, high, 1.5, 1)) == ["⡗⠆"]


def test_a_line_may_cross_character_rows():
    # Two rows, scale ±7: eight dot rows, +7 +5 +3 +1 | -1 -3 -5 -7.
    low, high = np.array([-1.0, 7.0]), np.array([1.0, 7.0])
    assert characters(trace_cells(low, high, 7.0, 2)) == ["⡈", "⠁"]


def test_values_beyond_the_scale_are_drawn_at_its_ends():
    assert characters(trace_cells(np.array([9.0, -9.0]), np.array([9.0, -9.0]), 1.5, 1)) == ["⢁"]


def test_limit_lines_are_dotted():
    assert characters(limit_cells(np.array([0.5, -1.5]), 1.5, 1, 3)) == ["⡂⡂⡂"]


def test_each_column_holds_least_and_greatest_of_its_samples():
    cycles = np.array([0, 1, 2, 3, 8, 9])
    values = np.array([1.0, -3.0, 2.0, 5.0, 7.0, 6.0])
    low, high = decimate(cycles, values, columns=3, cycles_a_column=4)
    np.testing.assert_array_equal(low, [-3.0, NAN, 6.0])
    np.testing.assert_array_equal(high, [5.0, NAN, 7.0])


def test_a_column_reaches_to_the_last_value_before_it():
    low, high = decimate(np.array([0, 1, 2, 3]), np.array([0.0, 1.0, 4.0, 5.0]), columns=2, cycles_a_column=2)
    np.testing.assert_array_equal(low, [0.0, 1.0])
    np.testing.assert_array_equal(high, [1.0, 5.0])


def test_a_trace_keeps_its_shape_while_it_moves_on():
    cycles = np.arange(200)
    values = np.sin(0.37 * cycles)
    before = decimate(cycles[:196], values[:196], columns=20, cycles_a_column=4)
    after = decimate(cycles, values, columns=20, cycles_a_column=4)
    np.testing.assert_array_equal(after[0][:19], before[0][1:])
    np.testing.assert_array_equal(after[1][:19], before[1][1:])


def test_samples_older_than_the_columns_and_unknown_ones_are_left_out():
    low, high = decimate(
        np.array([0, 9, 10, 11, 12]), np.array([9.0, NAN, 1.0, NAN, 3.0]), columns=3, cycles_a_column=1
    )
    np.testing.assert_array_equal(low, [1.0, NAN, 3.0])
    np.testing.assert_array_equal(high, [1.0, NAN, 3.0])


def test_nothing_is_drawn_without_samples():
    low, high = decimate(np.zeros(0, dtype=np.int64), np.zeros(0), columns=4, cycles_a_column=1)
    assert characters(trace_cells(low, high, 2.0, 1)) == ["⠀⠀"]
