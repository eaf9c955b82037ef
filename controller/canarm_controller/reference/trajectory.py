"""Where the joints ought to be: reference trajectories, their start from the measured pose, and their limits.

Owns position, velocity and acceleration over time, and whether the nominal robot can follow. Control and the text of
CSV
files must not enter.
"""

import difflib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell

from ..dynamics import Arm, nominal_arm
from ..errors import TrajectoryError
from .built_in import swings as swings_of
from .spline import RestToRestSpline
from .trajectory_file import read_trajectory_csv

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

BLEND_S = 2.0
"""Time in which a trajectory is entered from the measured pose."""
CHECKED_AT_ONCE = 4096
"""Samples of a trajectory that are held at a time while it is checked."""
BUILT_IN = ("sine", "trapezoid")
TRAPEZOID_PERIOD_S = 5.12
CHECKED_S = 4 * TRAPEZOID_PERIOD_S
"""Of the built-in motions, whose joints have periods of their own: limits that hold for so long hold for ever."""
STEADY_RAD_S2 = 1e-3
"""A joint of a file's trajectory that accelerates less than this moves at constant speed."""
MOVING_RAD_S = 5.0 / 255
"""Slower than one step of the tachometer is not motion."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A stretch of trajectory, one row a tick: rad, rad/s, rad/s², each (n, joints)."""

    position_rad: Floats
    velocity_rad_s: Floats
    acceleration_rad_s2: Floats


@dataclass(frozen=True)
class Limits:
    """What the joints can do and their sensors can see, one entry a joint, and the cycle at which it is checked.

    `arm` is the nominal model that says which current a motion takes; without one, current is not checked.
    """

    joint_names: tuple[str, ...]
    low_deg: tuple[float, ...]
    high_deg: tuple[float, ...]
    speed_rad_s: tuple[float, ...]
    period_s: float
    current_a: tuple[float, ...] = ()
    arm: Arm | None = None

    @classmethod
    def of(cls, cell: Cell) -> "Limits":
        """Joint limits, tachometer ranges and amplifiers of `cell`. Raises `ControllerError` for an arm without a
        model.
        """
        return cls(
            joint_names=cell.joint_names,
            low_deg=tuple(joint.limits_deg[0] for joint in cell.joints),
            high_deg=tuple(joint.limits_deg[1] for joint in cell.joints),
            speed_rad_s=tuple(joint.fastest_rad_s for joint in cell.joints),
            period_s=cell.bus.cycle_s,
            current_a=tuple(joint.drive.max_current_a for joint in cell.joints),
            arm=nominal_arm(cell.robot[0]) if len(cell.robot) == 1 else None,
        )

    def check(self, trajectory: "Trajectory", duration_s: float, source: str) -> None:
        """Raise `TrajectoryError` at the first sample within `duration_s` that a joint cannot follow."""
        samples = int(np.ceil(duration_s / self.period_s)) + 1
        for first in range(0, samples, CHECKED_AT_ONCE):
            self._check_part(trajectory, first, min(CHECKED_AT_ONCE, samples - first), source)

    def _check_part(self, trajectory: "Trajectory", first: int, count: int, source: str) -> None:
        reference = trajectory.sample(first, count, self.period_s)
        position_deg = np.degrees(reference.position_rad)
        # Negated, so that what is not a number is found as well.
        outside = ~((position_deg >= np.array(self.low_deg)) & (position_deg <= np.array(self.high_deg)))
        too_fast = ~(np.abs(reference.velocity_rad_s) <= np.array(self.speed_rad_s))
        for sample, joint in np.argwhere(outside | too_fast)[:1].tolist():
            number = first + sample
            where = f"{source}: {self.joint_names[joint]} at sample {number} ({number * self.period_s:.4g} s)"
            if outside[sample, joint]:
                raise TrajectoryError(
                    f"{where}: {position_deg[sample, joint]:.2f} deg is outside limits_deg = "
                    f"[{self.low_deg[joint]:g}, {self.high_deg[joint]:g}]"
                )
            raise TrajectoryError(
                f"{where}: {reference.velocity_rad_s[sample, joint]:.3f} rad/s is beyond the tachometer's range; "
                f"must be within +-{self.speed_rad_s[joint]:g} rad/s"
            )
        self._check_current(reference, first, source)

    def _check_current(self, reference: Reference, first: int, source: str) -> None:
        """The nominal robot must be able to follow with the current that its amplifiers have."""
        if self.arm is None:
            return
        torque_nm = self.arm.torque_batch_nm(
            reference.position_rad, reference.velocity_rad_s, reference.acceleration_rad_s2
        )
        current_a = np.abs(torque_nm / np.array(self.arm.torque_per_ampere))
        for sample, joint in np.argwhere(~(current_a <= np.array(self.current_a)))[:1].tolist():
            number = first + sample
            raise TrajectoryError(
                f"{source}: {self.joint_names[joint]} at sample {number} ({number * self.period_s:.4g} s): "
                f"{current_a[sample, joint]:.2f} A by the nominal model; must be at most {self.current_a[joint]:g} A, "
                "all that the amplifier has"
            )


