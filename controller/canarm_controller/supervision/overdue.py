"""Whether the next count of an encoder is overdue: a joint that jams, and an encoder that stands, show first in that.

Between two counts nothing is measured of a joint without a tachometer, but each tells to a cycle when the joint was
where. Owns the time of the next count, and how late it may be; what follows from a late one is elsewhere.
"""

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from ..dynamics import HeldMotion
from .count_filter import CountFilter
from .expectation import ArmExpectation
from .joint_state import Mode
from .nominal import ROUNDING_LSB, JointNominal
from .tachless import TachlessWitness
from .thresholds import COULOMB_TURN
from .timing import Timing
from .uncertainty import COULOMB

SURE_SHARE, AGREED_SHARE = 1.0, 0.5
"""Shares of Coulomb friction that have to stop a joint unforeseen: to be sure of a late count, and where it is late by
the reference too: friction may be twice what the cell says. In runs without a fault 0.53 and 0.15 occur (22 drawn
robots of the pair, 182 s, and those with all errors at once)."""
AGREED_COUNTS, ASKED_COUNTS = 0.8, 0.1
"""So far the reference has gone beyond the next count where it agrees, and at least: its joint is meant to turn."""
SEEN_FACTOR, SEEN_S = 1.5, 10.0
"""A joint that sticks may stick again: the limit is so many times what was seen, for about this long."""
KNOWN_SHARE, KNOWN_COUNTS, SIGMAS = 0.5, 0.1, 5.0
"""The same for what all counts before say, how far the joint should then be beyond the next one, and in deviations."""
QUICK_S, NEAR_COUNTS = 0.05, 2.0
"""Only of quicker counts they say enough: a joint that takes longer may have been stopped on the way, and what is wrong
of the model grows with the square of the time. A filter further off begins again."""
LEAST_CYCLES = 4
"""How long a code stands before anything is made of it."""
LOOK_S = 0.1
"""How often it is looked up what friction makes of the joints: poses change it slowly."""
HELD_S, HELD_COUNTS = 0.05, 0.5
"""How long a joint has stood, and how far its reference has gone, when it may be held by more than friction."""
DRIVE_S, HELD_SHARE, HELD_FACTOR = 0.06, 2.1, 1.5
"""What the model then has drive it, averaged over that time, as a share of Coulomb friction, and of the most that was
seen before other counts: 1.73 occurs in the same runs."""


_NO_TACHOMETER = Mode.NO_TACHOMETER  # an enum's attribute is slow


