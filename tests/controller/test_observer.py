"""The Kalman filter of a joint, and the state one cycle ahead that laws compute with."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from canarm_controller.estimation.observer import ArmState, JointObserver, stationary_gains
from canarm_controller.laws import Cycle
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import ObserverGains

PERIOD_S = 0.0025
POSITION_LSB_RAD, SPEED_LSB_RAD_S = math.radians(270.0 / 255), 5.0 / 255
GAINS = load_cell("konkuk1").control.observer
assert GAINS is not None


def test_stationary_gains_solve_the_riccati_equation() -> None:
    """SciPy solves it by the eigenvectors of a symplectic pencil; we by doubling."""
    h = PERIOD_S
    transition = np.array([[1, h, h * h / 2, 0], [0, 1, h, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    by_acceleration = np.array([[h * h / 2], [h], [0], [0]])
    process = by_acceleration @ by_acceleration.T * GAINS.acceleration_noise**2 / h
    process += np.diag([0, 0, GAINS.acceleration_bias_noise**2 * h, GAINS.tachometer_offset_noise**2 * h])
    output = np.array([[1.0, 0, 0, 0], [0, 1, 0, 1]])
    noise = np.diag([GAINS.position_noise_rad**2, GAINS.velocity_noise_rad_s**2])
    covariance = solve_discrete_are(transition.T, output.T, process, noise)
    expected = covariance @ output.T @ np.linalg.inv(output @ covariance @ output.T + noise)
    np.testing.assert_allclose(stationary_gains(GAINS, PERIOD_S), expected, rtol=1e-6, atol=1e-9)


def test_without_drift_the_model_and_the_tachometer_are_believed_for_ever() -> None:
    gains = GAINS.model_copy(update={"acceleration_bias_noise": 0.0, "tachometer_offset_noise": 0.0})
    assert np.abs(stationary_gains(gains, PERIOD_S)[2:]).max() < 1e-9


def quantised(value: float, lsb: float, deviate: float) -> float:
    """An 8-bit reading with 0.3 LSB of noise; the middle of the range lies between two codes."""
    return (round(value / lsb + 127.5 + 0.3 * deviate) - 127.5) * lsb


def followed(tachometer_offset_rad_s: float = 0.0, model_error_rad_s2: float = 0.0) -> tuple[np.ndarray, JointObserver]:
    """Estimation errors (rad, rad/s) of the last 3072 of 4096 cycles along a sine, and the observer at the end."""
    observer = JointObserver(stationary_gains(GAINS, PERIOD_S), PERIOD_S)
    amplitude, omega = math.radians(35.0), 2 * math.pi / 2.56
    observer.start(0.0, amplitude * omega)
    deviates = np.random.default_rng(1).standard_normal((4096, 2)).tolist()
    errors = []
    for tick, (first, second) in enumerate(deviates):
        phase = omega * tick * PERIOD_S
        position, speed = amplitude * math.sin(phase), amplitude * omega * math.cos(phase)
        observer.correct(
            quantised(position, POSITION_LSB_RAD, first),
            quantised(speed + tachometer_offset_rad_s, SPEED_LSB_RAD_S, second),
        )
        errors.append((observer.position_rad - position, observer.velocity_rad_s - speed))
        middle = phase + 0.5 * omega * PERIOD_S
        observer.predict(-amplitude * omega**2 * math.sin(middle) + model_error_rad_s2)
    return np.array(errors[1024:]), observer


def test_position_is_known_better_than_the_converter_resolves_it() -> None:
    """Rounding alone costs an 8-bit reading 1/sqrt(12) = 0.29 LSB."""
    errors, _ = followed()
    rms = np.sqrt((errors**2).mean(axis=0))
    assert rms[0] < 0.1 * POSITION_LSB_RAD
    assert rms[1] < 0.29 * SPEED_LSB_RAD_S


def test_an_offset_of_the_tachometer_is_found() -> None:
    errors, observer = followed(tachometer_offset_rad_s=0.04)
    assert observer.tachometer_offset == pytest.approx(0.04, abs=0.003)
    assert np.sqrt((errors[:, 0] ** 2).mean()) < 0.1 * POSITION_LSB_RAD


def test_an_error_of_the_model_is_found() -> None:
    errors, observer = followed(model_error_rad_s2=-5.0)
    assert observer.acceleration_bias == pytest.approx(5.0, abs=0.5)
    assert np.sqrt((errors[:, 0] ** 2).mean()) < 0.1 * POSITION_LSB_RAD


def at(position_rad: float, velocity_rad_s: float, reference: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Cycle:
    cycle = Cycle(1)
    cycle.position_rad, cycle.velocity_rad_s = [position_rad], [velocity_rad_s]
    cycle.reference_rad, cycle.reference_rad_s, cycle.reference_rad_s2 = ([value] for value in reference)
    return cycle


def test_a_law_sees_state_and_reference_of_the_next_cycle() -> None:
    state = ArmState(GAINS, PERIOD_S, 1)
    state.start([0.0], [0.0])
    state.update(at(0.0, 0.0), lambda q, qd, torque: [1e9])
    assert (state.position_rad, state.velocity_rad_s) == ([0.0], [0.0])  # parked: no command acts in the first cycle
    acceleration = 4.0
    for tick in range(1, 200):
        t = tick * PERIOD_S
        cycle = at(0.5 * acceleration * (t - PERIOD_S) ** 2, acceleration * (t - PERIOD_S), (1.0, 2.0, 8.0))
        cycle.applied_nm = [acceleration]
        state.update(cycle, lambda q, qd, torque: torque)
        assert state.position_rad[0] == pytest.approx(0.5 * acceleration * t**2, abs=1e-12)
        assert state.velocity_rad_s[0] == pytest.approx(acceleration * t, abs=1e-12)
    assert state.reference_rad[0] == pytest.approx(1.0 + 2.0 * PERIOD_S + 4.0 * PERIOD_S**2)
    assert state.reference_rad_s[0] == pytest.approx(2.0 + 8.0 * PERIOD_S)


@pytest.mark.parametrize("gains", [None, GAINS.model_copy(update={"enabled": False})], ids=["absent", "disabled"])
def test_without_an_observer_a_law_sees_what_was_measured(gains: ObserverGains | None) -> None:
    state = ArmState(gains, PERIOD_S, 1)
    state.start([0.0], [0.0])
    state.update(at(0.3, -0.2, (1.0, 2.0, 8.0)), lambda q, qd, torque: [1e9])
    assert (state.position_rad, state.velocity_rad_s) == ([0.3], [-0.2])
    assert (state.reference_rad, state.reference_rad_s) == ([1.0], [2.0])
