"""What the ablation runs: laws with terms switched on and off, robots that differ from their model, and the figures.

Owns the grid and its running; `ablation_page` interprets and shows the figures.
"""

import itertools
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from canarm import Rig
from canarm.rig.rig import RigJoint
from canarm.usage import UsageError
from canarm_controller.laws.mras import HIGHEST, LOWEST
from canarm_controller.run.state import State
from canarm_controller.supervision.detection import DETECTORS

SECONDS = 10.24
"""One period of the table: 4096 cycles; every figure leaves out the first 1024."""
SETTLING_S = 2.56
SEEDS = (0, 1, 2)
TRAJECTORIES = ("sine", "trapezoid")

Truth = Mapping[str, float]
Settings = Mapping[str, float | str]

NOMINAL, HEAVY = "payload right", "payload +50 %"
TRUTHS: dict[str, Truth] = {
    "payload −50 %": {"joint3.mass": 0.3},
    NOMINAL: {},
    HEAVY: {"joint3.mass": 0.9},
    "friction × 0.7": {"joint2.coulomb": 0.105, "joint3.coulomb": 0.042},
    "friction × 1.3": {"joint2.coulomb": 0.195, "joint3.coulomb": 0.078},
    "elastic wire": {"joint2.wire": 1, "joint3.wire": 1},
}
"""The true robot, by name. Nominal on konkuk1: joint3.mass 0.6 kg, Coulomb friction 0.15 and 0.06 N·m, rigid wire."""


@dataclass(frozen=True)
class Variant:
    """A law with its feed-forward (None: the law's own choice) and changed gains."""

    label: str
    law: str
    feedforward: str | None = None
    settings: Settings = field(default_factory=dict)


@dataclass(frozen=True)
class Tracking:
    """Figures of one run, of the worst joint; NaN if the run was stopped or has no such figure."""

    rms_lsb: float
    max_lsb: float
    peak_current_a: float
    speed_ripple: float


@dataclass(frozen=True)
class Rest:
    """Figures of a robot holding still, of the worst joint; the first two are shares of all cycles."""

    changes: float
    reversals: float
    moved_lsb: float


@dataclass(frozen=True)
class Adaptation:
    """Figures of one point of the sweep; `at_limit` is the share of time in which an α is at its projection limit."""

    rms_lsb: float
    at_limit: float


@dataclass(frozen=True)
class Results:
    """All results for the page. The inner tuples have one entry per seed."""

    tracking: Mapping[tuple[str, str, str], tuple[Tracking, ...]]
    """By variant, truth and trajectory."""
    rest: Mapping[tuple[str, str], tuple[Rest, ...]]
    """By variant and pose."""
    sweep: Mapping[tuple["Sweep", float], Adaptation]
    """By curve and `gamma_alpha`."""


_MRAS, _LYAPUNOV, _SLOTINE_LI = "control.mras.", "control.mras_lyapunov.", "control.slotine_li."
_NO_ALPHA_BETA = {_MRAS + "gamma_alpha": 0.0, _MRAS + "gamma_beta": 0.0}
_NO_GAMMA_1_2 = {_LYAPUNOV + "gamma_position": 0.0, _LYAPUNOV + "gamma_velocity": 0.0}
_NO_OBSERVER = {"control.observer.enabled": "false"}
_STIFF = {"control.natural_frequency_rad_s": 31.6, "control.damping_ratio": 1.03}
"""The error of `slotine-li` obeys s² + (κ + Λ)s + κΛ; with κ = 40 and Λ = 25 that is ωn = √1000 and 2ζωn = 65."""
_SOFT = {_SLOTINE_LI + "error_rate_rad_s": 12.0, _SLOTINE_LI + "sliding_rate_rad_s": 12.0}
"""Conversely, κ = Λ = 12 is the ωn = 12, ζ = 1 of the other laws."""
_NO_HOLD = {"control.standing_band_rad": 0.0}

