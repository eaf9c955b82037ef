"""A trajectory through given poses: the interpolation, the move to the first pose, and the stop at the end.

The source of the poses (the text of a file, an array, a function) must not enter.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial

import numpy as np

from canarm_protocol.shown import named_error, quoted

from ..errors import TrajectoryError
from .base import Bools, Trajectory, pose_text, start_pose
from .limits import Floats, Limits, Reference, real_numbers
from .spline import CubicCurve

ROUNDING = 1e-6
"""Of times that are written in decimals and subtracted: 0.06 - 0.04 is more than 0.02."""
DENSE_S = 0.02
"""Poses that are no further apart than this (50 Hz, as robots are recorded) are samples of a motion, not waypoints."""
STEADY_RAD_S2 = 1e-3
"""A joint that accelerates less than this moves at constant speed."""
MOVING_RAD_S = 5.0 / 255
"""A joint that is slower than one step of the tachometer does not count as moving."""
STOPS_S = (0.25, 0.5, 1.0, 2.0, 0.1)
"""Possible durations of the stop after the last pose; the first that the joints can follow is used."""
SHORTEST_APPROACH_S = 0.5
APPROACH_SPEED = 0.4
"""Highest speed of the move to the first pose as a share of a joint's highest speed, if possible."""
PEAK = 1.875
"""Peak speed of a quintic from rest to rest over its mean speed."""
FUNCTION_CHECKED_S = 20.0
"""A function is checked against the limits for this long before a run."""
DIFFERENCE_S = 1e-3
LONGER, TRIES = 1.4, 8
"""An approach that a joint cannot follow is tried again, this much slower, this many times."""


class Interpolation(StrEnum):
    """What lies between two poses."""

    MONOTONE = "monotone"
    """A cubic that never leaves the range of the two poses (PCHIP), from rest to rest."""
    SPLINE = "spline"
    """The smooth cubic spline, which may overshoot, from rest to rest."""
    SAMPLES = "samples"
    """Samples of a motion, which may begin and end at any speed; between sparse ones, as monotone."""


class OwnBeginning(Trajectory):
    """A trajectory with its own first pose: the arm moves there first, instead of being blended in."""

    def entered_from(self, start_rad: Sequence[float], at_least_s: float = 0.0) -> Trajectory:
        """The trajectory after a move from `start_rad` to its first pose: `approach_s`, and no less than `at_least_s`.

        Raises `TrajectoryError` when no such move can be followed.
        """
        start = start_pose(self, start_rad)
        first = self._at(np.zeros(1))
        gap = np.abs(first.position_rad[0] - start)
        needed_s = float(np.max(PEAK * gap / (APPROACH_SPEED * np.asarray(self.limits.speed_rad_s))))
        approach_s = max(SHORTEST_APPROACH_S, needed_s, at_least_s)
        for _ in range(TRIES - 1):
            try:
                return self._approached(start, first, approach_s)
            except TrajectoryError:
                approach_s *= LONGER
        return self._approached(start, first, approach_s)

    def _approached(self, start: Floats, first: Reference, approach_s: float) -> Trajectory:
        approached = Approached(self, start, first, approach_s)
        self.limits.check(approached, approached.approach_s, f"approach from {pose_text(start)}")
        return approached


class FileTrajectory(OwnBeginning):
    """A trajectory through the poses `position_rad` (n, joints) at `time_s` (n,), which begins with 0.

    Without `interpolation`, poses as dense as `DENSE_S` are samples, others are joined by the monotone cubic. It holds
    the last pose, after a stop if it was in motion. Raises `TrajectoryError`, in which `source` names it, where a joint
    cannot follow.
    """

    def __init__(
        self,
        limits: Limits,
        time_s: Floats,
        position_rad: Floats,
        interpolation: Interpolation | None = None,
        source: str = "trajectory",
    ) -> None:
        super().__init__(limits, tuple((np.ptp(position_rad, axis=0) / 2.0).tolist()))
        self.interpolation = interpolation or _natural(time_s)
        self.duration_s = float(time_s[-1])
        if self.interpolation is Interpolation.SAMPLES and len(time_s) < 3:
            raise TrajectoryError(f"{source}: {len(time_s)} rows; samples of a motion must be at least 3")
        self._curve = _CURVES[self.interpolation](time_s, position_rad)
        self._end_rad, self._end_rad_s = self._curve.value[-1], self._curve.slope[-1]
        self._stop_s = 0.0
        limits.check(self, self.duration_s, source)
        if self._end_rad_s.any():
            self._stop_s = self._find_stop(source)

    def _find_stop(self, source: str) -> float:
        refusal: TrajectoryError | None = None
        for self._stop_s in STOPS_S:
            try:
                self.limits.check(self, self.duration_s + self._stop_s, f"{source}: stop after its end")
            except TrajectoryError as error:
                refusal = error
            else:
                return self._stop_s
        raise TrajectoryError(f"{refusal}; it ends in motion: let it end slower, or further inside")

    def _at(self, time_s: Floats) -> Reference:
        reference = Reference(*self._curve.at(time_s))
        beyond = time_s >= self.duration_s
        if self._stop_s and beyond.any():
            # The speed falls to 0 along a cubic, at whose ends it does not change.
            stop_s, end_rad_s = self._stop_s, self._end_rad_s
            s = np.clip((time_s[beyond] - self.duration_s) / stop_s, 0.0, 1.0)[:, None]
            reference.position_rad[beyond] = self._end_rad + end_rad_s * stop_s * (s - s**3 + 0.5 * s**4)
            reference.velocity_rad_s[beyond] = end_rad_s * (1.0 - 3.0 * s**2 + 2.0 * s**3)
            reference.acceleration_rad_s2[beyond] = end_rad_s / stop_s * 6.0 * (s**2 - s)
        return reference

    def _is_steady(self, time_s: Floats) -> Bools:
        reference = self._at(time_s)
        is_even: Bools = np.abs(reference.acceleration_rad_s2) < STEADY_RAD_S2
        return is_even & (np.abs(reference.velocity_rad_s) > MOVING_RAD_S)


