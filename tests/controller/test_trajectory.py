"""Reference trajectories: derivatives against finite differences, the numbers of the two test motions, and refusals."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from canarm_controller.errors import TrajectoryError
from canarm_controller.reference.trajectory import FileTrajectory, Reference, Trajectory, blend_from, make_trajectory
from canarm_protocol.cell.cell_file import load_cell

CELL = load_cell("konkuk1")
PERIOD_S = 0.0025
HOME_RAD = np.radians([20.0, 0.0])
FILE_TIME_S = [0.0, 0.5, 1.2, 2.0, 3.0]
FILE_DEG = [[0.0, 5.0], [10.0, 0.0], [25.0, -20.0], [15.0, -10.0], [30.0, 0.0]]


@pytest.fixture
def csv_file(tmp_path: Path) -> Path:
    path = tmp_path / "move.csv"
    rows = [f"{t},{b},{a}" for t, (a, b) in zip(FILE_TIME_S, FILE_DEG, strict=True)]
    path.write_text("\n".join(["time_s,joint3,joint2", *rows, ""]))
    return path


def all_kinds(csv_file: Path) -> list[Trajectory]:
    plain = [make_trajectory(spec, CELL) for spec in ("sine", "trapezoid", f"{csv_file}:spline")]
    return [*plain, *(blend_from(trajectory, HOME_RAD) for trajectory in plain), plain[-1].entered_from(HOME_RAD)]


def test_velocity_and_acceleration_are_derivatives_of_position(csv_file: Path) -> None:
    """Central differences, h = 0.1 ms; steps of acceleration (blends, end of a file) spoil single samples."""
    step_s = 1e-4
    for trajectory in all_kinds(csv_file):
        reference = trajectory.sample(0, 52_000, step_s)
        velocity = np.gradient(reference.position_rad, step_s, axis=0)[1:-1]
        acceleration = np.gradient(reference.velocity_rad_s, step_s, axis=0)[1:-1]
        np.testing.assert_allclose(reference.velocity_rad_s[1:-1], velocity, atol=4e-4)
        off = np.abs(reference.acceleration_rad_s2[1:-1] - acceleration) > 1e-3
        assert np.count_nonzero(off) <= 40


def test_sine_is_the_one_of_the_test_motion() -> None:
    reference = make_trajectory("sine", CELL).sample(0, 4096, PERIOD_S)
    t = np.arange(4096) * PERIOD_S
    expected = np.stack([20 + 35 * np.sin(2 * np.pi * t / 2.56), 30 * np.sin(2 * np.pi * t / 1.7)], axis=1)
    np.testing.assert_allclose(np.degrees(reference.position_rad), expected, atol=1e-9)


def test_trapezoid_moves_70_and_60_degrees_at_constant_speed() -> None:
    trajectory = make_trajectory("trapezoid", CELL)
    reference = trajectory.sample(0, 4096, PERIOD_S)
    position_deg = np.degrees(reference.position_rad)
    np.testing.assert_allclose(position_deg.min(axis=0), [-15, -30], atol=1e-9)
    np.testing.assert_allclose(position_deg.max(axis=0), [55, 30], atol=1e-9)
    steady = trajectory.constant_speed(0, 4096, PERIOD_S)
    for joint, stroke_deg in enumerate((70.0, 60.0)):
        speeds_deg_s = np.abs(np.degrees(reference.velocity_rad_s[steady[:, joint], joint]))
        np.testing.assert_allclose(speeds_deg_s, stroke_deg / (2.56 - 0.15), rtol=1e-9)
    assert steady.mean() == pytest.approx((2.56 - 2 * 0.15) / 2.56, abs=0.005)
    np.testing.assert_allclose(position_deg[2048:], position_deg[:2048], atol=1e-9)


def test_amplitude_is_half_of_the_travel(csv_file: Path) -> None:
    amplitudes = [np.degrees(trajectory.amplitude_rad).tolist() for trajectory in all_kinds(csv_file)]
    expected = [*[[35.0, 30.0], [35.0, 30.0], [15.0, 12.5]] * 2, [15.0, 12.5]]
    np.testing.assert_allclose(amplitudes, expected, rtol=1e-12)


def test_sine_has_no_constant_speed_and_the_blend_none_either() -> None:
    assert not make_trajectory("sine", CELL).constant_speed(0, 4096, PERIOD_S).any()
    steady = blend_from(make_trajectory("trapezoid", CELL), HOME_RAD).constant_speed(0, 4096, PERIOD_S)
    assert not steady[:800].any()
    assert steady[800:].any()


def test_samples_do_not_depend_on_where_a_block_begins(csv_file: Path) -> None:
    for trajectory in all_kinds(csv_file):
        whole, block = trajectory.sample(0, 1500, PERIOD_S), trajectory.sample(1000, 500, PERIOD_S)
        np.testing.assert_array_equal(whole.position_rad[1000:], block.position_rad)


@pytest.mark.parametrize("spec", ["sine", "trapezoid"])
@pytest.mark.parametrize("start_deg", [(20.0, 0.0), (-40.0, 60.0), (55.0, -30.0)])
def test_blend_starts_at_rest_on_the_measured_pose_and_merges_within_two_seconds(
    spec: str, start_deg: tuple[float, float]
) -> None:
    inner = make_trajectory(spec, CELL)
    start_rad = np.radians(start_deg)
    blended = blend_from(inner, start_rad)
    first = blended.sample(0, 1, PERIOD_S)
    np.testing.assert_allclose(first.position_rad[0], start_rad, rtol=1e-15)
    assert not first.velocity_rad_s.any()
    assert not first.acceleration_rad_s2.any()
    for part in Reference.__dataclass_fields__:
        merged, wanted = (getattr(t.sample(800, 100, PERIOD_S), part) for t in (blended, inner))
        np.testing.assert_allclose(merged, wanted, atol=1e-12)


def test_blend_has_no_step_in_acceleration() -> None:
    """The sine has none either: in 0.25 ms it changes by less than jerk x 0.25 ms, with a jerk below 60 rad/s³."""
    reference = blend_from(make_trajectory("sine", CELL), HOME_RAD).sample(0, 10_000, 0.25e-3)
    assert np.abs(np.diff(reference.acceleration_rad_s2, axis=0)).max() < 60 * 0.25e-3


def test_start_too_far_away_is_refused_rather_than_too_fast() -> None:
    with pytest.raises(TrajectoryError, match=r"start from \[-129\.0, 0\.0\] deg: joint2 at sample .* \+-2\.5 rad/s"):
        blend_from(make_trajectory("sine", CELL), np.radians([-129.0, 0.0]))


def test_start_outside_the_limits_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"joint3 at sample 0 .* outside limits_deg = \[-130, 130\]"):
        blend_from(make_trajectory("sine", CELL), np.radians([20.0, 131.0]))


def test_start_pose_of_another_arm_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="one angle for each of 2 joints"):
        blend_from(make_trajectory("sine", CELL), [0.0])


def test_spline_by_choice_is_the_clamped_cubic_one(csv_file: Path) -> None:
    expected = CubicSpline(FILE_TIME_S, np.radians(FILE_DEG), bc_type="clamped")
    reference = make_trajectory(f"{csv_file}:spline", CELL).sample(0, 1200, PERIOD_S)
    t = np.arange(1200) * PERIOD_S
    np.testing.assert_allclose(reference.position_rad, expected(t), atol=1e-12)
    np.testing.assert_allclose(reference.velocity_rad_s, expected(t, 1), atol=1e-11)
    np.testing.assert_allclose(reference.acceleration_rad_s2, expected(t, 2), atol=1e-10)


def test_file_holds_its_last_pose(csv_file: Path) -> None:
    reference = make_trajectory(str(csv_file), CELL).sample(1200, 100, PERIOD_S)
    np.testing.assert_allclose(np.degrees(reference.position_rad), np.tile(FILE_DEG[-1], (100, 1)), atol=1e-9)
    assert not reference.velocity_rad_s.any()


def test_straight_part_of_a_file_counts_as_constant_speed(tmp_path: Path) -> None:
    path = tmp_path / "ramp.csv"
    rows = [f"{t / 10},{2 * t},0" for t in range(31)]
    path.write_text("\n".join(["time_s,joint2,joint3", *rows]))
    steady = make_trajectory(f"{path}:spline", CELL).constant_speed(0, 1200, PERIOD_S)
    assert steady[500:700, 0].all()
    assert not steady[:20, 0].any()
    assert not steady[:, 1].any()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "row 1 has the columns none; must be time_s, joint2, joint3"),
        ("time_s,joint2\n0,1\n1,2", "must be time_s, joint2, joint3"),
        ("time_s,joint2,joint3,joint4\n0,1,2,3\n1,2,3,4", "must be time_s, joint2, joint3"),
        ("time_s,joint2,joint3\n0,1,2", "1 rows of values; a trajectory needs at least 2"),
        ("time_s,joint2,joint3\n0,1,2\n1,2", "row 3 has 2 values; the header has 3 columns"),
        ("time_s,joint2,joint3\n0,1,2\n1,2,x", "row 3, column joint3: 'x' is not a finite number"),
        ("time_s,joint2,joint3\n0,1,2\n1,inf,2", "row 3, column joint2: 'inf' is not a finite number"),
        ("time_s,joint2,joint3\n1,1,2\n2,2,2", "row 2: time_s = 1; the first must be 0"),
        ("time_s,joint2,joint3\n0,1,2\n1,1,2\n\n1,2,2", "row 5: time_s = 1; must be later than the row before it, 1"),
        (
            f"time_s,joint2,joint3\n0,1,2\n1,{'x' * 999},2",
            f"row 3, column joint2: '{'x' * 99}…{'x' * 99}' is not a finite number",
        ),
        ("time_s,joint2,joint3\n0,1,2\n1,1e300,2", r"row 3, column joint2: 1e\+300 deg; must be within \+-1e\+06 deg"),
        ("time_s,joint2,joint3\n0,1,2\n1e-300,1,2\n1,1,2", "row 3: time_s = 1e-300; .* by at least 1e-06 s"),
        ("time_s,joint2,joint3\n0,1,2\n1e9,1,2", r"row 3: time_s = 1e\+09; .* may last 86400 s \(24 h\) at most"),
        ("time_s,joint2,joint3\n0,0,0\n30,0,0\n60,140,0", r"joint2 at sample 2\d{4} \(5\d\..* outside limits_deg"),
        ("time_s,joint2,joint3\n0,0,0\n9,140,0", r"joint2 at sample \d+ .* outside limits_deg = \[-130, 130\]"),
        ("time_s,joint2,joint3\n0,0,0\n0.2,0,60", r"joint3 at sample \d+ .* within \+-2\.5 rad/s"),
    ],
)
def test_a_wrong_file_is_refused_with_the_place(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wrong.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        make_trajectory(str(path), CELL)
    assert str(path) in str(caught.value)


def test_an_unreadable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match="cannot be read as a CSV file"):
        make_trajectory(str(tmp_path), CELL)


def test_a_misspelt_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(TrajectoryError, match=r"built in: sine, trapezoid, excite; did you mean 'trapezoid'\?"):
        make_trajectory("trapezoidal", CELL)


def test_a_long_trajectory_is_checked_a_part_at_a_time(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path, counts = tmp_path / "long.csv", []
    path.write_text("time_s,joint2,joint3\n0,0,0\n60,10,10\n")
    sample = FileTrajectory.sample

    def counting(self: FileTrajectory, first_tick: int, count: int, period_s: float) -> Reference:
        counts.append((first_tick, count))
        return sample(self, first_tick, count, period_s)

    monkeypatch.setattr(FileTrajectory, "sample", counting)
    make_trajectory(str(path), CELL)
    assert max(count for _, count in counts) == 4096
    assert [tick for first, count in counts for tick in range(first, first + count)] == list(range(24_001))


def test_a_motion_that_takes_more_current_than_the_amplifier_has_is_refused(tmp_path) -> None:
    """3.2° at 5.5 Hz is within position and speed. Its inertia torque alone, 0.1102 kg·m² (D22 of the
    stretched arm, and the rotor) times 3.2° in rad times (2π·5.5)², is 7.35 N·m: 1.8 A of 1.5 A at 4.08 N·m/A.
    """
    times = np.arange(0.0, 6.0, 0.01)
    swing = np.minimum(1.0, np.minimum(times / 2.0, (6.0 - times) / 2.0))
    degrees = 20.0 + 3.2 * np.sin(2.0 * np.pi * 5.5 * times) * swing
    path = tmp_path / "fast.csv"
    rows = "".join(f"{time:.2f},{angle:.6f},0\n" for time, angle in zip(times, degrees, strict=True))
    path.write_text("time_s,joint2,joint3\n" + rows)
    with pytest.raises(TrajectoryError, match=r"joint2 at sample \d+ \(.* s\): 1\.\d\d A by the nominal model"):
        make_trajectory(str(path), load_cell("konkuk1"))
