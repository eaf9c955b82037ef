"""A motion made for identification: every joint a Fourier series, chosen so that each parameter of the arm shows.

Owns the choice. After Swevers and others, "Optimal robot excitation and identification" (1997): periodic, of few
harmonics, within the limits of the joints; here the best conditioned of some drawn series, always the same ones.
"""

import contextlib
import random
from collections.abc import Sequence

import numpy as np

from canarm_protocol.cell.model import Cell

from ..dynamics.inertial_regressor import InertialRegressor
from ..errors import TrajectoryError
from .base import Bools, Trajectory
from .limits import Floats, Limits, Reference

PERIOD_S = 5.0
"""Half of a run of 10 s: what its first 2 s, in which it blends in, lack of the motion comes once more."""
HARMONICS = 5
"""Up to 1 Hz: well below what a loop of a few Hz follows, and fast enough for the inertias to show."""
DRAWS = 60
SAMPLES = 125
"""Times of a period at which a series is judged: 25 for the fastest harmonic."""
EXCITED = 1e-6
"""A singular value below this share of the largest is none: no motion shows that combination of parameters."""
MOST_OF_TRAVEL, MOST_OF_SPEED, MOST_OF_CURRENT = 0.35, 0.8, 0.6
"""The largest shares of the travel between the limits (either way of the centre), of the highest speed, and of the
amplifier's current by the nominal model: a robot that is half as heavy again still follows."""
SHRINKS = 30
"""How often a series is made smaller by a tenth until its current is allowed: to a twentieth at most."""


class Excite(Trajectory):
    """Each joint swings about a centre by a sum of sines and cosines of the harmonics of `PERIOD_S`.

    `sines` and `cosines` are (harmonics, joints), rad.
    """

    def __init__(self, limits: Limits, centre_rad: Floats, sines: Floats, cosines: Floats) -> None:
        self._centre_rad, self._sines, self._cosines = centre_rad, sines, cosines
        self._omega_rad_s = 2.0 * np.pi / PERIOD_S * np.arange(1, len(sines) + 1)
        swing = self._at(np.linspace(0.0, PERIOD_S, 4 * SAMPLES)).position_rad
        super().__init__(limits, tuple((0.5 * np.ptp(swing, axis=0)).tolist()))

    def scaled(self, factor: float) -> "Excite":
        """The same about the same centre, larger or smaller."""
        return Excite(self.limits, self._centre_rad, self._sines * factor, self._cosines * factor)

    def _at(self, time_s: Floats) -> Reference:
        omega = self._omega_rad_s
        phase = time_s[:, None] * omega
        sine, cosine = np.sin(phase), np.cos(phase)
        return Reference(
            self._centre_rad + sine @ self._sines + cosine @ self._cosines,
            (cosine * omega) @ self._sines - (sine * omega) @ self._cosines,
            -(sine * omega**2) @ self._sines - (cosine * omega**2) @ self._cosines,
        )

    def _is_steady(self, time_s: Floats) -> Bools:
        return np.zeros((len(time_s), len(self.amplitude_rad)), dtype=np.bool_)


def excite(cell: Cell, limits: Limits, centre_deg: Sequence[float], speed_rad_s: Sequence[float]) -> Trajectory:
    """The motion for `cell` about `centre_deg`, with no joint above its `speed_rad_s`.

    Raises `TrajectoryError` where the arm can hardly move, as when its amplifiers are at their limit in most poses.
    """
    centre = np.radians(np.asarray(centre_deg, dtype=np.float64))
    low, high = np.radians(np.asarray(limits.low_deg)), np.radians(np.asarray(limits.high_deg))
    room = np.minimum(MOST_OF_TRAVEL * (high - low), np.minimum(high - centre, centre - low) * 0.9)
    regressors = [(InertialRegressor(robot), own) for robot, own in zip(cell.robot, cell.blocks, strict=True)]
    chance = random.Random("excite")
    best: tuple[tuple[int, float], Excite] | None = None
    for _ in range(DRAWS):
        made = _drawn(limits, chance, centre, room, MOST_OF_SPEED * np.asarray(speed_rad_s))
        if made is not None:
            judged = max(judgement(made, regressor, own) for regressor, own in regressors)
            if best is None or judged < best[0]:
                best = judged, made
    made = None if best is None else best[1]
    for _ in range(SHRINKS if made is not None else 0):
        assert made is not None
        with contextlib.suppress(TrajectoryError):  # the supply may be too low for such speeds
            limits.check(made, PERIOD_S, "excite")
            return made
        made = made.scaled(0.9)
    raise TrajectoryError("excite: its amplifiers cannot move this arm about its home pose; take another motion")


def _drawn(limits: Limits, chance: random.Random, centre: Floats, room: Floats, speed_rad_s: Floats) -> Excite | None:
    """A series as large as position and speed allow, then smaller until the nominal current is allowed."""
    joints = len(centre)
    numbers = np.array([chance.gauss(0.0, 1.0) for _ in range(2 * HARMONICS * joints)]).reshape(2, HARMONICS, joints)
    sines, cosines = numbers / np.arange(1, HARMONICS + 1)[:, None]
    times_s = np.linspace(0.0, PERIOD_S, SAMPLES, endpoint=False)
    swing = Excite(limits, np.zeros(joints), sines, cosines)._at(times_s)
    scale = np.minimum(
        room / np.abs(swing.position_rad).max(axis=0), speed_rad_s / np.abs(swing.velocity_rad_s).max(axis=0)
    )
    most_a = MOST_OF_CURRENT * np.asarray(limits.current_a)
    for _ in range(SHRINKS):
        made = Excite(limits, centre, sines * scale, cosines * scale)
        if limits.arm is None:
            return made
        at = made._at(times_s)
        torque_nm = limits.arm.torque_batch_nm(at.position_rad, at.velocity_rad_s, at.acceleration_rad_s2)
        if np.all(np.abs(torque_nm / np.asarray(limits.arm.torque_per_ampere)) <= most_a):
            return made
        scale *= 0.9
    return None


def judgement(made: Trajectory, regressor: InertialRegressor, own: slice = slice(None)) -> tuple[int, float]:
    """How many combinations of parameters a motion of the joints `own` does not show, and the condition number of the
    others: largest over smallest singular value of the regressor, its columns scaled to one length. Less is better.
    """
    at = made.sample(0, SAMPLES, PERIOD_S / SAMPLES)
    rows = regressor.rows(at.position_rad[:, own], at.velocity_rad_s[:, own], at.acceleration_rad_s2[:, own])
    stacked = rows.reshape(-1, rows.shape[-1])
    lengths = np.linalg.norm(stacked, axis=0)
    scaled = stacked / np.where(lengths > 0.0, lengths, 1.0)
    # From the eigenvalues of the small square: ten times as fast, and a motion is judged sixty times.
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(scaled.T @ scaled), 0.0))
    shown = singular[singular > EXCITED * singular[-1]]
    return len(singular) - len(shown), float(shown[-1] / shown[0])
