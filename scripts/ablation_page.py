"""The ablation page: tables of the results of `ablation_runs`, and the findings with their figures.

Owns text and layout. Nothing is run here, and no figure is written by hand.
"""

import importlib.metadata
import math
import platform
import re
import statistics
import textwrap
from collections.abc import Callable, Iterable, Sequence

from ablation_findings import Finding, Reader, findings, percent
from ablation_runs import GAMMAS_ALPHA, HEAVY, NOMINAL, TRAJECTORIES, Rest, Results, Sweep, Tracking

from canarm.line_plot import Axis, Curve, Panel, draw

PACKAGES = ("canarm", "mujoco", "numpy")
PAYLOAD_PICTURE, SWEEP_PICTURE = "ablation-payload.svg", "ablation-divergence.svg"
DRAWN = ("pd + table", "computed-torque", "mras, α and β alone", "mras, bias alone", "mras", "slotine-li")
"""The curves of the payload picture: the most telling ones."""

PAGE = """\
# What each term of the control laws is worth

Every law of the house with its terms switched on and off, on robots that are not what their model says. This
page is written by `make ablation`; no figure in it is written by hand, and the command ends with an error
when a sentence below no longer fits the figures.

- A run is 10.24 s in lockstep, 4096 cycles; the first 1024 are left out. Figures are those of the worse
  joint. Errors are true minus reference angle in LSB, steps of the 8-bit potentiometer: 1.06°.
- Payloads: median of the seeds 0, 1 and 2, which differ by up to {spread} LSB. Friction and wire: seed 0.
- A payload of ±50 % is a true `joint3.mass` of 0.3 or 0.9 kg where every law believes in 0.6 kg. Friction ×
  0.7 and × 1.3 is Coulomb friction of both joints; the elastic wire is `joint2.wire` and `joint3.wire`.
  Nothing else is wrong.
- Gains are the cell's, except for what a row says. "bias alone" is `gamma_alpha` = `gamma_beta` = 0 in
  `control.mras` and `gamma_position` = `gamma_velocity` = 0 (γ1, γ2) in `control.mras_lyapunov`; "α and β
  alone" and "γ1 and γ2 alone" are `gamma_bias` = 0 (γ3); "neither" is both, for `slotine-li` `adaptation` = 0
  without the observer. "stiff" is ωn = 31.6 rad/s and ζ = 1.03, the poles of `slotine-li`; "soft" gives
  `slotine-li` the poles of the others, ωn = 12 rad/s.
- {versions}.

## Findings

{findings}

## RMS error on the sine, LSB

{sine}

## RMS error on the trapezoid, LSB

{trapezoid}

![RMS error against payload](pictures/{payload_picture})

## Maximum, current and ripple

Ripple, the paper's own claim, is the standard deviation of the true joint speed over its mean where the
trapezoid's speed is constant.

{others}

## At rest

The reference stays where the arm is parked. Shares are of all cycles: in how many the command changes, and in
how many it changes sign, which turns the bridge over. Moved: standard deviation of the true angle. "not held"
is `standing_band_rad` = 0. Median of the seeds 0, 1 and 2.

{rest}

## How far γα can go

`mras` on the sine, its `gamma_alpha` varied, `gamma_beta` = 0 so that α is alone; seed 0. The amplitude is
that of the built-in sine times a factor, by way of a CSV file. The law divides `gamma_alpha` by the square of
the amplitude A, so the axis is γα·A² in the terms of Dubowsky and DesForges.

![RMS error and share of time at the limit against gamma_alpha](pictures/{sweep_picture})

No error grows without bound here, because α is projected into [0.35, 3] times its nominal value, and no
setting takes the projection away: the bounds are constants of the law. What diverges without it shows as α
lying on a bound; the lower half of the picture and the table give the share of time in which one joint's α
does.

{sweep}
"""

Show = Callable[[float], str]
Cell = Callable[[str], str]
Column = tuple[str, Cell]


def page(results: Results) -> str:
    """The whole page, Markdown."""
    read = Reader(results)
    labels = list(dict.fromkeys(label for label, _, _ in results.tracking))
    truths = list(dict.fromkeys(truth for _, truth, _ in results.tracking))

    def rms(truth: str, path: str) -> Cell:
        return lambda row: number(read.rms(row, truth, path))

    by_path = {path: _table("law", labels, [(truth, rms(truth, path)) for truth in truths]) for path in TRAJECTORIES}
    return PAGE.format(
        spread=number(read.spread()),
        versions=_versions(),
        findings="\n".join(_item(place, finding.text) for place, finding in enumerate(findings(read), 1)),
        others=_table("law", labels, _other_columns(read)),
        rest=_rest_table(results),
        sweep=_sweep_table(results),
        payload_picture=PAYLOAD_PICTURE,
        sweep_picture=SWEEP_PICTURE,
        **by_path,
    )


def misfits(results: Results) -> list[Finding]:
    """Findings that the figures do not support: their text in `ablation_findings` must be rewritten."""
    return [finding for finding in findings(Reader(results)) if not finding.holds]


def skeleton(text: str) -> str:
    """`text` without numbers and line breaks: equal for two runs with the same findings."""
    return " ".join(re.sub(r"[−+-]?\d+(\.\d+)*", "#", text).split())


def number(value: float) -> str:
    """A number with at most three significant digits; a dash for a run that was stopped."""
    if math.isnan(value):
        return "stopped"
    return f"{value:.2f}" if abs(value) < 9.995 else f"{value:.1f}"


