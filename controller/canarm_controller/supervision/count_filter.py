"""Where a joint is between two counts of its encoder: a Kalman filter to which only the counts are measurements.

Owns that estimate. Whether a count is late, and what follows from it, is elsewhere.
"""

import numpy as np

ACCELERATION_NOISE, LOAD_NOISE, FRICTION_NOISE = 0.01, 0.03, 0.02
"""rad/s²/√Hz of what nobody models, and rad/s³/√Hz of a load and of a friction that differ from the model's: they are
another robot's, not another moment's, so that they are learned over many counts."""
LOAD_RAD_S2, FRICTION_SHARE = 0.5, 0.3
"""Deviations of both before anything is known, the second as a share of Coulomb friction: `canarm.draws` has more."""
SLOWEST_RAD_S = 0.003
"""A count is not taken for more precise than at this speed."""
STOOD_RAD_S = 0.03
"""Deviation of a speed of which nothing is known but a count that has come."""
EDGE_SHARE, SKIPPED_SHARE = 0.02, 0.5
"""Deviations of where an edge is, in counts, and of one that came together with another."""


class CountFilter:
    """x' = x + T·v + T²/2·ẍ,  v' = v + T·ẍ,  ẍ = a + b + s·f, with a the model's, s the way that the joint turns.

    b is what the model lacks whichever way it turns, such as a payload, and f what it lacks of friction. A count says
    that an edge was passed within the last cycle. Angles are in rad.
    """

    __slots__ = ("_covariance", "_lacking", "_period_s", "_step_rad", "friction", "load", "position_rad", "speed_rad_s")

    def __init__(self, step_rad: float, period_s: float, friction_rad_s2: float) -> None:
        """`friction_rad_s2` is what Coulomb friction makes of the joint."""
        self._step_rad, self._period_s = step_rad, period_s
        self.position_rad = self.speed_rad_s = self.load = self.friction = self._lacking = 0.0
        friction = FRICTION_SHARE * friction_rad_s2
        self._covariance = np.diag([0.0, 0.0, LOAD_RAD_S2**2, friction**2])

    def begin(self, edge_rad: float) -> None:
        """A count has come of a joint of whose motion nothing else is known."""
        self.position_rad, self.speed_rad_s = edge_rad, 0.0
        learned = self._covariance[2:, 2:].copy()
        self._covariance = np.diag([(0.5 * self._step_rad) ** 2, STOOD_RAD_S**2, 0.0, 0.0])
        self._covariance[2:, 2:] = learned

    def step(self, acceleration: float) -> None:
        """A cycle on, by the model's acceleration."""
        more = acceleration + self._lacking
        self.position_rad += self._period_s * (self.speed_rad_s + 0.5 * self._period_s * more)
        self.speed_rad_s += self._period_s * more

    def count(self, edge_rad: float, way: float, cycles: int, is_one: bool) -> None:
        """An edge was passed in the last of `cycles` since the last count; `is_one`: no other in the same cycle."""
        self._spread(cycles * self._period_s, way)
        gone_rad = max(abs(self.speed_rad_s), SLOWEST_RAD_S) * self._period_s
        noise = gone_rad**2 / 12.0 + ((EDGE_SHARE if is_one else SKIPPED_SHARE) * self._step_rad) ** 2
        across = self._covariance[:, 0]
        gains = across / (across[0] + noise)
        off = edge_rad + 0.5 * way * gone_rad - self.position_rad
        self._covariance = self._covariance - np.outer(gains, across)
        by_position, by_speed, by_load, by_friction = gains.tolist()
        self.position_rad += by_position * off
        self.speed_rad_s += by_speed * off
        self.load += by_load * off
        self.friction += by_friction * off
        self._lacking = self.load + way * self.friction

    def deviation_rad(self, cycles: int, way: float) -> float:
        """Of the position, so many cycles after the last count."""
        time_s = cycles * self._period_s
        half = 0.5 * time_s * time_s
        across = np.array([1.0, time_s, half, way * half])
        return float(np.sqrt(across @ self._covariance @ across + ACCELERATION_NOISE**2 * time_s**3 / 3.0))

    def _spread(self, time_s: float, way: float) -> None:
        """The covariance so much later."""
        half = 0.5 * time_s * time_s
        transition = np.array(
            [
                [1.0, time_s, half, way * half],
                [0.0, 1.0, time_s, way * time_s],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        self._covariance = transition @ self._covariance @ transition.T
        noise = ACCELERATION_NOISE**2
        self._covariance[0, 0] += noise * time_s**3 / 3.0
        self._covariance[0, 1] += noise * half
        self._covariance[1, 0] += noise * half
        self._covariance[1, 1] += noise * time_s
        self._covariance[2, 2] += LOAD_NOISE**2 * time_s
        self._covariance[3, 3] += FRICTION_NOISE**2 * time_s
