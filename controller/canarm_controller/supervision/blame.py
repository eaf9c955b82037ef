"""Where the arm itself has failed: which joint's link or wire explains the speeds of all joints best.

Owns the likelihoods of what may have happened to the arm within the last cycles; when to ask, and what is said of it,
are elsewhere. It costs some 30 cycles' worth of watching, and is asked only once something is unexpected.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..dynamics import Arm, Floats
from .currents import WORTH_MENTION
from .nominal import JointNominal
from .thresholds import REFERENCE_NOISE, Thresholds
from .uncertainty import WIRE

PAST_CYCLES = 20
"""How many cycles are looked at,"""
ONSETS = range(2, 11)
"""and how many of them may have passed since it happened. Accelerations are assessed four after the first sign."""
SETTLED_CYCLES = 8
"""So many at the beginning tell what the wires carried."""
SOFT_SHARE = 0.5
"""A wire that has become soft is half as stiff as the softest of the box."""
MOST_SHARE = 1.2
"""What a wire carried is known to a fifth."""
JAMMED_SHARES, REVERSED_SHARES = (0.8, 1.2), (1.7, 2.3)
"""A jam takes the speed that there was, a reversed bridge twice the torque: known to 20 and 15 %."""
STRUCK_SPEEDS, PUSHED_DRIVES = 2.0, 2.0
"""What hits a joint changes its speed by as many times its fastest at most; what rubs or pulls, in drives' torques."""
OWN_ERROR, CROSS_ERROR = 0.06, 0.02
"""Error of the model, as a share of a joint's own change of speed and of the greatest of all joints'."""
DOUBT_SHARE = 0.5
"""Share of the limit of an unexpected acceleration that is unexpected, as a deviation, without any failure."""
FREE_RAD_S = 5.0
"""A deviation that says nothing: a mean that is not known, or what a failed tachometer shows."""
HELD_KG_M2 = 1e4
"""An inertia that nothing moves: of a joint that is jammed."""
SQUARINGS = 4
"""The motion over a cycle is a Taylor series of the fourth order over 1/16 of it, squared so often."""

STRONG = math.log(20.0)
"""Logarithm of a likelihood ratio above which evidence is "strong", by the same source as `WORTH_MENTION`."""

Moment = tuple[Sequence[float], Sequence[float], Sequence[float], Sequence[float]]
"""One cycle of all joints: measured speeds, the model's, what it lacks, and the torques that have acted."""


class Cause(Enum):
    """What may have happened at a joint."""

    HIT = "hit"
    """A blow against its link."""
    PUSHED = "pushed"
    """A load or friction that lasts."""
    JAMMED = "jammed"
    FREED = "freed"
    """Its wire is slack or broken: the motor gets back what it carried, the link loses it."""
    SOFT = "soft"
    """Its wire gives, and motor and link swing."""
    REVERSED = "reversed"
    """Its bridge: the motor gets twice its torque the other way."""


OF_THE_ARM = tuple(cause for cause in Cause if cause is not Cause.REVERSED)


@dataclass(frozen=True, slots=True)
class Finding:
    """Logarithms of likelihoods, over that of nothing but noise. One number per joint."""

    arm: Sequence[float]
    """Of a failure of its link or wire."""
    reversed_drive: Sequence[float]
    tachometer: Sequence[float]
    """Empty if not asked for."""

    @property
    def joint(self) -> int:
        """Where the arm has failed, if it has."""
        return max(range(len(self.arm)), key=self.arm.__getitem__)

    def rather_than(self, joint: int) -> int | None:
        """Where the arm has failed, if it is likelier there than at `joint`, and worth a mention."""
        return self.joint if self.arm[self.joint] > self.arm[joint] + WORTH_MENTION else None

    def is_arm(self, joint: int) -> bool:
        """Whether it is the arm, and strongly not the tachometer of `joint`."""
        return self.arm[self.joint] > max(self.tachometer[joint], 0.0) + STRONG

    def is_not_reversed(self, joint: int) -> bool:
        """Whether it is the arm, and strongly not the bridge of `joint`."""
        return self.arm[self.joint] > self.reversed_drive[joint] + STRONG