class OverdueCount:
    """The next count of one joint, in rad, rad/s and rad/s².

    A count ends a step of δ that took Δt, to a cycle T: the joint then moves at v = δ/(Δt + T) and half of what the
    model gained meanwhile. Unless the model lacks an acceleration, it has gone ∫v dt a time t later. To be a step short
    of that, c = 2·(∫v dt - δ)/(t·(t + Δt)) has to be lacking, as v is off by ½·c·Δt. At constant speed c is 0.34·v²/δ
    at most, after 2.4 such steps: what is slower may as well have been stopped by friction. But then the law presses,
    and what drives the joint by its model grows beyond what friction has ever held.

    What all counts of a joint say, once it is known (`CountFilter`), is surer, as long as counts come quickly.
    """

    __slots__ = (
        "_bias", "_cycles", "_cycles_before", "_drive_gain", "_drive_rad_s2", "_filter", "_gone_rad", "_held",
        "_held_cycles", "_held_now", "_is_known", "_last_rad", "_model_rad_s", "_model_sum", "_period_s",
        "_reference_rad", "_seen", "_seen_now", "_since", "_speed", "_step_rad", "_timing", "_way", "friction_rad_s2",
        "said",
    )  # fmt: skip

    def __init__(self, nominal: JointNominal, timing: Timing) -> None:
        self._step_rad, self._period_s, self._timing = nominal.position.step, timing.period_s, timing
        self.friction_rad_s2 = nominal.coulomb_nm * nominal.mobility_per_kg_m2[1]
        """What Coulomb friction makes of the joint: its own, and that of others through links and grips."""
        self._held_cycles = max(round(HELD_S / timing.period_s), LEAST_CYCLES)
        self._drive_gain = min(timing.period_s / DRIVE_S, 1.0)
        self.said = ""
        """What is said of a count that is overdue."""
        self.start()

    def start(self) -> None:
        """Nothing is known of the joint, and nothing was seen of how it sticks."""
        self._seen, self._held, self._since = 0.0, 0.0, 0
        self._filter = CountFilter(self._step_rad, self._period_s, self.friction_rad_s2)
        self.forget()

    def forget(self) -> None:
        """When the last count came is not known."""
        self._is_known, self._way, self._cycles, self._cycles_before = False, 0.0, 0, 0
        self._last_rad, self._speed, self._bias, self._gone_rad, self._reference_rad = math.nan, 0.0, 0.0, 0.0, 0.0
        self._model_rad_s = self._model_sum = self._seen_now = self._held_now = self._drive_rad_s2 = 0.0

    def step(self, position_rad: float, acceleration: float, bias: float, reference_rad: float) -> bool:
        """Whether a count is overdue. `acceleration` is the model's since the last cycle, `bias` what it lacks."""
        moved = position_rad - self._last_rad
        self._last_rad = position_rad
        self._since += 1
        if moved != moved:  # the first reading
            self._reference_rad = reference_rad
            return False
        lacking = self._bias if self._way else bias
        drive = self._drive_rad_s2
        self._drive_rad_s2 = drive + (acceleration + lacking - drive) * self._drive_gain
        cycles = self._cycles = self._cycles + 1
        model_rad_s = self._model_rad_s = self._model_rad_s + self._period_s * acceleration
        self._model_sum += model_rad_s
        self._filter.step(acceleration)
        if moved:
            self._count(position_rad, moved, bias, reference_rad)
            return False
        if cycles >= self._held_cycles and self._is_held(abs(reference_rad - self._reference_rad)):
            return True
        return self._is_known and self._is_late(acceleration, reference_rad)

    def _is_held(self, asked_rad: float) -> bool:
        """Whether more than friction holds a joint that stands while its reference goes on."""
        drive = abs(self._drive_rad_s2)
        share = HELD_SHARE if self._since >= self._timing.early else COULOMB_TURN
        limit = max(share * self.friction_rad_s2, HELD_FACTOR * self._held)
        if drive > limit and asked_rad > HELD_COUNTS * self._step_rad:
            times = drive / self.friction_rad_s2
            self.said = f"no count for {self._stood_ms:g} ms, although {times:.1f} times its friction drive it"
            return True
        if drive > self._held_now:
            self._held_now = drive
        return False

    def _is_late(self, acceleration: float, reference_rad: float) -> bool:
        """Whether the count is later than friction may make it."""
        period_s, way, step_rad, cycles = self._period_s, self._way, self._step_rad, self._cycles
        speed = self._speed = self._speed + period_s * way * (acceleration + self._bias)
        gone_rad = self._gone_rad = self._gone_rad + period_s * speed
        asked_rad = way * (reference_rad - self._reference_rad) - step_rad
        if asked_rad <= 0.0 or cycles < LEAST_CYCLES:
            return False
        stood_s = cycles * period_s
        before_s = self._cycles_before * period_s
        lacking = 2.0 * (gone_rad - step_rad) / (stood_s * (stood_s + before_s))
        if lacking > self._limit(asked_rad) and asked_rad > ASKED_COUNTS * step_rad:
            self.said = (
                f"no count for {self._stood_ms:g} ms, in which it went {gone_rad / step_rad:.1f} LSB by its last ones"
            )
            return True
        if lacking > self._seen_now:
            self._seen_now = lacking
        return self._is_later_than_known(stood_s, before_s, asked_rad)

    def _is_later_than_known(self, stood_s: float, before_s: float, asked_rad: float) -> bool:
        """Whether the count is later than all before it allow."""
        step_rad = self._step_rad
        if self._since < self._timing.early or max(stood_s, before_s) > QUICK_S or asked_rad < ASKED_COUNTS * step_rad:
            return False
        beyond_rad = self._way * (self._filter.position_rad - self._last_rad) - 0.5 * step_rad
        if beyond_rad < KNOWN_COUNTS * step_rad:
            return False
        lacking = 2.0 * beyond_rad / (stood_s * (stood_s + before_s))
        limit = max(KNOWN_SHARE * self.friction_rad_s2, SEEN_FACTOR * self._seen)
        if lacking <= limit or beyond_rad <= SIGMAS * self._filter.deviation_rad(self._cycles, self._way):
            return False
        gone = 1.0 + beyond_rad / step_rad
        self.said = f"no count for {self._stood_ms:g} ms, in which it went {gone:.1f} LSB by all before"
        return True

    @property
    def _stood_ms(self) -> float:
        return 1e3 * self._cycles * self._period_s

    def _limit(self, asked_rad: float) -> float:
        if self._since < self._timing.early:
            return (COULOMB[1] - 1.0) * self.friction_rad_s2
        share = AGREED_SHARE if asked_rad > AGREED_COUNTS * self._step_rad else SURE_SHARE
        return max(share * self.friction_rad_s2, SEEN_FACTOR * self._seen)

    def _count(self, position_rad: float, moved: float, bias: float, reference_rad: float) -> None:
        cycles, way = self._cycles, math.copysign(1.0, moved)
        if way == self._way:
            before_s = cycles * self._period_s
            gained = self._model_rad_s - self._model_sum / cycles + 0.5 * bias * before_s
            self._speed = abs(moved) / (before_s + self._period_s) + way * gained
            self._is_known = self._speed > 0.0
        else:
            self._is_known = False
        edge_rad = position_rad - moved + 0.5 * way * self._step_rad
        if way == self._way and abs(self._filter.position_rad - edge_rad) < NEAR_COUNTS * self._step_rad:
            self._filter.count(edge_rad, way, cycles, abs(moved) < 1.5 * self._step_rad)
        else:
            self._filter.begin(edge_rad)
        self._seen = max(self._seen_now, self._seen * math.exp(-cycles * self._period_s / SEEN_S))
        self._held, self._held_now = max(self._held, self._held_now), 0.0
        self._way, self._bias, self._reference_rad, self._cycles_before = way, bias, reference_rad, cycles
        self._gone_rad = self._seen_now = self._model_rad_s = self._model_sum = 0.0
        self._cycles = 0