VARIANTS = (
    Variant("pd, no feed-forward", "pd", "none"),
    Variant("pd + table", "pd", "table"),
    Variant("pd + on-line feed-forward", "pd", "online"),
    Variant("pd + table, stiff", "pd", "table", _STIFF),
    Variant("computed-torque", "computed-torque"),
    Variant("computed-torque, no observer", "computed-torque", None, _NO_OBSERVER),
    Variant("computed-torque, stiff", "computed-torque", None, _STIFF),
    Variant("mras", "mras"),
    Variant("mras, bias alone", "mras", None, _NO_ALPHA_BETA),
    Variant("mras, α and β alone", "mras", None, {_MRAS + "gamma_bias": 0.0}),
    Variant("mras, neither", "mras", None, {**_NO_ALPHA_BETA, _MRAS + "gamma_bias": 0.0}),
    Variant("mras, γ3 = 60", "mras", None, {_MRAS + "gamma_bias": 60.0}),
    Variant("mras, on-line feed-forward", "mras", "online"),
    Variant("mras, no feed-forward", "mras", "none"),
    Variant("mras-lyapunov", "mras-lyapunov"),
    Variant("mras-lyapunov, bias alone", "mras-lyapunov", None, _NO_GAMMA_1_2),
    Variant("mras-lyapunov, γ1 and γ2 alone", "mras-lyapunov", None, {_LYAPUNOV + "gamma_bias": 0.0}),
    Variant("mras-lyapunov, neither", "mras-lyapunov", None, {**_NO_GAMMA_1_2, _LYAPUNOV + "gamma_bias": 0.0}),
    Variant("mras-lyapunov, γ3 = 20", "mras-lyapunov", None, {_LYAPUNOV + "gamma_bias": 20.0}),
    Variant("mras-lyapunov, no observer", "mras-lyapunov", None, _NO_OBSERVER),
    Variant("mras-lyapunov, no feed-forward", "mras-lyapunov", "none"),
    Variant("slotine-li", "slotine-li"),
    Variant("slotine-li, no adaptation", "slotine-li", None, {_SLOTINE_LI + "adaptation": 0.0}),
    Variant("slotine-li, no observer", "slotine-li", None, _NO_OBSERVER),
    Variant("slotine-li, neither", "slotine-li", None, {_SLOTINE_LI + "adaptation": 0.0, **_NO_OBSERVER}),
    Variant("slotine-li, soft", "slotine-li", None, _SOFT),
)

RESTING = (
    Variant("pd + table", "pd", "table"),
    Variant("computed-torque", "computed-torque"),
    Variant("computed-torque, not held", "computed-torque", None, _NO_HOLD),
    Variant("mras", "mras"),
    Variant("mras-lyapunov", "mras-lyapunov"),
    Variant("mras-lyapunov, not held", "mras-lyapunov", None, _NO_HOLD),
    Variant("slotine-li", "slotine-li"),
    Variant("slotine-li, not held", "slotine-li", None, _NO_HOLD),
)
POSES_DEG: dict[str, tuple[float, float]] = {"parked at 20°, 0°": (20.0, 0.0), "hanging at −90°, 0°": (-90.0, 0.0)}


@dataclass(frozen=True)
class Sweep:
    """A curve of the sweep over `gamma_alpha`: amplitude of the sine, robot, and whether the bias term is on."""

    amplitude: float
    truth: str
    has_bias: bool


GAMMAS_ALPHA = (0.005, 0.01, 0.02, 0.035, 0.05, 0.1, 0.2, 0.35, 0.5)
SWEEPS = tuple(
    Sweep(amplitude, truth, has_bias)
    for amplitude, truth in ((0.3, HEAVY), (0.6, HEAVY), (1.0, HEAVY), (1.0, NOMINAL))
    for has_bias in (False, True)
)
_SAMPLE_S = 0.02
"""How often the sweep samples α, which takes tenths of a second from limit to limit."""


def seeds_of(truth: str) -> tuple[int, ...]:
    """Payloads get all seeds; friction and wire one, to save time."""
    return SEEDS if truth.startswith("payload") else SEEDS[:1]


def run_all(
    folder: Path,
    executor: Executor | None = None,
    *,
    variants: Sequence[Variant] = VARIANTS,
    truths: Sequence[str] = tuple(TRUTHS),
    resting: Sequence[Variant] = RESTING,
    sweeps: Sequence[Sweep] = SWEEPS,
    gammas: Sequence[float] = GAMMAS_ALPHA,
    seconds: float = SECONDS,
) -> Results:
    """Run the grid, by default all of it. Trajectory files are written to `folder`."""
    apply: Callable[..., Iterable[Any]] = map if executor is None else partial(executor.map, chunksize=8)
    cells = list(itertools.product(variants, truths, TRAJECTORIES))
    tracked = [(v, TRUTHS[truth], path, seed, seconds) for v, truth, path in cells for seed in seeds_of(truth)]
    still = list(itertools.product(resting, POSES_DEG))
    held = [(v, POSES_DEG[pose], rest_csv(folder, POSES_DEG[pose]), s, seconds) for v, pose in still for s in SEEDS]
    points = list(itertools.product(sweeps, gammas))
    swept = [(sweep, gamma, sine_csv(folder, sweep.amplitude), seconds) for sweep, gamma in points]

    tracking = iter(apply(track, *zip(*tracked, strict=True)))
    rest = iter(apply(hold, *zip(*held, strict=True)))
    adaptation = apply(adapt, *zip(*swept, strict=True))
    return Results(
        {(v.label, truth, path): tuple(itertools.islice(tracking, len(seeds_of(truth)))) for v, truth, path in cells},
        {(v.label, pose): tuple(itertools.islice(rest, len(SEEDS))) for v, pose in still},
        dict(zip(points, adaptation, strict=True)),
    )


