"""How an arm has moved and which currents its motors had, from what was measured: smooth, and all at one time.

Owns filters and times of samples. The truth of a run never enters, nor does the arm's model.

Angles come from the integrated tachometer, which is finer, and the position sensor, which does not drift. Values
between the samples are those of cubics fitted around them (Savitzky and Golay, 1964): a low-pass without delay, which
leaves motions below 3 Hz as they are, to 0.1 %.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from canarm_protocol.cell.model import Cell
from canarm_protocol.cell.sensing import JointSensors, WiredSensor, joint_sensors
from canarm_protocol.cell.sensors.base import AnalogueSensor

from ..usage import UsageError

Floats = NDArray[np.float64]
CUBIC, QUINTIC = 3, 5
SMOOTHED_S = 0.04
"""Half the length over which cubics are fitted to speeds and currents."""
LONGER = 2
"""A joint without a tachometer: its angles are differentiated twice, over stretches that are longer by this. Quintics
do that: a cubic's second derivative is 1.8 % too small at 1 Hz.
"""
DRIFT_S = 5.0
"""What the integrated tachometer drifts is a polynomial of one degree for each such stretch of the run."""
MOST_DEGREES = 60
LEAST_S = 3.0
"""A shorter run is refused."""


@dataclass(frozen=True)
class Motion:
    """Angles in rad, speeds, accelerations, and motor currents in A at times `step_s` apart, each (samples, joints).

    `speed_noise_rad_s` is what a speed may be off by: below it, its sign means nothing.
    """

    step_s: float
    angle_rad: Floats
    speed_rad_s: Floats
    acceleration_rad_s2: Floats
    current_a: Floats
    speed_noise_rad_s: Floats


def motion_of(cell: Cell, columns: Mapping[str, Floats]) -> Motion:
    """The motion of all joints of `cell`, from the columns of `controller.csv`.

    The longest stretch without a missing cycle is taken. Raises `UsageError` for a table that lacks a column, and for a
    run that is too short.
    """
    step_s, rows = cell.bus.cycle_s, _longest(columns)
    if rows.stop - rows.start < LEAST_S / step_s:
        whole_s = (rows.stop - rows.start) * step_s
        raise UsageError(f"{whole_s:.2f} s without a gap are recorded; must be {LEAST_S:g} s at least, better 10 s")
    names = ("measured_rad", "measured_rad_s", "measured_a", "command_a")
    found = []
    for joint, (name, sensors) in enumerate(zip(cell.joint_names, joint_sensors(cell), strict=True)):
        missing = [each for each in names if f"{name}.{each}" not in columns]
        if missing:
            raise UsageError(f"controller.csv has no column {name}.{missing[0]}")
        own = {each: columns[f"{name}.{each}"][rows] for each in names}
        for each, values in own.items():
            if not np.isfinite(values).all():
                raise UsageError(f"controller.csv: {name}.{each} has a value that is no finite number")
        motor = cell.joints[joint].motor
        lag_s = motor.winding_mh * 1e-3 / motor.winding_ohm
        found.append((*_moved(sensors, own, step_s), _current(sensors, own, step_s, lag_s)))
    cut = round(LONGER * SMOOTHED_S / step_s)
    angle, speed, acceleration, noise, current = zip(*found, strict=True)
    angles, speeds, accelerations, currents = (
        np.column_stack(each)[cut:-cut] for each in (angle, speed, acceleration, current)
    )
    return Motion(step_s, angles, speeds, accelerations, currents, np.array(noise))


def disturbed(cell: Cell, columns: Mapping[str, Floats], chance: np.random.Generator) -> dict[str, Floats]:
    """The same columns once more disturbed by as much as the cell's sensors do: their noise and rounding."""
    found = dict(columns)
    for name, sensors in zip(cell.joint_names, joint_sensors(cell), strict=True):
        parts = {"measured_rad": sensors.position, "measured_rad_s": sensors.velocity, "measured_a": sensors.current}
        for column, wired in parts.items():
            if wired is not None:
                values = columns[f"{name}.{column}"]
                found[f"{name}.{column}"] = values + _noise(wired) * chance.standard_normal(len(values))
    return found


