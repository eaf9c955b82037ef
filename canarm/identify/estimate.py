"""Weighted least squares on the regressor: values, their confidence intervals, and what the motion does not show.

Regressor and currents pass the same filter, so that they stay each other's match whatever it does to them. Joints are
weighted by what is left over at each. Rows of a joint that turns round are left out: it sticks then, and its friction
may be anything; counted in, they pass for 0.5 % of inertia and 1 % of friction.

What is left over is not white (the filter, steps of sensors, drift of angles): the covariance is that of Newey and West
(1987), and its quantile that of Kiefer and Vogelsang (2005), who reckon with how few lags it is made of.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .motion import Floats, Motion
from .physical import ArmPrediction, Parameter

FILTER_S = 0.05
"""Standard deviation in time of the filter that both sides pass: 3 dB at 2.6 Hz."""
EVERY_S = 0.05
"""Time between the rows that are used: the filter leaves nothing in between."""
SLOW = 20.0
"""A joint hardly moves below so many times the noise of its speed."""
MOST_SLOW = 0.02
"""Largest share of a row's time in which that may be so."""
LAGS_S = 1.0
"""Over so long what is left over may be alike: a period of the fastest motion."""
ROUNDS = 8
QUANTILE = (1.96, 2.9694, 0.4160, -0.5324)
"""The two-sided 95 % quantile as a polynomial of the share of lags: Kiefer and Vogelsang (2005), table 1, Bartlett."""
UNSEEN = 1e-7
"""A combination of parameters that changes the currents by less than this share of what others do is not seen."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter: its value, and half of its 95 % interval; `is_seen` is false where the motion says nothing of it.

    `alike` is the parameter from which it can hardly be told apart, and their correlation.
    """

    parameter: Parameter
    value: float
    half: float
    is_seen: bool
    alike: tuple[str, float] | None


@dataclass(frozen=True)
class Identified:
    """The parameters of a robot, the condition number of what was solved, and the RMS of what is left over, A."""

    estimates: tuple[Estimate, ...]
    condition: float
    left_over_a: tuple[float, ...]


def identify(arm: ArmPrediction, motion: Motion, start: Floats | None = None, rounds: int = ROUNDS) -> Identified:
    """The values of `arm.parameters` that fit `motion` best, looked for from `start` or from those of the cell.

    `motion` has the joints of this robot only. Raises `numpy.linalg.LinAlgError` for values that are not finite.
    """
    every = max(round(EVERY_S / motion.step_s), 1)
    kernel = _kernel(motion.step_s)
    rows = arm.rows(motion.angle_rad, motion.speed_rad_s, motion.acceleration_rad_s2)
    rows, current = _filtered(rows, kernel, every), _filtered(motion.current_a, kernel, every)
    is_slow = np.abs(motion.speed_rad_s) < SLOW * motion.speed_noise_rad_s
    used = _filtered(is_slow.astype(np.float64), kernel, every) <= MOST_SLOW
    scale = np.array([parameter.scale for parameter in arm.parameters])
    values = np.array([parameter.nominal for parameter in arm.parameters]) if start is None else start
    weight = np.ones(current.shape[1])
    for _ in range(rounds):
        left = np.where(used, current - arm.currents(rows, values), 0.0)
        jacobian = np.where(used[:, :, None], arm.jacobian(rows, values), 0.0) * scale
        weighted = jacobian * weight[:, None]
        solve = _solver(weighted.reshape(-1, len(scale)))
        values = values + scale * (solve.inverse @ (left * weight).reshape(-1))
        left = np.where(used, current - arm.currents(rows, values), 0.0)
        spread = np.sqrt((left**2).sum(axis=0) / np.maximum(used.sum(axis=0), 1))
        weight = 1.0 / np.maximum(spread, 1e-9 + 1e-3 * spread.max())
    lags = min(round(LAGS_S / (every * motion.step_s)), len(left) // 2)
    covariance = _covariance(weighted, left * weight, solve.inverse, lags)
    half = quantile((lags + 1.0) / len(left)) * np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
    return Identified(_estimates(arm.parameters, values, half, solve), solve.condition, tuple(spread.tolist()))


def at_least(found: Identified, deviation: Floats) -> Identified:
    """The same with intervals no narrower than those of a normal distribution with this `deviation` of each value."""
    wider = [
        replace(each, half=max(each.half, QUANTILE[0] * least)) if each.is_seen else each
        for each, least in zip(found.estimates, deviation.tolist(), strict=True)
    ]
    return replace(found, estimates=tuple(wider))


def quantile(share: float) -> float:
    """By how many standard errors 95 % lie around the value, if the lags are that `share` of the rows."""
    return sum(factor * share**power for power, factor in enumerate(QUANTILE))


@dataclass(frozen=True)
class _Solver:
    """The pseudo-inverse of a matrix, its condition number, and which columns it says nothing of."""

    inverse: Floats
    condition: float
    unseen: tuple[bool, ...]


def _solver(matrix: Floats) -> _Solver:
    """Columns are scaled to one length first; what is below `UNSEEN` stays as it is."""
    lengths = np.linalg.norm(matrix, axis=0)
    lengths = np.where(lengths > UNSEEN * max(lengths.max(), 1e-300), lengths, np.inf)
    left, singular, right = np.linalg.svd(matrix / lengths, full_matrices=False)
    is_seen = singular > UNSEEN * singular[0]
    inverse = (right[is_seen].T / singular[is_seen]) @ left[:, is_seen].T / lengths[:, None]
    blind = (right[~is_seen] ** 2).sum(axis=0) > UNSEEN
    condition = float(singular[0] / singular[-1]) if is_seen.all() else math.inf
    return _Solver(inverse, condition, tuple((blind | ~np.isfinite(lengths)).tolist()))


def _covariance(jacobian: Floats, left: Floats, inverse: Floats, lags: int) -> Floats:
    """Newey and West's covariance of the scaled values.

    `jacobian` is (rows, joints, parameters), `left` (rows, joints); both are weighted. `inverse` is the pseudo-inverse
    of the stacked Jacobian.
    """
    scores = np.einsum("tjp,tj->tp", jacobian, left)
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        both = scores[lag:].T @ scores[:-lag]
        middle = middle + (1.0 - lag / (lags + 1.0)) * (both + both.T)
    normal = inverse @ inverse.T
    return np.asarray(normal @ middle @ normal, dtype=np.float64)


def _estimates(parameters: Sequence[Parameter], values: Floats, half: Floats, solve: _Solver) -> tuple[Estimate, ...]:
    normal = solve.inverse @ solve.inverse.T
    spread = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    correlation = normal / np.outer(spread, spread)
    found = []
    for place, parameter in enumerate(parameters):
        is_seen = not solve.unseen[place]
        others = np.where(np.arange(len(parameters)) == place, 0.0, correlation[place])
        other = int(np.argmax(np.abs(others)))
        alike = (parameters[other].name, float(others[other])) if len(parameters) > 1 else None
        found.append(
            Estimate(parameter, float(values[place]), float(half[place]) if is_seen else math.inf, is_seen, alike)
        )
    return tuple(found)


def _kernel(step_s: float) -> Floats:
    half = math.ceil(3.0 * FILTER_S / step_s)
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) * step_s / FILTER_S) ** 2)
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _filtered(values: Floats, kernel: Floats, every: int) -> Floats:
    """Low-passed along the first axis where the whole kernel fits, then thinned out."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, len(kernel), axis=0)[::every] @ kernel)