def pictures(results: Results) -> dict[str, str]:
    """File name and SVG text of each picture."""
    return {PAYLOAD_PICTURE: _payload_picture(results), SWEEP_PICTURE: _sweep_picture(results)}


def _item(place: int, text: str) -> str:
    return textwrap.fill(f"{place}. {text}", 120, subsequent_indent="   ", break_on_hyphens=False)


def _versions() -> str:
    versions = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    return f"Made with {', '.join(versions)} and Python {platform.python_version()}"


def _table(first: str, rows: Iterable[str], columns: Sequence[Column]) -> str:
    lines = [f"| {' | '.join([first, *(name for name, _ in columns)])} |", f"|---|{'---:|' * len(columns)}"]
    lines += [f"| {' | '.join([row, *(cell(row) for _, cell in columns)])} |" for row in rows]
    return "\n".join(lines)


def _other_columns(read: Reader) -> list[Column]:
    def of(figure: Callable[[Tracking], float], truth: str, path: str, show: Show) -> Cell:
        return lambda row: show(read.tracking(row, truth, path, figure))

    columns: list[Column] = []
    for truth in (NOMINAL, HEAVY):
        columns += [
            (f"max, sine, {truth}, LSB", of(lambda run: run.max_lsb, truth, "sine", number)),
            (f"max, trapezoid, {truth}, LSB", of(lambda run: run.max_lsb, truth, "trapezoid", number)),
            (f"peak current, sine, {truth}, A", of(lambda run: run.peak_current_a, truth, "sine", number)),
            (f"ripple, {truth}", of(lambda run: run.speed_ripple, truth, "trapezoid", _tenths)),
        ]
    return columns


def _tenths(value: float) -> str:
    return "stopped" if math.isnan(value) else f"{100.0 * value:.1f} %"


def _rest_table(results: Results) -> str:
    labels = list(dict.fromkeys(label for label, _ in results.rest))
    poses = list(dict.fromkeys(pose for _, pose in results.rest))

    def of(figure: Callable[[Rest], float], pose: str, show: Show) -> Cell:
        return lambda row: show(statistics.median(figure(run) for run in results.rest[row, pose]))

    columns: list[Column] = []
    for pose in poses:
        columns += [
            (f"{pose}: changes", of(lambda run: run.changes, pose, percent)),
            ("turns over", of(lambda run: run.reversals, pose, percent)),
            ("moved, LSB", of(lambda run: run.moved_lsb, pose, number)),
        ]
    return _table("law", labels, columns)


def _name(sweep: Sweep) -> str:
    truth = "" if sweep.truth == NOMINAL else ", +50 %"
    return f"A × {sweep.amplitude:g}{truth}, {'bias' if sweep.has_bias else 'no bias'}"


def _sweep_table(results: Results) -> str:
    sweeps = list(dict.fromkeys(sweep for sweep, _ in results.sweep))
    gammas = list(dict.fromkeys(gamma for _, gamma in results.sweep))
    by_name = {_name(sweep): sweep for sweep in sweeps}

    def cell(gamma: float) -> Cell:
        def show(row: str) -> str:
            point = results.sweep[by_name[row], gamma]
            return f"{number(point.rms_lsb)} ({percent(point.at_limit)})"

        return show

    return _table("RMS in LSB (at a limit)", by_name, [(f"γα = {gamma:g}", cell(gamma)) for gamma in gammas])


def _payload_picture(results: Results) -> str:
    read = Reader(results)
    masses = {"payload −50 %": -50.0, NOMINAL: 0.0, HEAVY: 50.0}

    def points(label: str) -> tuple[tuple[float, float], ...]:
        return tuple((mass, read.rms(label, truth, "sine")) for truth, mass in masses.items())

    curves = tuple(Curve(label, points(label), place % 5, place > 4) for place, label in enumerate(DRAWN))
    errors = Axis(0.03, 6.0, (0.05, 0.1, 0.2, 0.5, 1, 2, 5), is_log=True)
    return draw(
        "RMS error against payload",
        "true payload against the model's, %",
        Axis(-50, 50, (-50, 0, 50)),
        [Panel("RMS error on the sine, LSB", errors, 280, curves)],
    )


def _sweep_picture(results: Results) -> str:
    sweeps = list(dict.fromkeys(sweep for sweep, _ in results.sweep))
    gammas = list(dict.fromkeys(gamma for _, gamma in results.sweep))
    colours = list(dict.fromkeys((sweep.amplitude, sweep.truth) for sweep in sweeps))

    def curves(figure: Callable[[Sweep, float], float]) -> tuple[Curve, ...]:
        return tuple(
            Curve(
                _name(sweep),
                tuple((gamma, figure(sweep, gamma)) for gamma in gammas),
                colours.index((sweep.amplitude, sweep.truth)),
                not sweep.has_bias,
            )
            for sweep in sweeps
        )

    error = curves(lambda sweep, gamma: results.sweep[sweep, gamma].rms_lsb)
    share = curves(lambda sweep, gamma: 100.0 * results.sweep[sweep, gamma].at_limit)
    return draw(
        "RMS error, and share of time in which α is at its limit, against gamma_alpha",
        "gamma_alpha (γα·A²)",
        Axis(GAMMAS_ALPHA[0], GAMMAS_ALPHA[-1], (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5), is_log=True),
        [
            Panel("RMS error, LSB", Axis(0.04, 8.0, (0.05, 0.1, 0.2, 0.5, 1, 2, 5), is_log=True), 220, error),
            Panel("share of time with an α at its limit, %", Axis(0, 100, (0, 25, 50, 75, 100)), 150, share),
        ],
    )