class Trajectory(ABC):
    """Joint angles over time. `amplitude_rad` is half of each joint's peak-to-peak travel; laws scale gains by it."""

    def __init__(self, limits: Limits, amplitude_rad: tuple[float, ...]) -> None:
        self.limits = limits
        self.amplitude_rad = amplitude_rad

    def sample(self, first_tick: int, count: int, period_s: float) -> Reference:
        """The reference at `count` ticks from `first_tick` on, which are `period_s` apart; tick 0 is the start."""
        return self._at(_times(first_tick, count, period_s))

    def constant_speed(self, first_tick: int, count: int, period_s: float) -> Bools:
        """Which samples lie on a stretch of constant speed, (n, joints): the paper judges speed on them."""
        return self._is_steady(_times(first_tick, count, period_s))

    @abstractmethod
    def _at(self, time_s: Floats) -> Reference:
        """The reference at the times `time_s` (n,)."""

    @abstractmethod
    def _is_steady(self, time_s: Floats) -> Bools:
        """Whether each joint moves at constant, non-zero speed at the times `time_s` (n,)."""


class Sine(Trajectory):
    """Each joint swings sinusoidally about a centre: no stretch of constant speed."""

    def __init__(
        self, limits: Limits, centre_deg: Sequence[float], amplitude_deg: Sequence[float], period_s: Sequence[float]
    ) -> None:
        super().__init__(limits, tuple(np.radians(np.asarray(amplitude_deg)).tolist()))
        self._centre_rad = np.radians(np.asarray(centre_deg))
        self._omega_rad_s = 2.0 * np.pi / np.asarray(period_s)

    def _at(self, time_s: Floats) -> Reference:
        omega = self._omega_rad_s
        phase = time_s[:, None] * omega
        amplitude = np.asarray(self.amplitude_rad)
        swing = amplitude * np.sin(phase)
        return Reference(self._centre_rad + swing, amplitude * omega * np.cos(phase), -(omega**2) * swing)

    def _is_steady(self, time_s: Floats) -> Bools:
        return np.zeros((len(time_s), len(self.amplitude_rad)), dtype=np.bool_)


class Trapezoid(Trajectory):
    """Each joint goes up and down between two angles at constant speed, half a period each way.

    A move begins and ends at rest with parabolic blends of `blend_s`: linear segments with parabolic blends.
    """

    def __init__(
        self, limits: Limits, low_deg: Sequence[float], high_deg: Sequence[float], period_s: float, blend_s: float
    ) -> None:
        self._low_rad = np.radians(np.asarray(low_deg))
        self._stroke_rad = np.radians(np.asarray(high_deg)) - self._low_rad
        self._move_s = period_s / 2.0
        self._blend_s = blend_s
        super().__init__(limits, tuple((self._stroke_rad / 2.0).tolist()))

    def _at(self, time_s: Floats) -> Reference:
        move_s, blend_s = self._move_s, self._blend_s
        move, t = np.divmod(time_s, move_s)
        left = move_s - t
        begins, ends = t < blend_s, left < blend_s
        way = np.where(
            begins, t * t / (2 * blend_s), np.where(ends, move_s - blend_s - left**2 / (2 * blend_s), t - blend_s / 2)
        )
        rate = np.minimum(np.minimum(t, left) / blend_s, 1.0)
        rate_change = np.where(begins, 1.0, np.where(ends, -1.0, 0.0)) / blend_s
        downward = move % 2 == 1
        sign = np.where(downward, -1.0, 1.0)
        speed = self._stroke_rad / (move_s - blend_s)
        travelled = np.where(downward[:, None], self._stroke_rad - way[:, None] * speed, way[:, None] * speed)
        return Reference(
            self._low_rad + travelled, (sign * rate)[:, None] * speed, (sign * rate_change)[:, None] * speed
        )

    def _is_steady(self, time_s: Floats) -> Bools:
        t = np.mod(time_s, self._move_s)
        steady: Bools = (t >= self._blend_s) & (self._move_s - t >= self._blend_s)
        return np.repeat(steady[:, None], len(self.amplitude_rad), axis=1)


