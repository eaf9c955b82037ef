"""Of a drive and its current sense: who is rather it, where the arm has not told for sure."""

import math
import random

import numpy as np
import pytest

from canarm import Rig
from canarm_controller.supervision.currents import WORTH_MENTION
from canarm_controller.supervision.vote import LARGEST_SHARE, READING, Ballot

GRAIN = 0.02
"""Speed grain in rad/s; noise of a reading is `READING` of it."""
CYCLE_S, WINDOW = 0.0025, 40
PEAK = 0.06
"""Speed due after a peak of the current, rad/s."""
DOUBT = 1.0
"""Acceleration that the model may be off by, rad/s²."""
READINGS = 9


def speeds(share: float, seed: int, acceleration: float = 0.0) -> list[float]:
    """Readings less the first one's expectation, if the arm does `share` of what is due."""
    source = random.Random(seed)
    steps = range(READINGS)
    return [share * PEAK * (k > 0) + acceleration * k * CYCLE_S + source.gauss(0.0, READING * GRAIN) for k in steps]


def lean_of(unexplained: list[float], doubt: float = DOUBT, noisiness: float = 1.0) -> float:
    ballot = Ballot(GRAIN, WINDOW)
    for k, speed in enumerate(unexplained):
        ballot.cast(PEAK * (k > 0), speed, k * CYCLE_S)
    return ballot.lean(doubt, noisiness)


def log_density(residual: np.ndarray, covariance: np.ndarray) -> float:
    """Of a normal distribution whose mean nobody knows: of the residuals less their mean, by a basis of those."""
    count = len(residual)
    basis = np.linalg.svd(np.eye(count) - 1.0 / count)[0][:, : count - 1]
    covariance, residual = basis.T @ covariance @ basis, basis.T @ residual
    _, log_determinant = np.linalg.slogdet(covariance)
    return float(-0.5 * (log_determinant + residual @ np.linalg.solve(covariance, residual)))


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_the_lean_is_the_likelihood_ratio_of_normal_distributions(share: float, seed: int) -> None:
    """By densities of all readings at once, with the doubtful acceleration in their covariance."""
    unexplained = np.array(speeds(share, seed))
    due, time = np.full(READINGS, PEAK), CYCLE_S * np.arange(READINGS)
    due[0] = 0.0
    sense = (READING * GRAIN) ** 2 * np.eye(READINGS) + DOUBT**2 / 3.0 * np.outer(time, time)
    without = log_density(unexplained, sense)
    shares = np.linspace(0.0, LARGEST_SHARE, 4001)
    ratios = [log_density(unexplained - each * due, sense) - without for each in shares]
    acts = math.log(np.mean(np.exp(ratios)))
    lean = lean_of(list(unexplained))
    assert lean >= acts - math.log(2.0) - 0.01, "to swing is as likely beforehand as to do a share"
    if share == 1.0:
        assert lean == pytest.approx(acts - math.log(2.0), abs=0.05)


def test_an_arm_that_swings_was_driven() -> None:
    assert lean_of([(-1) ** (k // 2) * PEAK for k in range(READINGS)]) > math.log(20.0)


def test_an_arm_that_does_nothing_is_seldom_taken_for_driven() -> None:
    """A likelihood ratio has the mean 1 where its lower hypothesis holds: it is 20 or more once in 20 times at most."""
    leans = np.array([lean_of(speeds(0.0, seed)) for seed in range(400)])
    assert np.mean(leans >= math.log(20.0)) <= 1.0 / 20.0
    assert np.median(leans) < -WORTH_MENTION


def test_a_speed_that_nobody_measures_tells_nothing() -> None:
    assert lean_of(speeds(1.0, 0), noisiness=math.inf) == pytest.approx(0.0)
    assert Ballot(GRAIN, WINDOW).lean(DOUBT, 1.0) == 0.0


@pytest.mark.parametrize(
    ("tap", "fault", "truth", "name"),
    [
        ("joint3.opamp", "delayed", {"joint3.mass": 0.9}, "current-mismatch"),
        ("joint2.opamp", "spike", {"joint2.wire": 1, "joint3.wire": 1}, "current-mismatch"),
        ("joint2.current_sense", "noise", {"joint3.mass": 0.95}, "current-sense-mismatch"),
    ],
)
def test_the_first_name_is_that_of_the_part(tap: str, fault: str, truth: dict[str, object], name: str) -> None:
    with Rig(law="computed-torque", seed=3, truth=truth) as rig:
        rig.inject(tap, fault, at=2.8)
        rig.run(3.3)
        assert [(each.detector, each.where) for each in rig.controller.detections][:1] == [(name, tap[:6])]