class Blame:
    """One robot. `inertia` of `find` includes rotors; `compliance` is the wires', 0 of a rigid one.

    The speeds less the model's are compared, all joints together, with what each failure would make of them: motions of
    links and motors on the wires that there are, linear about the model's motion. The size of a failure is equally
    likely up to what is possible (a wire gives back no more than it carried), its moment any within the last cycles.
    """

    def __init__(self, arm: Arm, joints: Sequence[JointNominal], limits: Sequence[Thresholds], period_s: float) -> None:
        self._arm, self._period_s = arm, period_s
        self._rotors = np.array(arm.rotor_inertia)
        self._noise = np.array([REFERENCE_NOISE * each.speed_grain for each in limits])
        self._doubt = np.array([DOUBT_SHARE * each.acceleration for each in limits])
        self._soft = [SOFT_SHARE * WIRE[0] * each.wire_stiffness_nm_rad for each in joints]
        self._fastest = np.array([each.fastest_rad_s for each in joints])
        self._most_nm = [PUSHED_DRIVES * each.torque_per_ampere * each.max_current_a for each in joints]

    def find(
        self, past: Sequence[Moment], inertia: Sequence[Sequence[float]], compliance: Sequence[float],
        with_tachometers: bool = True,
    ) -> Finding:  # fmt: skip
        """What the last `PAST_CYCLES` tell; fewer are too few. Without tachometers it takes two thirds of the time."""
        speeds, models, biases, torques = (np.array(rows) for rows in zip(*past, strict=True))
        period_s, (cycles, joints) = self._period_s, speeds.shape
        time_s = period_s * (np.arange(cycles) - 0.5 * cycles)
        off = speeds - models - np.outer(time_s, biases[0])
        kinds, motions = self._motions(np.array(inertia), compliance)
        shapes = np.zeros((len(kinds), len(ONSETS), cycles, joints))
        for place, since in enumerate(ONSETS):
            shapes[:, place, cycles - since :] = motions[:, :since]
        for (cause, joint), motion, shape in zip(kinds, motions, shapes, strict=True):
            if cause is Cause.REVERSED:
                _drive(motion, torques[:, joint], shape)
        covariance = self._covariance(off, time_s)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        whitened_off, whitened = np.einsum("jst,tj->sj", whiten, off), np.einsum("jst,kotj->kosj", whiten, shapes)
        squares = np.sum(whitened * whitened, axis=(2, 3))
        products = np.sum(whitened * whitened_off, axis=(2, 3))
        speed, acceleration = speeds[SETTLED_CYCLES], (models[SETTLED_CYCLES] - models[0]) / (SETTLED_CYCLES * period_s)
        carried_nm = torques[:SETTLED_CYCLES].mean(axis=0) - np.array(self._arm.friction(speed.tolist()))
        carried_nm -= self._rotors * (acceleration + biases[0])
        bounds = self._bounds(np.linalg.inv(np.array(inertia)), speed, carried_nm)
        arm: list[list[float]] = [[] for _ in range(joints)]
        reversed_drive = [-math.inf] * joints
        for (cause, joint), own_squares, own_products in zip(kinds, squares.tolist(), products.tolist(), strict=True):
            low, high = bounds(cause, joint)
            rows = zip(own_squares, own_products, strict=True)
            likelihoods = [log_mean_likelihood(*row, low, high) for row in rows]
            if cause is Cause.REVERSED:
                reversed_drive[joint] = log_mean(likelihoods)
            else:
                arm[joint] += likelihoods
        return Finding(
            [log_mean(each) for each in arm],
            reversed_drive,
            self._of_tachometers(off, covariance) if with_tachometers else (),
        )

    def _motions(self, inertia: Floats, compliance: Sequence[float]) -> tuple[list[tuple[Cause, int]], Floats]:
        """Motors' speeds at the end of each cycle after each failure of the size one: (failures, cycles, joints).

        Coordinates are the links' angles, then the motors'; of a rigid wire the motor's is idle.
        """
        count, rotors = len(compliance), self._rotors
        kinds, systems, outputs = [], [], []
        for joint in range(count):
            for cause in Cause:
                stiffness = [1.0 / each if each else math.inf for each in compliance]
                if cause is Cause.FREED or cause is Cause.SOFT:
                    stiffness[joint] = 0.0 if cause is Cause.FREED else self._soft[joint]
                masses, springs = np.zeros((2, 2 * count, 2 * count))
                masses[:count, :count] = inertia
                for each, spring in enumerate(stiffness):
                    motor = count + each
                    masses[motor, motor] = rotors[each]
                    if spring < math.inf:
                        masses[each, each] -= rotors[each]
                        springs[each, each] += spring
                        springs[motor, motor] += spring
                        springs[each, motor] = springs[motor, each] = -spring
                motors = [each if spring == math.inf else count + each for each, spring in enumerate(stiffness)]
                kinds.append((cause, joint))
                systems.append(_system(cause, joint, motors[joint], masses, springs))
                outputs.append([2 * count + each for each in motors])
        rates, starts = (np.array(each) for each in zip(*systems, strict=True))
        step = _exponential(self._period_s * rates)
        state, motions = starts[..., None], []
        for _ in range(ONSETS.stop - 1):
            state = step @ state
            motions.append(state[..., 0])
        chosen = np.array(outputs)[:, None, :]
        return kinds, np.take_along_axis(np.array(motions).transpose(1, 0, 2), chosen, axis=2)

    def _covariance(self, off: Floats, time_s: Floats) -> Floats:
        """Of each joint's speeds without a failure: noise, a mean and an acceleration that nobody knows."""
        peaks = np.ptp(off, axis=0)
        noise2 = self._noise**2 + (OWN_ERROR * peaks) ** 2 + (CROSS_ERROR * peaks.max()) ** 2
        plain = np.eye(len(time_s))
        level, slope = np.full_like(plain, FREE_RAD_S**2), np.outer(time_s, time_s)
        covariance: Floats = noise2[:, None, None] * plain + level + self._doubt[:, None, None] ** 2 * slope
        return covariance

    def _bounds(
        self, mobility: Floats, speed: Floats, carried_nm: Floats
    ) -> Callable[[Cause, int], tuple[float, float]]:
        """Least and greatest size of a failure of a joint."""

        def bounds(cause: Cause, joint: int) -> tuple[float, float]:
            if cause is Cause.HIT:
                most = float(STRUCK_SPEEDS * self._fastest[joint] / mobility[joint, joint])
                return -most, most
            if cause is Cause.PUSHED:
                return -self._most_nm[joint], self._most_nm[joint]
            shares, of = {
                Cause.JAMMED: (JAMMED_SHARES, -speed),
                Cause.REVERSED: (REVERSED_SHARES, -np.ones_like(speed)),
            }.get(cause, ((0.0, MOST_SHARE), carried_nm))
            ends = [share * float(of[joint]) for share in shares]
            return min(ends), max(ends)

        return bounds

    def _of_tachometers(self, off: Floats, covariance: Floats) -> list[float]:
        """If one shows from some moment on what has nothing to do with its joint, or is off by a constant."""
        cycles, joints = off.shape
        since = (np.arange(cycles) >= cycles - np.array(ONSETS)[:, None]).astype(float)
        found = []
        for joint in range(joints):
            own, speeds = covariance[joint], off[:, joint]
            free2 = self._fastest[joint] ** 2
            freed = own + free2 * since[:, None, :] * np.eye(cycles)
            constant = own + free2 * since[:, None, :] * since[:, :, None]
            failed = np.concatenate((own[None], freed, constant))
            fits = (
                -0.5 * np.linalg.slogdet(failed)[1]
                - 0.5
                * np.linalg.solve(failed, np.broadcast_to(speeds[:, None], (len(failed), cycles, 1)))[..., 0]
                @ speeds
            )
            found.append(log_mean((fits[1:] - fits[0]).tolist()))
        return found