def track(variant: Variant, truth: Truth, trajectory: str, seed: int, seconds: float) -> Tracking:
    """One run along a trajectory."""
    with _rig(variant, truth, trajectory, seed) as rig:
        rig.run(seconds)
    if rig.state is not State.DONE:
        return Tracking(math.nan, math.nan, math.nan, math.nan)
    return Tracking(
        _worst(rig, lambda joint: joint.rms_error_lsb),
        _worst(rig, lambda joint: joint.max_error_lsb),
        _worst(rig, lambda joint: joint.peak_current_a),
        _worst(rig, lambda joint: joint.speed_ripple),
    )


def hold(variant: Variant, pose_deg: Sequence[float], trajectory: str, seed: int, seconds: float) -> Rest:
    """One run in which the reference stays where the arm was parked."""
    parked = dict(zip(("joint2.initial_deg", "joint3.initial_deg"), pose_deg, strict=True))
    with _rig(variant, parked, trajectory, seed) as rig:
        rig.run(seconds)
    if rig.state is not State.DONE:
        return Rest(math.nan, math.nan, math.nan)
    settled = slice(round(SETTLING_S / rig.cell.bus.cycle_s), None)
    lsb_rad = math.radians(rig.cell.joints[0].sensors.potentiometer.range_deg / 255)
    return Rest(
        _worst(rig, lambda joint: float(np.mean(np.diff(joint.command_a[settled]) != 0.0))),
        _worst(rig, lambda joint: float(np.mean(np.diff(np.signbit(joint.command_a[settled]))))),
        _worst(rig, lambda joint: float(np.std(joint.true_angle_rad[settled])) / lsb_rad),
    )


def adapt(sweep: Sweep, gamma_alpha: float, trajectory: str, seconds: float) -> Adaptation:
    """One run of `mras` with another `gamma_alpha` and without `gamma_beta`."""
    settings: dict[str, float | str] = {_MRAS + "gamma_alpha": gamma_alpha, _MRAS + "gamma_beta": 0.0}
    if not sweep.has_bias:
        settings[_MRAS + "gamma_bias"] = 0.0
    at_limit = []
    with _rig(Variant("sweep", "mras", None, settings), TRUTHS[sweep.truth], trajectory, SEEDS[0]) as rig:
        nominal = 1.0 / rig.cell.control.natural_frequency_rad_s**2
        rig.run(SETTLING_S)
        for _ in range(round((seconds - SETTLING_S) / _SAMPLE_S)):
            rig.run(_SAMPLE_S)
            alphas = rig.controller.loop.internals()["alpha"]
            inside = (1.001 * LOWEST < alpha / nominal < 0.999 * HIGHEST for alpha in alphas)
            at_limit.append(not all(inside))
    if rig.state is not State.DONE:
        return Adaptation(math.nan, math.nan)
    return Adaptation(_worst(rig, lambda joint: joint.rms_error_lsb), statistics.fmean(at_limit))


def rest_csv(folder: Path, pose_deg: Sequence[float]) -> str:
    """A trajectory that stays at `pose_deg`, as a file for `--trajectory`."""
    path = folder / f"rest{pose_deg[0]:+g}{pose_deg[1]:+g}.csv"
    rows = [f"{time_s},{pose_deg[0]},{pose_deg[1]}\n" for time_s in (0, 20)]
    path.write_text("time_s,joint2,joint3\n" + "".join(rows))
    return str(path)


def sine_csv(folder: Path, amplitude: float) -> str:
    """The built-in sine with another amplitude, as a file for `--trajectory`; 1.5 s from rest and to rest."""
    path = folder / f"sine{amplitude:g}.csv"
    rows = ["time_s,joint2,joint3\n"]
    steps = round(2 * SECONDS / 0.02)
    for step in range(steps + 1):
        time_s = 0.02 * step
        x = min(time_s / 1.5, 0.02 * (steps - step) / 1.5, 1.0)
        swing = amplitude * x**3 * (10.0 + x * (6.0 * x - 15.0))
        joint2 = 20.0 + 35.0 * swing * math.sin(2.0 * math.pi * time_s / 2.56)
        joint3 = 30.0 * swing * math.sin(2.0 * math.pi * time_s / 1.7)
        rows.append(f"{time_s:.2f},{joint2:.6f},{joint3:.6f}\n")
    path.write_text("".join(rows))
    return str(path)


def _rig(variant: Variant, truth: Truth, trajectory: str, seed: int) -> Rig:
    """A rig without supervision, so that a law's worst behaviour is seen to the end."""
    rig = Rig(
        law=variant.law,
        trajectory=trajectory,
        feedforward=variant.feedforward,
        seed=seed,
        truth=dict(truth),
        settings=dict(variant.settings),
    )
    rig.controller.without = DETECTORS.keys()
    return rig


def _worst(rig: Rig, figure: Callable[[RigJoint], float]) -> float:
    """The worst figure of all joints; NaN if the run was too short, or had no stretch of constant speed."""
    try:
        return max(figure(joint) for joint in rig.joints.values())
    except UsageError:
        return math.nan