class CountWatch:
    """The counts of all joints that have an encoder alone. `report` is told a joint's index and what is said of it."""

    def __init__(
        self,
        joints: Iterable[object],
        nominals: Sequence[JointNominal],
        timing: Timing,
        report: Callable[[int, str], None],
    ) -> None:
        self._report = report
        self._coulomb_nm = np.array([nominal.coulomb_nm for nominal in nominals])
        self._looks, self._looks_between = 0, max(round(LOOK_S / timing.refresh / timing.period_s), 1)
        self._joints = [
            (index, joint, OverdueCount(nominal, timing))
            for index, (joint, nominal) in enumerate(zip(joints, nominals, strict=True))
            if isinstance(joint, TachlessWitness) and is_counted(nominal)
        ]
        self._taken: tuple[Sequence[float], Sequence[float]] | None = None

    def start(self) -> None:
        """A run begins, or angles are other ones."""
        self._taken = None
        for _, _, count in self._joints:
            count.start()

    def forget(self) -> None:
        """Measurements are missing, or their time is."""
        self._taken = None
        for _, _, count in self._joints:
            count.forget()

    def look(self, robots: Sequence[ArmExpectation], held: HeldMotion | None) -> None:
        """Called every `Timing.refresh` cycles: M⁻¹ of each robot, and what grips bear of it, change with the pose."""
        self._looks += 1
        if not self._joints or self._looks % self._looks_between != 1 % self._looks_between:
            return
        mobility = np.zeros((len(self._coulomb_nm),) * 2)
        first = 0
        for robot in robots:
            own = slice(first, first + len(robot.mobility))
            mobility[own, own] = robot.mobility
            first = own.stop
        if held is not None:
            mobility -= held.borne
        made = np.linalg.norm(mobility * self._coulomb_nm, axis=1).tolist()
        for index, _, count in self._joints:
            count.friction_rad_s2 = made[index]

    def take(self, position_rad: Sequence[float], accelerations: Sequence[float]) -> None:
        """The readings of a cycle, and the model's accelerations since the last one."""
        if self._joints:
            self._taken = position_rad, accelerations

    def follow(self, reference_rad: Sequence[float]) -> None:
        """Judge the cycle, once its reference is known."""
        if self._taken is None:
            return
        (position_rad, accelerations), self._taken = self._taken, None
        for index, joint, count in self._joints:
            if joint.mode is not _NO_TACHOMETER or joint.is_shaken:
                count.forget()
            elif count.step(position_rad[index], accelerations[index], joint.bias, reference_rad[index]):
                self._report(index, count.said)
                count.forget()


def is_counted(joint: JointNominal) -> bool:
    """Whether nothing but rounding makes its position sensor wrong, and nothing else tells its speed."""
    return joint.speed is None and joint.position.noise_lsb <= 1.01 * ROUNDING_LSB
