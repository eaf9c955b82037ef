"""A Kalman filter for each joint, with a prediction by one cycle, to the time at which a command acts.

Owns the estimate of position and speed. The law provides the model's acceleration, since it knows its parameters;
feedback must not enter.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import ObserverGains

from ..cycle import Cycle

Matrix: TypeAlias = NDArray[np.float64]
Acceleration = Callable[[Sequence[float], Sequence[float], Sequence[float]], Sequence[float]]
"""From positions (rad), speeds (rad/s) and applied torques (N·m) to accelerations (rad/s²)."""

DOUBLINGS = 40
"""Each step of `stationary_gain` doubles the number of samples filtered: 2^40 samples of 2.5 ms are 87 years."""


class JointObserver:
    """Position x, speed v, error b of the model's acceleration and offset o of the tachometer of one joint.

    Predict   x' = x + T·v + T²/2·(a + b),  v' = v + T·(a + b),  b' = b,  o' = o
    Correct   (x, v, b, o) += L·(potentiometer - x, tachometer - v - o)

    L is the stationary Kalman gain. An offset differs from a speed in that the potentiometer does not follow it.
    """

    __slots__ = ("_gains", "_period_s", "acceleration_bias", "position_rad", "tachometer_offset", "velocity_rad_s")

    def __init__(self, gains: Sequence[tuple[float, float]], period_s: float) -> None:
        self._gains = tuple(gains)
        self._period_s = period_s
        self.start(0.0, 0.0)

    def start(self, position_rad: float, velocity_rad_s: float) -> None:
        """Begin at a measured state, assuming a right model and a right tachometer."""
        self.position_rad, self.velocity_rad_s = position_rad, velocity_rad_s
        self.acceleration_bias = self.tachometer_offset = 0.0

    def correct(self, measured_rad: float, measured_rad_s: float) -> None:
        """Take one cycle's measurement."""
        by_position = measured_rad - self.position_rad
        by_velocity = measured_rad_s - self.velocity_rad_s - self.tachometer_offset
        (x0, x1), (v0, v1), (b0, b1), (o0, o1) = self._gains
        self.position_rad += x0 * by_position + x1 * by_velocity
        self.velocity_rad_s += v0 * by_position + v1 * by_velocity
        self.acceleration_bias += b0 * by_position + b1 * by_velocity
        self.tachometer_offset += o0 * by_position + o1 * by_velocity

    def predict(self, acceleration_rad_s2: float) -> None:
        """Predict the next cycle with the model's acceleration during this one."""
        step_rad_s = self._period_s * (acceleration_rad_s2 + self.acceleration_bias)
        self.position_rad += self._period_s * (self.velocity_rad_s + 0.5 * step_rad_s)
        self.velocity_rad_s += step_rad_s


