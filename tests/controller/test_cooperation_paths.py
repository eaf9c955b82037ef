"""Paths of the point A, built in and from a file: where they go, when, and what is no path."""

import math
from pathlib import Path as FilePath

import numpy as np
import pytest

from canarm.cooperation import CooperationError, Path, arc, circle, line, read_path, through


def test_a_circle_runs_from_its_planes_first_axis_to_its_second_and_comes_back() -> None:
    path = circle(0.0127)
    assert len(path) == 2001
    assert path.time_s[-1] == 5.0
    np.testing.assert_allclose(np.diff(path.time_s), 0.0025, rtol=1e-9)
    np.testing.assert_allclose(path.point_m[500], [0.0, -0.0127, 0.0127], atol=1e-15)  # a quarter: at the top
    np.testing.assert_allclose(path.point_m[1000], [0.0, -0.0254, 0.0], atol=1e-15)
    np.testing.assert_allclose(path.point_m[-1], 0.0, atol=1e-15)
    assert path.length_m == pytest.approx(2 * math.pi * 0.0127, rel=1e-6)


def test_half_an_inch_in_diameter_is_an_option() -> None:
    path = circle(0.5 * 0.0254 / 2, plane="yz")
    assert np.ptp(path.point_m[:, 1]) == pytest.approx(0.0127, rel=1e-6)
    assert np.ptp(path.point_m[:, 2]) == pytest.approx(0.0127, rel=1e-6)


def test_an_arc_begins_where_it_is_told_and_runs_back_for_a_negative_angle() -> None:
    path = arc(0.1, -90.0, plane="xy", start_deg=90.0, seconds=1.0)
    np.testing.assert_allclose(path.point_m[-1], [0.1, -0.1, 0.0], atol=1e-15)
    assert path.length_m == pytest.approx(0.1 * math.pi / 2, rel=1e-5)
    np.testing.assert_allclose(circle(0.1, laps=-1.0).point_m, circle(0.1).point_m * [1, 1, -1], atol=1e-15)


def test_an_eased_line_is_at_rest_at_both_ends_and_even_between_them() -> None:
    path = line((0.0, 0.03, 0.04), seconds=2.0, ease_s=0.5, period_s=0.001)
    speed = np.linalg.norm(np.gradient(path.point_m, path.time_s, axis=0), axis=1)
    assert path.length_m == pytest.approx(0.05, rel=1e-9)
    assert speed[0] < 1e-5
    assert speed[-1] < 1e-5
    np.testing.assert_allclose(speed[501:1500], 0.05 / 1.5, rtol=1e-4)  # 2 s less half of the two times of 0.5 s
    acceleration = np.gradient(speed, path.time_s)
    assert np.abs(np.diff(acceleration)).max() < 2e-3  # no jump


def test_points_are_joined_by_straight_lines_at_even_speed() -> None:
    path = through([[0, 0, 0], [1, 0, 0], [1, 2, 0]], [0.0, 1.0, 3.0], period_s=0.5)
    np.testing.assert_allclose(path.point_m[:, 0], [0, 0.5, 1, 1, 1, 1, 1])
    np.testing.assert_allclose(path.point_m[:, 1], [0, 0, 0, 0.5, 1, 1.5, 2])
    assert not path.from_start


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("mm", 1e-3), ("in", 0.0254)])
def test_a_file_has_its_unit_in_the_header(tmp_path: FilePath, unit: str, scale: float) -> None:
    file = tmp_path / "path.csv"
    file.write_text(f"z_{unit}, time_s, x_{unit}, y_{unit}\n0.3,0,0.1,0.2\n\n0.5,0.01,0.1,0.2\n", encoding="utf-8")
    path = read_path(file, period_s=0.005)
    np.testing.assert_allclose(path.point_m, scale * np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.4], [0.1, 0.2, 0.5]]))
    with pytest.raises(CooperationError, match=r"path\.csv: the first displacement is .*; must be 0, where the tip is"):
        read_path(file, from_start=True)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "row 1 has the columns none; must be time_s, x_m, y_m, z_m"),
        ("time_s,x_m,y_m\n", "row 1 has the columns time_s, x_m, y_m; must be"),
        ("time_s,x_m,y_m,z_mm\n", "row 1 has the columns time_s, x_m, y_m, z_mm; must be time_s, x_m, y_m, z_m"),
        ("time_s,x_m,y_m,z_m\n0,1,2\n", "row 2 has 3 values; the header has 4 columns"),
        ("time_s,x_m,y_m,z_m\n0,1,2,inf\n", "row 2, column z_m: 'inf' is not a finite number"),
        ("time_s,x_m,y_m,z_m\n0,1,two,3\n", "row 2, column y_m: 'two' is not a finite number"),
        ("time_s,x_m,y_m,z_m\n0,1,2,3\n", "1 rows of values; a path needs at least 2"),
        ("time_s,x_m,y_m,z_m\n1,1,2,3\n2,1,2,3\n", "row 2: time_s = 1; the first must be 0"),
        ("time_s,x_m,y_m,z_m\n0,1,2,3\n0,1,2,3\n", "point 1 of the path at 0 s; must be later than the one before"),
        ("time_s,x_m,y_m,z_m\n0,1,2,3\n1e9,1,2,3\n", "1e\\+09 s in steps of 0.0025 s; must be at most"),
        ("time_s,x_m,y_m,z_m\n0,1,2,3\n0.001,1,2,3\n", "0.001 s in steps of 0.0025 s; must be positive, and at least"),
    ],
)
def test_a_file_that_is_no_path_is_refused_by_row_and_column(tmp_path: FilePath, text: str, said: str) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(CooperationError, match=f"path.csv: {said}") as refused:
        read_path(file)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_none_is_refused(tmp_path: FilePath) -> None:
    with pytest.raises(CooperationError, match=r"none\.csv: cannot be read as a CSV file"):
        read_path(tmp_path / "none.csv")
    with pytest.raises(CooperationError, match="is no regular file; a path is a CSV file"):
        read_path(tmp_path)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: circle(-1.0), "radius_m = -1.0; must be positive"),
        (lambda: circle(plane="zz"), "plane 'zz'; must be one of xy, yz, zx"),
        (lambda: arc(0.1, 0.0), "an arc of 0.0 deg from 0.0 deg; must be finite, and not 0 long"),
        (lambda: line((0.0, 0.0, 0.0)), "must be three finite numbers in m, not all 0"),
        (lambda: line((0.1, 0.0, 0.0), ease_s=3.0), "ease_s = 3.0; must be from 0 to half of the path's 5 s"),
        (lambda: line((0.1, 0.0, 0.0), seconds=0.0), "0.0 s in steps of 0.0025 s; must be positive"),
        (lambda: circle(seconds=math.nan), "nan s in steps of 0.0025 s; must be positive"),
        (lambda: Path([0.0], [[0, 0, 0]]), r"times \(1,\) and points \(1, 3\); must be \(n,\) and \(n, 3\)"),
        (lambda: Path([0.0, 1.0], [[0, 0, 0], [0, 0, math.nan]]), "a time or a point of the path is not finite"),
        (lambda: Path(["a"], [[0, 0, 0]]), "times and points of a path must be numbers"),
    ],
)
def test_what_is_no_path_is_refused_with_what_would_be_right(make: object, said: str) -> None:
    with pytest.raises(CooperationError, match=said):
        make()  # type: ignore[operator]
