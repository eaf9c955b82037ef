"""How well the laws follow over 10.24 s, in steps of the position sensor: true angle against reference, worst joint."""

import functools
import math

import numpy as np
import pytest

from canarm import Rig

TABLE_S = 10.24
TRAJECTORIES = ("sine", "trapezoid")
HEAVY = {"joint3.mass": 0.9}


def worst(rig: Rig) -> float:
    return max(joint.rms_error_lsb for joint in rig.joints.values())


@functools.cache
def followed(trajectory: str, seed: int = 0) -> Rig:
    """A run of the nominal robot, which has ended."""
    with Rig("konkuk1", law="mras", trajectory=trajectory, seed=seed) as rig:
        rig.run(TABLE_S)
    return rig


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
@pytest.mark.parametrize("trajectory", TRAJECTORIES)
@pytest.mark.parametrize(("truth", "limit_lsb"), [({}, 0.35), (HEAVY, 0.45)], ids=["nominal", "payload +50 %"])
def test_mras_with_the_table_follows(trajectory: str, truth: dict[str, float], limit_lsb: float, seed: int) -> None:
    if truth:
        with Rig("konkuk1", law="mras", trajectory=trajectory, truth=truth, seed=seed) as rig:
            rig.run(TABLE_S)
    else:
        rig = followed(trajectory, seed)
    assert rig.controller.loop.feedforward_kind == "table"
    assert 0.0 < worst(rig) <= limit_lsb
    assert (rig.summary().state, rig.summary().ticks, rig.summary().missed) == ("done", 4096, 0)


@pytest.mark.parametrize(
    ("trajectory", "truth", "yardstick_lsb"),
    [("sine", {}, 7.6), ("trapezoid", {}, 7.2), ("sine", HEAVY, 10.0), ("trapezoid", HEAVY, 9.5)],
)
def test_pd_errs_as_an_independent_prototype_of_the_same_arm_did(
    trajectory: str, truth: dict[str, float], yardstick_lsb: float
) -> None:
    with Rig("konkuk1", law="pd", trajectory=trajectory, truth=truth) as rig:
        rig.run(TABLE_S)
        assert worst(rig) == pytest.approx(yardstick_lsb, rel=0.05)


def test_the_error_is_that_of_the_histories() -> None:
    for joint in followed("sine").joints.values():
        error = (joint.true_angle_rad - joint.reference_rad)[1024:] / math.radians(270 / 255)
        assert joint.rms_error_lsb == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-9)
        assert joint.max_error_lsb == pytest.approx(np.abs(error).max(), rel=1e-9)
        assert joint.peak_current_a == pytest.approx(np.abs(joint.current_a).max(), rel=1e-9)


def test_speed_ripple_is_reported_where_the_speed_is_to_be_constant() -> None:
    """The paper judges its controller by ripple: standard deviation of speed over its mean on constant stretches."""
    for joint in followed("trapezoid").joints.values():
        reference, speed = joint.reference_rad, joint.true_speed_rad_s
        steady = np.flatnonzero(np.abs(np.diff(reference, 2)) < 1e-9) + 2
        steady = steady[steady >= 1024]
        stretches = np.split(speed[steady], np.flatnonzero(np.diff(steady) > 1) + 1)
        assert len(stretches) >= 3
        squares = sum(np.sum((stretch - stretch.mean()) ** 2) for stretch in stretches)
        count, distance = len(steady), sum(abs(stretch.sum()) for stretch in stretches)
        assert joint.speed_ripple == pytest.approx(math.sqrt(squares * count) / distance, rel=0.05)
        assert joint.speed_ripple < 0.05


def test_the_sine_has_no_ripple() -> None:
    assert all(figures.speed_ripple is None for figures in followed("sine").summary().joints.values())


@pytest.mark.parametrize("trajectory", TRAJECTORIES)
@pytest.mark.parametrize(
    ("truth", "limit_lsb"),
    [
        ({"joint2.wire": True, "joint3.wire": True}, 0.35),
        ({"joint2.coulomb": 0.3, "joint3.coulomb": 0.12, "joint2.viscous": 0.1, "joint3.viscous": 0.04}, 0.5),
        ({"joint2.coulomb": 0, "joint3.coulomb": 0, "joint2.viscous": 0, "joint3.viscous": 0}, 1.0),
    ],
    ids=["elastic wires", "friction doubled", "no friction at all"],
)
def test_mras_holds_on_another_arm_than_the_nominal_one(
    trajectory: str, truth: dict[str, float], limit_lsb: float
) -> None:
    """Without friction the feed-forward's Coulomb term is all wrong: still within a step of the sensor."""
    with Rig("konkuk1", law="mras", trajectory=trajectory, truth=truth) as rig:
        rig.run(TABLE_S)
        assert worst(rig) <= limit_lsb
        assert rig.summary().joints["joint2"].saturated_cycles == 0


@pytest.mark.slow
@pytest.mark.parametrize("trajectory", TRAJECTORIES)
@pytest.mark.parametrize("pose_deg", [(-90, 0), (-90, 90), (-120, -120)])
def test_an_arm_that_starts_elsewhere_is_led_in_without_violence(trajectory: str, pose_deg: tuple[int, int]) -> None:
    truth = {"joint2.initial_deg": pose_deg[0], "joint3.initial_deg": pose_deg[1]}
    with Rig("konkuk1", law="mras", trajectory=trajectory, truth=truth) as rig:
        rig.run(TABLE_S)
        for joint in rig.joints.values():
            assert np.abs(joint.true_speed_rad_s).max() < 2.5  # what the tachometer can see
            assert np.degrees(np.abs(joint.true_angle_rad - joint.reference_rad)).max() < 1.06  # one step of the sensor
            assert joint.peak_current_a < 1.0
        assert worst(rig) <= 0.35


def test_the_arm_stays_at_rest_until_it_is_led_away() -> None:
    with Rig("konkuk1", law="mras", truth={"joint2.initial_deg": -90}) as rig:
        rig.run(0.05)
        assert np.abs(rig.joints["joint2"].true_speed_rad_s).max() < 0.05
        assert math.degrees(rig.joints["joint2"].true_angle_rad[0]) == pytest.approx(-90.0)
