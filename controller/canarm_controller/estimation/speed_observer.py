"""Speeds of joints that have no tachometer, from their position sensors and the arm's model.

Owns the estimate that stands in for a measured speed. What has failed and is replaced for that reason belongs to
supervision; feedback must not enter.
"""

import math
from collections.abc import Sequence

import numpy as np

from canarm_protocol.cell.model import ObserverGains

from ..dynamics import Arm, ClosedChain, HeldMotion, SeveralArms
from .observer import stationary_gain

ACCELERATION_NOISE, ACCELERATION_BIAS_NOISE = 0.03, 3.0
"""rad/s²/√Hz and rad/s³/√Hz, for cells without `[control.observer]`; the values of konkuk1."""

REFRESH = 8
"""Cycles for which the grips' share of the accelerations is kept: the pose hardly changes."""


class SpeedObserver:
    """A Kalman filter for each joint without a tachometer: position x, speed v, error b of the model's acceleration.

    Predict   x' = x + T·v + T²/2·(a + b),  v' = v + T·(a + b),  b' = b,  a by the nominal arm under the last command
    Correct   (x, v, b) += L·(measured - x), L the stationary Kalman gain

    b finds a wrong payload or friction, as fast as the sensor's step allows.
    """

    def __init__(
        self,
        arm: Arm,
        joints: Sequence[int],
        noise_rad: Sequence[float],
        gains: ObserverGains | None,
        period_s: float,
        chain: ClosedChain | None = None,
        fastest_rad_s: Sequence[float] = (),
    ) -> None:
        """`joints` are those without a tachometer, `noise_rad` the deviation of a position sample of each joint.

        `chain` is that of the object that the arms carry. Speeds beyond `fastest_rad_s` of a joint, which a sensor that
        lies makes believe, are not given to the model: their centrifugal forces would make more of them.
        """
        self._fastest_rad_s = fastest_rad_s or (math.inf,) * arm.joint_count
        self._held = None if chain is None else HeldMotion(chain)
        parts = arm.parts if isinstance(arm, SeveralArms) else (arm,)
        self._parts = [(part, np.diag(part.rotor_inertia)) for part in parts]
        self._refresh_in = 0
        self._arm, self._period_s, self._joints = arm, period_s, tuple(joints)
        self._gains = [(joint, *_gains(noise_rad[joint], gains, period_s)) for joint in joints]
        self._count = arm.joint_count
        self.start((0.0,) * arm.joint_count)

    def start(self, position_rad: Sequence[float]) -> None:
        """Begin at rest, with a right model. In the first cycle no command acts yet: the arm rests."""
        self._x, self._v, self._b = list(position_rad), [0.0] * self._count, [0.0] * self._count
        self._is_first = True

    def shift(self, shift_rad: Sequence[float]) -> None:
        """All angles, those of the past too, are so much greater than was believed."""
        self._x = [position + shift for position, shift in zip(self._x, shift_rad, strict=True)]

    def predicted(self, measured_rad_s: Sequence[float]) -> tuple[float, ...]:
        """`measured_rad_s` with the expected speeds of joints without a tachometer."""
        found = list(measured_rad_s)
        for joint in self._joints:
            found[joint] = self._v[joint]
        return tuple(found)

    def update(
        self, position_rad: Sequence[float], velocity_rad_s: Sequence[float], torque_nm: Sequence[float]
    ) -> tuple[float, ...]:
        """The speeds of this cycle from its positions; then a step on under `torque_nm`, which acts from this SYNC on.

        `velocity_rad_s` is what `predicted` gave.
        """
        x, v, b = self._x, self._v, self._b
        found = list(velocity_rad_s)
        for joint, by_position, by_speed, by_bias in self._gains:
            off = position_rad[joint] - x[joint]
            x[joint] += by_position * off
            b[joint] += by_bias * off
            found[joint] = v[joint] = v[joint] + by_speed * off
        if not self._is_first:
            possible = self._possible(found)
            model_rad_s2 = self._arm.acceleration_rad_s2(position_rad, possible, torque_nm)
            if self._held is not None:
                model_rad_s2 = self._carried(self._held, model_rad_s2, position_rad, possible)
            period_s = self._period_s
            for joint in self._joints:
                speed = v[joint]
                step_rad_s = period_s * (model_rad_s2[joint] + b[joint])
                x[joint] += period_s * (speed + 0.5 * step_rad_s)
                v[joint] = speed + step_rad_s
        self._is_first = False
        return tuple(found)

    def _possible(self, speed_rad_s: list[float]) -> list[float]:
        """Speeds that a joint can have, as nearly all are."""
        for speed, most in zip(speed_rad_s, self._fastest_rad_s, strict=True):
            if not -most <= speed <= most:
                return [
                    max(-most, min(each, most)) for each, most in zip(speed_rad_s, self._fastest_rad_s, strict=True)
                ]
        return speed_rad_s

    def _carried(
        self, held: HeldMotion, free_rad_s2: Sequence[float], position_rad: Sequence[float], speed_rad_s: list[float]
    ) -> Sequence[float]:
        """The accelerations that the grips allow."""
        if not self._refresh_in:
            self._refresh_in = REFRESH
            blocks, first = [], 0
            for part, rotors in self._parts:
                own = slice(first, first + part.joint_count)
                blocks.append(np.linalg.inv(np.array(part.inertia(position_rad[own])) + rotors))
                first = own.stop
            held.refresh(position_rad, speed_rad_s, blocks)
        self._refresh_in -= 1
        return held.accelerations(free_rad_s2)


def _gains(noise_rad: float, gains: ObserverGains | None, period_s: float) -> tuple[float, float, float]:
    """L of one joint."""
    noise = ACCELERATION_NOISE if gains is None else gains.acceleration_noise
    drift = ACCELERATION_BIAS_NOISE if gains is None else gains.acceleration_bias_noise
    transition = np.array([[1.0, period_s, 0.5 * period_s**2], [0.0, 1.0, period_s], [0.0, 0.0, 1.0]])
    by_acceleration = np.array([0.5 * period_s**2, period_s, 0.0])
    process = noise**2 / period_s * np.outer(by_acceleration, by_acceleration)
    process += period_s * np.diag([0.0, 0.0, drift**2])
    gain = stationary_gain(transition, process, np.array([[1.0, 0.0, 0.0]]), np.array([[noise_rad**2]]))
    by_position, by_speed, by_bias = gain[:, 0].tolist()
    return by_position, by_speed, by_bias
