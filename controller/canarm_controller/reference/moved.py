"""Trajectories that are others, moved in time or by constant angles, and the one that rests."""

from collections.abc import Sequence

import numpy as np

from .base import Bools, Trajectory, start_pose
from .limits import Floats, Limits, Reference


class Rest(Trajectory):
    """Every joint rests at `pose_rad`."""

    def __init__(self, limits: Limits, pose_rad: Floats, amplitude_rad: tuple[float, ...]) -> None:
        super().__init__(limits, amplitude_rad)
        self._pose_rad = pose_rad

    def _at(self, time_s: Floats) -> Reference:
        still = np.zeros((len(time_s), len(self._pose_rad)))
        return Reference(still + self._pose_rad, still, still.copy())

    def _is_steady(self, time_s: Floats) -> Bools:
        return np.zeros((len(time_s), len(self._pose_rad)), dtype=np.bool_)


class Later(Trajectory):
    """`inner`, begun `delay_s` late: until then it rests where `inner` begins, at rest."""

    def __init__(self, inner: Trajectory, delay_s: float) -> None:
        super().__init__(inner.limits, inner.amplitude_rad)
        self._inner, self._delay_s = inner, delay_s
        self.approach_s = delay_s + inner.approach_s

    def _at(self, time_s: Floats) -> Reference:
        return self._inner._at(np.maximum(time_s - self._delay_s, 0.0))

    def _is_steady(self, time_s: Floats) -> Bools:
        is_begun: Bools = (time_s >= self._delay_s)[:, None]
        return self._inner._is_steady(np.maximum(time_s - self._delay_s, 0.0)) & is_begun


class Offset(Trajectory):
    """`inner` with `offset_rad` (joints,) added to its angles."""

    def __init__(self, inner: Trajectory, offset_rad: Floats) -> None:
        super().__init__(inner.limits, inner.amplitude_rad)
        self._inner, self._offset_rad = inner, offset_rad
        self.approach_s = inner.approach_s

    def entered_from(self, start_rad: Sequence[float], at_least_s: float = 0.0) -> Trajectory:
        """This trajectory, begun at rest at `start_rad`, as `inner` is. Raises `TrajectoryError` as it does."""
        start = start_pose(self, start_rad)
        inner = self._inner.entered_from((start - self._offset_rad).tolist(), at_least_s)
        return Offset(inner, self._offset_rad)

    def _at(self, time_s: Floats) -> Reference:
        inner = self._inner._at(time_s)
        return Reference(inner.position_rad + self._offset_rad, inner.velocity_rad_s, inner.acceleration_rad_s2)

    def _is_steady(self, time_s: Floats) -> Bools:
        return self._inner._is_steady(time_s)
