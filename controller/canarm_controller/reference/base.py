"""The base class of trajectories, and the blend from the measured pose into one without a beginning of its own."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import TrajectoryError
from .limits import Floats, Limits, Reference

Bools: TypeAlias = NDArray[np.bool_]

BLEND_S = 2.0
"""Duration of the blend from the measured pose."""
BLENDS_S = (BLEND_S, 3.0, 4.5, 6.0)
"""Possible durations; the shortest in which no joint gets too fast is used."""


class Trajectory(ABC):
    """Joint angles over time. `amplitude_rad` is half of each joint's peak-to-peak travel; laws scale gains by it."""

    def __init__(self, limits: Limits, amplitude_rad: tuple[float, ...]) -> None:
        self.limits = limits
        self.amplitude_rad = amplitude_rad
        self.approach_s = 0.0
        """Duration of the move to the trajectory's own beginning."""

    def sample(self, first_tick: int, count: int, period_s: float) -> Reference:
        """The reference at `count` ticks from `first_tick` on, which are `period_s` apart; tick 0 is the start."""
        return self._at(_times(first_tick, count, period_s))

    def constant_speed(self, first_tick: int, count: int, period_s: float) -> Bools:
        """Which samples are on a stretch of constant speed, (n, joints): the paper judges speed on them."""
        return self._is_steady(_times(first_tick, count, period_s))

    def entered_from(self, start_rad: Sequence[float], at_least_s: float = 0.0) -> "Trajectory":
        """This trajectory, begun at rest at the measured pose `start_rad`: blended in, in 2 s or slower if it is far.

        A move to a beginning of its own, which some have, takes `at_least_s` or more. Raises `TrajectoryError` when
        the pose lies outside the joint limits, or too far off.
        """
        for blend_s in BLENDS_S[:-1]:
            try:
                return blend_from(self, start_rad, blend_s)
            except TrajectoryError:
                continue
        return blend_from(self, start_rad, BLENDS_S[-1])

    @abstractmethod
    def _at(self, time_s: Floats) -> Reference:
        """The reference at the times `time_s` (n,)."""

    @abstractmethod
    def _is_steady(self, time_s: Floats) -> Bools:
        """Whether each joint moves at constant, non-zero speed at the times `time_s` (n,)."""


class Blended(Trajectory):
    """`inner`, entered from rest at `start_rad` within `blend_s`: start + s·(inner - start), s the quintic smoothstep.

    s runs from 0 to 1 with zero first and second derivative at both ends, so position, speed and acceleration are
    continuous, and the joint stays between the start pose and the trajectory at every moment.
    """

    def __init__(self, inner: Trajectory, start_rad: Floats, blend_s: float) -> None:
        super().__init__(inner.limits, inner.amplitude_rad)
        self._inner = inner
        self._start_rad = start_rad
        self._blend_s = blend_s

    def _at(self, time_s: Floats) -> Reference:
        inner = self._inner._at(time_s)
        x = np.clip(time_s / self._blend_s, 0.0, 1.0)[:, None]
        s = x**3 * (10.0 + x * (6.0 * x - 15.0))
        s_rate = 30.0 * x**2 * (1.0 - x) ** 2 / self._blend_s
        s_acceleration = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / self._blend_s**2
        gap = inner.position_rad - self._start_rad
        return Reference(
            self._start_rad + s * gap,
            s_rate * gap + s * inner.velocity_rad_s,
            s_acceleration * gap + 2.0 * s_rate * inner.velocity_rad_s + s * inner.acceleration_rad_s2,
        )

    def _is_steady(self, time_s: Floats) -> Bools:
        return self._inner._is_steady(time_s) & (time_s >= self._blend_s)[:, None]


def blend_from(trajectory: Trajectory, start_rad: Sequence[float], blend_s: float = BLEND_S) -> Trajectory:
    """`trajectory`, entered from rest at the measured pose `start_rad` (one angle per joint) within `blend_s`.

    Raises `TrajectoryError` if the start lies outside the joint limits, or so far off that a joint would be too fast.
    """
    start = start_pose(trajectory, start_rad)
    blended = Blended(trajectory, start, blend_s)
    trajectory.limits.check(blended, blend_s, f"start from {pose_text(start)}")
    return blended


def start_pose(trajectory: Trajectory, start_rad: Sequence[float]) -> Floats:
    """The pose as an array. Raises `TrajectoryError` unless it is one angle for each joint."""
    start: Floats = np.asarray(start_rad, dtype=np.float64)
    joints = len(trajectory.amplitude_rad)
    if start.shape != (joints,):
        raise TrajectoryError(f"start pose has shape {start.shape}; must be one angle for each of {joints} joints")
    return start


def pose_text(pose_rad: Floats) -> str:
    """A pose for error messages."""
    return f"{np.round(np.degrees(pose_rad), 2).tolist()} deg"


def _times(first_tick: int, count: int, period_s: float) -> Floats:
    return np.arange(first_tick, first_tick + count, dtype=np.float64) * period_s