class ArmState:
    """State and reference at the time for which a law computes, one entry per joint.

    A command computed in cycle k acts from SYNC k+1 on; until then the last one acts, `cycle.applied_nm`. With the
    observer, the law sees the filtered and predicted state, and the reference, at SYNC k+1, which removes the cycle of
    delay from the loop. Without it (`gains` None or `enabled` false), it sees the measurements and reference of cycle
    k.
    """

    __slots__ = (
        "_is_first", "_joints", "_lead_s", "position_rad", "reference_rad", "reference_rad_s", "velocity_rad_s",
    )  # fmt: skip

    def __init__(self, gains: ObserverGains | None, period_s: float, joint_count: int) -> None:
        self._joints: list[JointObserver] = []
        if gains is not None and gains.enabled:
            stationary = stationary_gains(gains, period_s)
            self._joints = [JointObserver(stationary, period_s) for _ in range(joint_count)]
        self._lead_s = period_s if self._joints else 0.0
        self._is_first = True
        zeros = [0.0] * joint_count
        self.position_rad: Sequence[float] = zeros
        self.velocity_rad_s: Sequence[float] = zeros
        self.reference_rad: Sequence[float] = zeros
        self.reference_rad_s: Sequence[float] = zeros

    def start(self, position_rad: Sequence[float], velocity_rad_s: Sequence[float]) -> None:
        """Begin again at the measured state."""
        for joint, position, velocity in zip(self._joints, position_rad, velocity_rad_s, strict=bool(self._joints)):
            joint.start(position, velocity)
        self._is_first = True

    def shift(self, shift_rad: Sequence[float]) -> None:
        """All angles, those of the past too, are so much greater than was believed."""
        for joint, shift in zip(self._joints, shift_rad, strict=bool(self._joints)):
            joint.position_rad += shift

    def update(self, cycle: Cycle, acceleration: Acceleration) -> None:
        """Take one cycle. In the first, no command acts yet: the arm is parked."""
        joints, lead_s = self._joints, self._lead_s
        if not joints:
            self.position_rad, self.velocity_rad_s = cycle.position_rad, cycle.velocity_rad_s
            self.reference_rad, self.reference_rad_s = cycle.reference_rad, cycle.reference_rad_s
            return
        for joint, measured_rad, measured_rad_s in zip(joints, cycle.position_rad, cycle.velocity_rad_s, strict=True):
            joint.correct(measured_rad, measured_rad_s)
        if not self._is_first:
            now = [joint.position_rad for joint in joints], [joint.velocity_rad_s for joint in joints]
            for joint, model_rad_s2 in zip(joints, acceleration(*now, cycle.applied_nm), strict=True):
                joint.predict(model_rad_s2)
        self._is_first = False
        self.position_rad = [joint.position_rad for joint in joints]
        self.velocity_rad_s = [joint.velocity_rad_s for joint in joints]
        rates, changes = cycle.reference_rad_s, cycle.reference_rad_s2
        self.reference_rad = [
            angle + lead_s * (rate + 0.5 * lead_s * change)
            for angle, rate, change in zip(cycle.reference_rad, rates, changes, strict=True)
        ]
        self.reference_rad_s = [rate + lead_s * change for rate, change in zip(rates, changes, strict=True)]


def stationary_gains(gains: ObserverGains, period_s: float) -> tuple[tuple[float, float], ...]:
    """L of `JointObserver`, four rows (x, v, b, o) of two (by potentiometer, by tachometer)."""
    step_s = period_s
    transition = np.eye(4)
    transition[0, 1:3] = step_s, 0.5 * step_s**2
    transition[1, 2] = step_s
    by_acceleration = np.array([0.5 * step_s**2, step_s, 0.0, 0.0])
    drift = np.diag([0.0, 0.0, gains.acceleration_bias_noise**2, gains.tachometer_offset_noise**2])
    process = gains.acceleration_noise**2 / step_s * np.outer(by_acceleration, by_acceleration) + step_s * drift
    output = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 1.0]])
    noise = np.diag([gains.position_noise_rad**2, gains.velocity_noise_rad_s**2])

    gain = stationary_gain(transition, process, output, noise)
    return tuple((by_position, by_velocity) for by_position, by_velocity in gain.tolist())


def stationary_gain(transition: Matrix, process: Matrix, output: Matrix, noise: Matrix) -> Matrix:
    """The stationary Kalman gain (states, outputs) of a discrete system, to be applied to a prediction's error.

    The covariance solves the discrete algebraic Riccati equation, here by the structure-preserving doubling algorithm
    (Chu, Fan, Lin and Wang, Int. J. Control 77 (2004) 767-788), which needs nothing but inverses.
    """
    unit = np.eye(len(transition))
    a, g, covariance = transition.T, output.T @ _inverse(noise) @ output, process
    for _ in range(DOUBLINGS):
        inverse = _inverse(unit + g @ covariance)
        doubled: Matrix = covariance + a.T @ covariance @ inverse @ a
        a, g, covariance = a @ inverse @ a, g + a @ inverse @ g @ a.T, doubled
    gain: Matrix = covariance @ output.T @ _inverse(output @ covariance @ output.T + noise)
    return gain


def _inverse(matrix: Matrix) -> Matrix:
    return np.linalg.inv(matrix).astype(np.float64)