def _system(cause: Cause, joint: int, motor: int, masses: Floats, springs: Floats) -> tuple[Floats, Floats]:
    """Rates of the state (angles, speeds, one) and its start, of a failure of the size one; `motor`: its coordinate."""
    count = len(masses)
    if cause is Cause.JAMMED:
        masses = masses.copy()
        masses[joint, joint] += HELD_KG_M2
    mobility = np.linalg.inv(masses)
    rates, start = np.zeros((2 * count + 1, 2 * count + 1)), np.zeros(2 * count + 1)
    rates[:count, count : 2 * count] = np.eye(count)
    rates[count : 2 * count, :count] = -mobility @ springs
    start[-1] = 1.0
    if cause is Cause.HIT:
        start[count : 2 * count] = mobility[:, joint]
    elif cause is Cause.JAMMED:
        start[count : 2 * count] = mobility[:, joint] / mobility[joint, joint]
    else:
        torque_nm = np.zeros(count)
        torque_nm[motor if cause is not Cause.PUSHED else joint] += 1.0
        if cause is Cause.FREED or cause is Cause.SOFT:
            torque_nm[joint] -= 1.0
        rates[count : 2 * count, -1] = mobility @ torque_nm
    return rates, start


def _drive(motion: Floats, torque_nm: Floats, shape: Floats) -> None:
    """Put what a torque makes into `shape` (onsets, cycles, joints); `motion` is what it makes that stays one."""
    pulse = np.diff(motion, axis=0, prepend=np.zeros((1, motion.shape[1])))
    for since, rows in zip(ONSETS, shape, strict=True):
        for joint, answer in enumerate(pulse.T):
            rows[-since:, joint] = np.convolve(answer[:since], torque_nm[-since:])[:since]


def _exponential(rates: Floats) -> Floats:
    """Exponential of each of the matrices (any, n, n)."""
    part = rates / 2.0**SQUARINGS
    plain = np.eye(rates.shape[-1])
    result: Floats = plain + part @ (plain + part @ (plain + part @ (plain + part / 4.0) / 3.0) / 2.0)
    for _ in range(SQUARINGS):
        result = result @ result
    return result


def log_mean(logarithms: Sequence[float]) -> float:
    """Logarithm of the mean of what these are the logarithms of: all are equally likely beforehand."""
    most = max(logarithms)
    return most + math.log(sum([math.exp(each - most) for each in logarithms]) / len(logarithms))


def log_mean_likelihood(squares: float, product: float, low: float, high: float) -> float:
    """Logarithm of the mean of exp(a * product - a² * squares / 2) over a from `low` to `high`."""
    if squares <= 0.0 or high - low < 1e-9:
        middle = 0.5 * (low + high)
        return middle * product - 0.5 * middle * middle * squares
    root, best = math.sqrt(0.5 * squares), product / squares
    first, last = (low - best) * root, (high - best) * root
    if first + last < 0.0:
        first, last = -last, -first
    width = math.erfc(first) - math.erfc(last)
    if width > 1e-200:
        log_width = math.log(width)
    else:  # far in the tail
        log_width = -first * first - math.log(first * math.sqrt(math.pi))
    return 0.5 * product * best + log_width + math.log(0.5 * math.sqrt(math.pi) / root / (high - low))