def _noise(wired: WiredSensor) -> float:
    """Standard deviation of a sample: noise and rounding."""
    noise_lsb = wired.sensor.noise_lsb if isinstance(wired.sensor, AnalogueSensor) else 0.0
    return wired.scale.lsb * math.sqrt(noise_lsb**2 + 1.0 / 12.0)


def _longest(columns: Mapping[str, Floats]) -> slice:
    cycles = columns.get("cycle", np.empty(0))
    breaks = np.flatnonzero(np.diff(cycles) != 1.0) + 1
    ends = [0, *breaks.tolist(), len(cycles)]
    begin, end = max(pairwise(ends), key=lambda pair: pair[1] - pair[0])
    return slice(begin, end)


def _moved(sensors: JointSensors, own: Mapping[str, Floats], step_s: float) -> tuple[Floats, Floats, Floats, float]:
    """Angle, speed and acceleration of a joint at the times of SYNC, and the noise of its speed."""
    measured = own["measured_rad"]
    if sensors.velocity is None:
        half = round(LONGER * SMOOTHED_S / step_s)
        angle, speed, acceleration = (fitted(measured, half, step_s, 0.0, order, QUINTIC) for order in range(3))
        return angle, speed, acceleration, _noise(sensors.position) * _gain(half, step_s, 1, QUINTIC)
    half, skew_s = round(SMOOTHED_S / step_s), sensors.velocity.skew_s
    speeds = own["measured_rad_s"]
    speed, acceleration = (fitted(speeds, half, step_s, -skew_s, order) for order in range(2))
    travelled = np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * step_s)))
    angle = travelled + _drift(measured - travelled, step_s)
    return angle, speed, acceleration, _noise(sensors.velocity) * _gain(half, step_s, 0)


def _current(sensors: JointSensors, own: Mapping[str, Floats], step_s: float, lag_s: float) -> Floats:
    """The motor's current at the times of SYNC, A.

    A command changes at SYNC and stands for a cycle; the current follows it within the winding's time constant. The
    sense's sample comes while it does, and stands for a time that is later than its own.
    """
    half = round(SMOOTHED_S / step_s)
    middle_s = 0.5 * step_s + lag_s
    if sensors.current is None:
        return fitted(own["command_a"], half, step_s, -(step_s + middle_s), 0)
    stands_for_s = middle_s - step_s * math.exp(-sensors.current.skew_s / lag_s)
    return fitted(own["measured_a"], half, step_s, -stands_for_s, 0)


def _drift(off: Floats, step_s: float) -> Floats:
    """What is left between an angle and the integrated speed: an offset, and what the tachometer's own offset makes."""
    times = np.linspace(-1.0, 1.0, len(off))
    degree = min(1 + int(len(off) * step_s / DRIFT_S), MOST_DEGREES)
    basis = np.polynomial.chebyshev.chebvander(times, degree)
    return np.asarray(basis @ np.linalg.lstsq(basis, off, rcond=None)[0], dtype=np.float64)


def fitted(values: Floats, half: int, step_s: float, at_s: float, order: int, degree: int = CUBIC) -> Floats:
    """A derivative (0: the value) of the polynomial fitted to `half` samples either side of each, `at_s` after it.

    At the ends, where these samples are not there, it means nothing.
    """
    weights = _weights(half, round(at_s / step_s, 9), order, degree) / step_s**order
    return np.convolve(np.pad(values, half, mode="edge"), weights[::-1], mode="valid")


def _gain(half: int, step_s: float, order: int, degree: int = CUBIC) -> float:
    """By what white noise of a sample grows or shrinks in `fitted`."""
    return float(np.linalg.norm(_weights(half, 0.0, order, degree))) / step_s**order


@lru_cache(maxsize=64)
def _weights(half: int, at: float, order: int, degree: int) -> Floats:
    """Weights of the samples -half … half, in steps."""
    places = np.arange(-half, half + 1) / half
    basis = np.vander(places, degree + 1, increasing=True)
    powers = np.array([_derivative(power, at / half, order) for power in range(degree + 1)])
    return np.asarray(powers @ np.linalg.pinv(basis) / half**order, dtype=np.float64)


def _derivative(power: int, at: float, order: int) -> float:
    if power < order:
        return 0.0
    return math.perm(power, order) * at ** (power - order)
