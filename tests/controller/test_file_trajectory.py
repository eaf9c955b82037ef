"""A trajectory file is followed exactly: between the rows, before the first and after the last."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from canarm.rig.rig import Rig
from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.file_trajectory import Interpolation
from canarm_controller.reference.trajectory import FileTrajectory, make_trajectory
from canarm_controller.reference.trajectory_file import read_trajectory_csv
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
PERIOD_S = 0.0025
NAMES = ("joint2", "joint3")
WAY_POINTS = [(0, 20, 0), (3, 20, 0), (3.5, 45, 0), (6, 45, 0), (9, 45, 0)]
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(rows: Sequence[Sequence[float]], header: str = "time_s,joint2,joint3") -> Path:
        path = tmp_path / "move.csv"
        path.write_text("\n".join([header, *(",".join(f"{value:.9g}" for value in row) for row in rows), ""]))
        return path

    return write


def sampled_sine(seconds: float) -> list[tuple[float, float, float]]:
    """The built-in test motion, every cycle: 35 deg in 2.56 s about 20 deg, and 30 deg in 1.7 s."""
    times = np.arange(0.0, seconds, PERIOD_S)
    angles = [20 + 35 * np.sin(2 * np.pi * times / 2.56), 30 * np.sin(2 * np.pi * times / 1.7)]
    return list(zip(times, *angles, strict=True))


def test_between_way_points_the_reference_never_leaves_their_range(write: Write) -> None:
    position_rad = make_trajectory(str(write(WAY_POINTS)), CELL).sample(0, 4000, PERIOD_S).position_rad
    degrees = np.degrees(position_rad[:, 0])
    assert (degrees.min(), degrees.max()) == pytest.approx((20.0, 45.0), abs=1e-9)
    np.testing.assert_allclose(degrees[1400:], 45.0, atol=1e-9)  # from 3.5 s on


def test_way_points_of_which_many_are_dense_stay_in_their_range_as_well(write: Write) -> None:
    rows = [*[(0.01 * row, 20, 0) for row in range(100)], *WAY_POINTS[1:]]
    position_rad = make_trajectory(str(write(rows)), CELL).sample(0, 4000, PERIOD_S).position_rad
    degrees = np.degrees(position_rad[:, 0])
    assert (degrees.min(), degrees.max()) == pytest.approx((20.0, 45.0), abs=1e-9)


def test_a_robot_recorded_at_50_hz_gives_samples(write: Write) -> None:
    """0.06 - 0.04 is more than 0.02 in binary."""
    rows = [(0.02 * row, 20 + 10 * np.sin(0.02 * np.pi * row), 0) for row in range(250)]
    trajectory = make_trajectory(str(write(rows)), CELL)
    assert isinstance(trajectory, FileTrajectory)
    assert trajectory.interpolation is Interpolation.SAMPLES


def test_between_way_points_it_is_the_monotone_cubic_that_everybody_knows(write: Write) -> None:
    rows = [(0, 0, 0), (0.5, 5, 3), (1.2, 8, 20), (2.0, 30, 21), (3.0, 31, 40), (4.0, 20, 41)]
    times, degrees = np.array(rows)[:, 0], np.array(rows)[:, 1:]
    expected = PchipInterpolator(times, degrees)
    t = np.arange(200, 1200) * PERIOD_S  # without the first and last piece: scipy does not end at rest
    reference = make_trajectory(str(write(rows)), CELL).sample(200, 1000, PERIOD_S)
    np.testing.assert_allclose(np.degrees(reference.position_rad), expected(t), atol=1e-9)
    np.testing.assert_allclose(np.degrees(reference.velocity_rad_s), expected(t, 1), atol=1e-8)


def test_a_spline_by_choice_may_overshoot(write: Write) -> None:
    degrees = np.degrees(make_trajectory(f"{write(WAY_POINTS)}:spline", CELL).sample(0, 3600, PERIOD_S).position_rad)
    assert degrees[:, 0].max() == pytest.approx(64.0, abs=0.5)


@pytest.mark.parametrize(
    "rows",
    [WAY_POINTS, [(0.1 * row, 20 + (row % 3 == 2), 0) for row in range(60)]],
    ids=["unevenly sparse", "a square wave at 10 Hz"],
)
def test_samples_by_choice_do_not_overshoot_where_rows_are_sparse(
    write: Write, rows: Sequence[Sequence[float]]
) -> None:
    trajectory = make_trajectory(f"{write(rows)}:samples", CELL)
    assert isinstance(trajectory, FileTrajectory)
    assert trajectory.interpolation is Interpolation.SAMPLES
    times, wanted = np.array(rows)[:, 0], np.array(rows)[:, 1]
    t = np.arange(int(times[-1] / PERIOD_S)) * PERIOD_S
    degrees = np.degrees(trajectory.sample(0, len(t), PERIOD_S).position_rad[:, 0])
    left = np.searchsorted(times, t, side="right") - 1
    low, high = (of(wanted[left], wanted[left + 1]) for of in (np.minimum, np.maximum))
    assert (degrees >= low - 1e-9).all()
    assert (degrees <= high + 1e-9).all()


def test_a_motion_recorded_at_25_hz_is_still_played_smoothly(write: Write) -> None:
    rows = sampled_sine(5.12)[::16]
    trajectory = make_trajectory(f"{write(rows)}:samples", CELL)
    sine = make_trajectory("sine", CELL).sample(0, 2032, PERIOD_S)
    played = trajectory.sample(0, 2032, PERIOD_S)
    np.testing.assert_allclose(played.position_rad, sine.position_rad, atol=np.radians(0.1))


def test_dense_samples_are_played_as_they_are(write: Write) -> None:
    trajectory = make_trajectory(str(write(sampled_sine(5.12))), CELL)
    assert isinstance(trajectory, FileTrajectory)
    assert trajectory.interpolation is Interpolation.SAMPLES
    sine = make_trajectory("sine", CELL).sample(0, 2048, PERIOD_S)
    played = trajectory.sample(0, 2048, PERIOD_S)
    np.testing.assert_allclose(played.position_rad, sine.position_rad, atol=1e-8)
    np.testing.assert_allclose(played.velocity_rad_s[:-1], sine.velocity_rad_s[:-1], atol=2e-4)
    np.testing.assert_allclose(played.acceleration_rad_s2[1:-2], sine.acceleration_rad_s2[1:-2], atol=0.02)


@pytest.mark.parametrize("start_deg", [(20.0, 0.0), (-40.0, 60.0), (-90.0, -100.0)])
def test_any_pose_is_first_taken_to_the_beginning_in_a_time_of_its_own(
    write: Write, start_deg: tuple[float, float]
) -> None:
    plain = make_trajectory(str(write(WAY_POINTS)), CELL)
    entered = plain.entered_from(np.radians(start_deg))
    cycles = round(entered.approach_s / PERIOD_S)
    assert entered.approach_s == pytest.approx(cycles * PERIOD_S)
    whole = entered.sample(0, cycles + 3600, PERIOD_S)
    assert np.degrees(whole.position_rad[0]) == pytest.approx(start_deg)
    assert not whole.velocity_rad_s[0].any()
    np.testing.assert_allclose(whole.position_rad[cycles:], plain.sample(0, 3600, PERIOD_S).position_rad, atol=1e-12)


def test_a_motion_that_begins_in_full_swing_is_met_at_its_speed(write: Write) -> None:
    entered = make_trajectory(str(write(sampled_sine(5.12))), CELL).entered_from(np.radians([25.0, -5.0]))
    reference = entered.sample(0, round((entered.approach_s + 5.0) / PERIOD_S), PERIOD_S)
    assert np.abs(np.diff(reference.velocity_rad_s, axis=0)).max() < 0.06  # it meets joint 3 at 1.9 rad/s
    assert np.abs(np.diff(reference.position_rad, axis=0)).max() < 2.5 * PERIOD_S


def test_a_motion_that_ends_in_full_swing_is_brought_to_rest(write: Write) -> None:
    trajectory = make_trajectory(str(write(sampled_sine(2.56))), CELL)
    after = trajectory.sample(1023, 1000, PERIOD_S)
    assert abs(after.velocity_rad_s[0, 0]) > 1.4  # 35 deg times 2 pi / 2.56 s are 1.50 rad/s
    assert np.abs(np.diff(after.velocity_rad_s, axis=0)).max() < 0.05
    assert not after.velocity_rad_s[-1].any()


def test_a_motion_that_ends_at_full_speed_at_a_limit_is_refused(write: Write) -> None:
    times = np.arange(0.0, 2.0, 0.01)
    rows = list(zip(times, 10.0 + 59.0 * times, 0.0 * times, strict=True))
    with pytest.raises(TrajectoryError, match=r"outside limits_deg .*; it ends in motion: let it end slower"):
        make_trajectory(str(write(rows)), CELL)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("time_s,joint2_deg,joint3_deg", (1.0, 90.0, 45.0)),
        ("time_s,joint2_rad,joint3_rad", (1.0, np.pi / 2, np.pi / 4)),
        ("time_ms,joint2,joint3_rad", (1000.0, 90.0, np.pi / 4)),
    ],
)
def test_units_stand_in_the_header(write: Write, header: str, row: tuple[float, ...]) -> None:
    time_s, position_rad = read_trajectory_csv(write([(0, 0, 0), row], header), NAMES)
    assert time_s[1] == pytest.approx(1.0)
    assert np.degrees(position_rad[1]) == pytest.approx([90.0, 45.0], abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "question"),
    [
        ([(0, 0, 0), (2, 0.35, -0.5)], "are these radians? Name the columns joint2_rad and so on"),
        ([(0, 0, 0), (3000, 20, 0), (6000, 45, 0)], "are these milliseconds? Name the column time_ms"),
    ],
)
def test_what_looks_like_another_unit_is_asked_about(
    write: Write, rows: list[tuple[float, ...]], question: str
) -> None:
    with pytest.raises(TrajectoryError) as caught:
        make_trajectory(str(write(rows)), CELL)
    assert question in str(caught.value)


def test_a_runs_own_recorded_reference_is_followed(tmp_path: Path) -> None:
    with Rig("konkuk1", out=tmp_path / "first") as rig:
        rig.run(seconds=1.5)
        expected = rig.joints["joint2"].reference_rad
    recorded = tmp_path / "first" / "signals" / "controller.csv"
    with Rig("konkuk1", trajectory=str(recorded)) as rig:
        rig.run(seconds=2.5)
        assert rig.reason is None
        cycles = round(rig.approach_s / PERIOD_S)
        np.testing.assert_allclose(rig.joints["joint2"].reference_rad[cycles:][:599], expected[:599], atol=1e-8)


def test_a_file_is_no_device_and_of_bounded_size(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="is no regular file; a trajectory is a CSV file"):
        make_trajectory("/dev/zero", CELL)