class FileTrajectory(Trajectory):
    """A trajectory through given points, from rest to rest, holding the last pose; see `RestToRestSpline`."""

    def __init__(self, limits: Limits, time_s: Floats, position_rad: Floats) -> None:
        super().__init__(limits, tuple((np.ptp(position_rad, axis=0) / 2.0).tolist()))
        self._spline = RestToRestSpline.through(time_s, position_rad)

    def _at(self, time_s: Floats) -> Reference:
        return Reference(*self._spline.at(time_s))

    def _is_steady(self, time_s: Floats) -> Bools:
        _, velocity, acceleration = self._spline.at(time_s)
        return (np.abs(acceleration) < STEADY_RAD_S2) & (np.abs(velocity) > MOVING_RAD_S)


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


def make_trajectory(spec: str, cell: Cell) -> Trajectory:
    """The trajectory that the command line names: "sine", "trapezoid", or the path of a CSV file.

    Raises `TrajectoryError` when there is no such thing, when the file is wrong, or when a joint cannot follow.
    """
    limits = Limits.of(cell)
    if spec in BUILT_IN:
        trajectory: Trajectory = _built_in(spec, limits, cell)
        duration_s = CHECKED_S
    elif not Path(spec).exists():
        close = difflib.get_close_matches(spec, BUILT_IN, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise TrajectoryError(f"{spec}: no such trajectory or file; built in: {', '.join(BUILT_IN)}{hint}")
    else:
        time_s, position_rad = read_trajectory_csv(Path(spec), limits.joint_names)
        trajectory = FileTrajectory(limits, time_s, position_rad)
        duration_s = float(time_s[-1])
    limits.check(trajectory, duration_s, spec)
    return trajectory


def blend_from(trajectory: Trajectory, start_rad: Sequence[float], blend_s: float = BLEND_S) -> Trajectory:
    """`trajectory`, entered from rest at the measured pose `start_rad` (one angle a joint) within `blend_s`.

    Raises `TrajectoryError` if the start lies outside the joint limits, or so far off that a joint would be too fast.
    """
    start: Floats = np.asarray(start_rad, dtype=np.float64)
    joints = len(trajectory.amplitude_rad)
    if start.shape != (joints,):
        raise TrajectoryError(f"start pose has shape {start.shape}; must be one angle for each of {joints} joints")
    blended = Blended(trajectory, start, blend_s)
    trajectory.limits.check(blended, blend_s, f"start from {np.round(np.degrees(start), 2).tolist()} deg")
    return blended


def _built_in(name: str, limits: Limits, cell: Cell) -> Trajectory:
    """The two test motions, for the joints of `cell`."""
    home_deg = [joint.home_deg for joint in cell.joints]
    swings = swings_of(home_deg, limits.low_deg, limits.high_deg, limits.speed_rad_s)
    centre, amplitude = [each.centre_deg for each in swings], [each.amplitude_deg for each in swings]
    if name == "sine":
        return Sine(limits, centre, amplitude, [each.period_s for each in swings])
    low, high = ([c + way * a for c, a in zip(centre, amplitude, strict=True)] for way in (-1.0, 1.0))
    return Trapezoid(limits, low, high, period_s=TRAPEZOID_PERIOD_S, blend_s=0.15)


def _times(first_tick: int, count: int, period_s: float) -> Floats:
    return np.arange(first_tick, first_tick + count, dtype=np.float64) * period_s