class FunctionTrajectory(OwnBeginning):
    """The angles in rad, one per joint, that `angles_rad` returns for a time in s; speeds are differences over 2 ms."""

    def __init__(self, limits: Limits, angles_rad: Callable[[float], Sequence[float]]) -> None:
        super().__init__(limits, (0.0,) * len(limits.joint_names))
        self._function = angles_rad
        swing = self._angles(np.arange(0.0, FUNCTION_CHECKED_S, limits.period_s))
        self.amplitude_rad = tuple((np.ptp(swing, axis=0) / 2.0).tolist())
        limits.check(self, FUNCTION_CHECKED_S, "trajectory")

    def _angles(self, time_s: Floats) -> Floats:
        try:
            given = [self._function(time) for time in time_s.tolist()]
        except Exception as error:
            raise TrajectoryError(f"trajectory: the function fails: {named_error(error)}") from error
        try:
            angles = real_numbers(given)
        except TrajectoryError:
            raise
        except Exception:  # whatever numpy makes of what is no number
            raise self._unfit(given) from None
        if angles.shape != (len(time_s), len(self.amplitude_rad)) or not np.isfinite(angles).all():
            raise self._unfit(given)
        return angles

    def _unfit(self, given: Sequence[object]) -> TrajectoryError:
        names = self.limits.joint_names
        return TrajectoryError(
            f"trajectory: the function must return {len(names)} finite angles in rad for a time in s, in the order "
            f"{', '.join(names)}; it has returned {quoted(given[0])}"
        )

    def _at(self, time_s: Floats) -> Reference:
        h = DIFFERENCE_S
        first = np.maximum(time_s - h, 0.0)  # it is not defined before 0
        before, middle, after = (self._angles(first + step) for step in (0.0, h, 2 * h))
        change = (time_s - first - h)[:, None]
        velocity, acceleration = (after - before) / (2 * h), (after - 2.0 * middle + before) / h**2
        at = middle if not change.any() else self._angles(time_s)
        return Reference(at, velocity + change * acceleration, acceleration)

    def _is_steady(self, time_s: Floats) -> Bools:
        return np.zeros((len(time_s), len(self.amplitude_rad)), dtype=np.bool_)


class Approached(Trajectory):
    """`inner`, begun `approach_s` late: until then each joint goes from rest at `start_rad` to where `inner` begins.

    A quintic, which meets position, speed and acceleration of `first`, the beginning of `inner`, without a step. The
    time is rounded up to whole cycles.
    """

    def __init__(self, inner: Trajectory, start_rad: Floats, first: Reference, approach_s: float) -> None:
        super().__init__(inner.limits, inner.amplitude_rad)
        period_s = inner.limits.period_s
        self.approach_s = t = float(np.ceil(approach_s / period_s)) * period_s
        self._inner, self._start_rad = inner, start_rad
        gap = first.position_rad[0] - start_rad
        way, bend = first.velocity_rad_s[0] * t, 0.5 * first.acceleration_rad_s2[0] * t * t
        self._cubed = 10.0 * gap - 4.0 * way + bend
        self._fourth = -15.0 * gap + 7.0 * way - 2.0 * bend
        self._fifth = 6.0 * gap - 3.0 * way + bend

    def _at(self, time_s: Floats) -> Reference:
        t = self.approach_s
        inner = self._inner._at(np.maximum(time_s - t, 0.0))
        s = np.clip(time_s / t, 0.0, 1.0)[:, None]
        a, b, c = self._cubed, self._fourth, self._fifth
        is_before = (time_s < t)[:, None]
        return Reference(
            np.where(is_before, self._start_rad + s**3 * (a + s * (b + s * c)), inner.position_rad),
            np.where(is_before, s**2 * (3.0 * a + s * (4.0 * b + s * 5.0 * c)) / t, inner.velocity_rad_s),
            np.where(is_before, s * (6.0 * a + s * (12.0 * b + s * 20.0 * c)) / t**2, inner.acceleration_rad_s2),
        )

    def _is_steady(self, time_s: Floats) -> Bools:
        is_begun: Bools = (time_s >= self.approach_s)[:, None]
        return self._inner._is_steady(np.maximum(time_s - self.approach_s, 0.0)) & is_begun


_CURVES: dict[Interpolation, Callable[[Floats, Floats], CubicCurve]] = {
    Interpolation.MONOTONE: CubicCurve.monotone,
    Interpolation.SPLINE: CubicCurve.clamped,
    Interpolation.SAMPLES: partial(CubicCurve.sampled, dense_s=DENSE_S * (1.0 + ROUNDING)),
}


def _natural(time_s: Floats) -> Interpolation:
    """One long gap is enough for waypoints: whoever bridges it by the slopes of samples overshoots."""
    is_dense = len(time_s) > 2 and float(np.diff(time_s).max()) <= DENSE_S * (1.0 + ROUNDING)
    return Interpolation.SAMPLES if is_dense else Interpolation.MONOTONE
