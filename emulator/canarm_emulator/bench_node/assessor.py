"""Compares the true motion with the reference that a controller reports: the bench's own assessment of a run.

The reference arrives late and in batches; the truth of the last cycles is kept until it does.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from canarm_protocol.cell.bench_objects import SETTLING_CYCLES as SETTLING_CYCLES
from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import position_steps_rad

from ..robot.world import JointState

KEPT_CYCLES = 4096

LARGEST_RAD = 1e6
"""Largest reference that is believed."""
SHORTEST_STRETCH = 100
"""Cycles for which the reference must keep its speed to count as a stretch of constant speed."""
STEADY_RAD = 5e-7
"""Steps of a stretch may differ from its first one by this: in single precision a step is known to 2.4e-7 rad. Over the
shortest stretch that allows an acceleration of less than 1e-3 rad/s² at 2.5 ms."""
STEADY_SHARE = 0.01
"""And by this share of it: what creeps by less than `STEADY_RAD` / `STEADY_SHARE` a cycle (0.02 rad/s at 2.5 ms) may as
well be coming to rest, and a ripple in shares of nearly nothing means nothing."""


@dataclass(slots=True)
class SpeedRipple:
    """Ripple of the true speed on stretches of constant reference speed: standard deviation over mean, pooled.

    Each stretch has its own mean, so that moving back and forth does not count as ripple.
    """

    last_rad: float = math.nan
    step_rad: float = math.nan
    """The first step of the stretch."""
    count: int = 0
    mean: float = 0.0
    squares: float = 0.0
    pooled_count: int = 0
    pooled_distance: float = 0.0
    pooled_squares: float = 0.0

    def add(self, reference_rad: float, speed_rad_s: float) -> None:
        """Take the next cycle (Welford's update)."""
        step = reference_rad - self.last_rad
        if abs(step - self.step_rad) < STEADY_RAD < STEADY_SHARE * abs(step):
            self.count += 1
            delta = speed_rad_s - self.mean
            self.mean += delta / self.count
            self.squares += delta * (speed_rad_s - self.mean)
        else:
            if self.count:
                self._end_stretch()
            self.step_rad = step
        self.last_rad = reference_rad

    @property
    def value(self) -> float:
        """The ripple; 0 while there was no stretch of constant speed."""
        count, distance, squares = self.pooled_count, self.pooled_distance, self.pooled_squares
        if self.count >= SHORTEST_STRETCH:
            count, distance = count + self.count, distance + self.count * abs(self.mean)
            squares += self.squares
        return math.sqrt(squares * count) / distance if distance else 0.0

    def _end_stretch(self) -> None:
        if self.count >= SHORTEST_STRETCH:
            self.pooled_count += self.count
            self.pooled_distance += self.count * abs(self.mean)
            self.pooled_squares += self.squares
        self.count, self.mean, self.squares = 0, 0.0, 0.0


@dataclass(slots=True)
class JointScore:
    """Running figures of one joint. Errors are true minus reference angle, in steps of the joint's position sensor."""

    lsb_rad: float
    ripple: SpeedRipple
    samples: int = 0
    sum_of_squares: float = 0.0
    max_lsb: float = 0.0
    peak_current_a: float = 0.0
    saturated_cycles: int = 0

    @property
    def rms_lsb(self) -> float:
        """Root mean square of the error; 0 while there are no samples."""
        return math.sqrt(self.sum_of_squares / self.samples) if self.samples else 0.0

    @property
    def speed_ripple(self) -> float:
        """See `SpeedRipple`."""
        return self.ripple.value


class Assessor:
    """Figures of a run; they begin again at every cycle 0."""

    def __init__(self, cell: Cell) -> None:
        self._lsb_rad = position_steps_rad(cell)
        self._limit_a = [joint.drive.max_current_a * (1.0 - 1e-9) for joint in cell.joints]
        self._supply_limited: Sequence[int] = [0] * len(cell.joints)
        self.begin()

    def begin(self) -> None:
        """Forget the last run."""
        self.scores = [JointScore(lsb, SpeedRipple()) for lsb in self._lsb_rad]
        joints = range(len(self._lsb_rad))
        self._kept = [-1] * KEPT_CYCLES
        """The cycles whose truth is kept, each at its remainder."""
        self._angles_rad = [[0.0] * KEPT_CYCLES for _ in joints]
        self._speeds_rad_s = [[0.0] * KEPT_CYCLES for _ in joints]

    def truth(self, cycle: int, joints: Sequence[JointState], supply_limited: Sequence[int]) -> None:
        """The true state at the SYNC of `cycle`.

        `supply_limited` counts per joint the steps so far in which the supply limited the current. A cycle is saturated
        when the D669 was at its limit, or the supply gave less than was asked for.
        """
        place = cycle % KEPT_CYCLES
        self._kept[place] = cycle
        before, self._supply_limited = self._supply_limited, supply_limited
        rows = zip(
            joints,
            self._angles_rad,
            self._speeds_rad_s,
            self.scores,
            self._limit_a,
            supply_limited,
            before,
            strict=True,
        )
        for true, angles_rad, speeds_rad_s, score, limit_a, steps, steps_before in rows:
            angles_rad[place], speeds_rad_s[place], current_a, command_a, _, _ = true
            if not -score.peak_current_a <= current_a <= score.peak_current_a:
                score.peak_current_a = abs(current_a)
            if steps > steps_before or not -limit_a < command_a < limit_a:
                score.saturated_cycles += 1

    def reference(self, tick: int, joint: int, angle_rad: float) -> None:
        """The reference of one joint at `tick`; ignored if it is no angle, too old, or of an unknown cycle."""
        self._score(tick, ((joint, angle_rad),))

    def references(self, tick: int, angles_rad: Sequence[float]) -> None:
        """`reference` of all joints."""
        self._score(tick, enumerate(angles_rad))

    def _score(self, tick: int, references: Iterable[tuple[int, float]]) -> None:
        place = tick % KEPT_CYCLES
        if self._kept[place] != tick or tick < SETTLING_CYCLES:
            return
        scores, angles_rad, speeds_rad_s = self.scores, self._angles_rad, self._speeds_rad_s
        for joint, angle_rad in references:
            if not -LARGEST_RAD < angle_rad < LARGEST_RAD:
                continue
            score = scores[joint]
            error = (angles_rad[joint][place] - angle_rad) / score.lsb_rad
            score.samples += 1
            score.sum_of_squares += error * error
            if not -score.max_lsb <= error <= score.max_lsb:
                score.max_lsb = abs(error)
            score.ripple.add(angle_rad, speeds_rad_s[joint][place])
