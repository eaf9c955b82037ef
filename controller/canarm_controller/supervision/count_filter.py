"""Where a joint is between two counts of its encoder: a Kalman filter to which only the counts are measurements.

Owns that estimate. Whether a count is late, and what follows from it, is elsewhere.
"""

import math

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
Covariance = tuple[float, float, float, float, float, float, float, float, float, float]
"""The upper triangle, row by row, of position x, speed v, load l and friction f: numpy takes five times as long."""


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
        self._covariance = _diagonal(0.0, 0.0, (LOAD_RAD_S2**2, 0.0, friction**2))

    def begin(self, edge_rad: float) -> None:
        """A count has come of a joint of whose motion nothing else is known."""
        self.position_rad, self.speed_rad_s = edge_rad, 0.0
        learned = self._covariance[7:]
        self._covariance = _diagonal((0.5 * self._step_rad) ** 2, STOOD_RAD_S**2, learned)

    def step(self, acceleration: float) -> None:
        """A cycle on, by the model's acceleration."""
        more, period_s, speed = acceleration + self._lacking, self._period_s, self.speed_rad_s
        self.position_rad += period_s * (speed + 0.5 * period_s * more)
        self.speed_rad_s = speed + period_s * more

    def count(self, edge_rad: float, way: float, cycles: int, is_one: bool) -> None:
        """An edge was passed in the last of `cycles` since the last count; `is_one`: no other in the same cycle."""
        time_s = cycles * self._period_s
        speed, step_rad = abs(self.speed_rad_s), self._step_rad
        gone_rad = (speed if speed > SLOWEST_RAD_S else SLOWEST_RAD_S) * self._period_s
        noise = gone_rad**2 / 12.0 + ((EDGE_SHARE if is_one else SKIPPED_SHARE) * step_rad) ** 2
        xx, xv, xl, xf, vv, vl, vf, ll, lf, ff = self._later(time_s, way)
        share = 1.0 / (xx + noise)
        by_position, by_speed, by_load, by_friction = xx * share, xv * share, xl * share, xf * share
        self._covariance = (
            xx - by_position * xx, xv - by_position * xv, xl - by_position * xl, xf - by_position * xf,
            vv - by_speed * xv, vl - by_speed * xl, vf - by_speed * xf,
            ll - by_load * xl, lf - by_load * xf,
            ff - by_friction * xf,
        )  # fmt: skip
        off = edge_rad + 0.5 * way * gone_rad - self.position_rad
        self.position_rad += by_position * off
        self.speed_rad_s += by_speed * off
        self.load += by_load * off
        self.friction += by_friction * off
        self._lacking = self.load + way * self.friction

    def deviation_rad(self, cycles: int, way: float) -> float:
        """Of the position, so many cycles after the last count."""
        return math.sqrt(self._later(cycles * self._period_s, way)[0])

    def _later(self, time_s: float, way: float) -> Covariance:
        """The covariance so much later: F·P·Fᵀ with F of the equations above for `time_s`, and what noise adds."""
        xx, xv, xl, xf, vv, vl, vf, ll, lf, ff = self._covariance
        half = 0.5 * time_s * time_s
        along, turned = way * time_s, way * half
        x_x = xx + time_s * xv + half * xl + turned * xf  # F·P; its columns follow
        x_v = xv + time_s * vv + half * vl + turned * vf
        x_l = xl + time_s * vl + half * ll + turned * lf
        x_f = xf + time_s * vf + half * lf + turned * ff
        v_v = vv + time_s * vl + along * vf
        v_l = vl + time_s * ll + along * lf
        v_f = vf + time_s * lf + along * ff
        noise = ACCELERATION_NOISE**2
        return (
            x_x + time_s * x_v + half * x_l + turned * x_f + noise * time_s**3 / 3.0,
            x_v + time_s * x_l + along * x_f + noise * half,
            x_l,
            x_f,
            v_v + time_s * v_l + along * v_f + noise * time_s,
            v_l,
            v_f,
            ll + LOAD_NOISE**2 * time_s,
            lf,
            ff + FRICTION_NOISE**2 * time_s,
        )


def _diagonal(position: float, speed: float, learned: tuple[float, ...]) -> Covariance:
    """Position and speed are independent of each other and of load and friction."""
    load, load_friction, friction = learned
    return position, 0.0, 0.0, 0.0, speed, 0.0, 0.0, load, load_friction, friction
