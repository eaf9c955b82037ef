"""What the charts of a report show: curves, fault spans and detections of one run, or of several laid over each other.

Values only; the page draws them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from canarm_controller.run.recording import JOINT_COLUMNS
from canarm_protocol.errors import CanarmError
from canarm_protocol.shown import printable

from ...signal_table import Floats
from ..run import Run
from .errors import DEGREES, error_of
from .story import Span, spans_of

MOST_POINTS = 4000
"""A longer curve is drawn as minimum and maximum of half as many stretches: no spike is lost."""
COLOURS = 8
MOST_BANDS = 200
SAME_RAD = 1e-6
"""Set-points, rad or rad/s, that differ by less are those of one motion: files have 9 digits."""
MOST_INTERNALS = 8
BLUE, ORANGE, GREEN, VIOLET, GREY = range(5)
HISTOGRAMS = {
    "jitter": "Jitter of SYNC",
    "lateness": "Lateness of SYNC",
    "computing": "Computing time of a cycle",
    "law": "Computing time of the law",
    "answer": "From SYNC to the last input",
}


@dataclass(frozen=True)
class Series:
    """A curve: its name, points, and how it is drawn."""

    name: str
    x: list[float]
    y: list[float | None]
    colour: int
    dashed: bool = False


@dataclass(frozen=True)
class Chart:
    """A chart: curves over an axis, spans (from, to, text), and marks (place, text, number)."""

    title: str
    series: list[Series]
    x_label: str = "time, s"
    x_unit: str = "s"
    over_time: bool = True
    bars: bool = False
    x_range: list[float] | None = None
    bands: list[tuple[float, float, str]] = field(default_factory=list)
    marks: list[tuple[float, str, str]] = field(default_factory=list)

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def charts_of(runs: Sequence[Run], names: Sequence[str]) -> list[Chart]:
    """The charts of one run, or of several, which are called `names`."""
    over_time = [chart for joint in _joints(runs) for chart in _of_joint(runs, names, joint)]
    return [*over_time, *_object(runs, names), *_histograms(runs, names)]


def _joints(runs: Sequence[Run]) -> list[str]:
    names = (name.rsplit(".", 2) for run in runs for name in run.columns if name.count(".") >= 1)
    return [each for each in dict.fromkeys(name[-2] for name in names) if each != "object"]


def _of_joint(runs: Sequence[Run], names: Sequence[str], joint: str) -> Iterable[Chart]:
    shown = printable(joint, 40)
    yield _chart(
        f"{shown}: angle, degrees",
        runs,
        names,
        [
            ("true", f"{joint}.true_angle_rad", DEGREES, False),
            ("measured", f"{joint}.measured_rad", DEGREES, False),
            ("reference", f"{joint}.reference_rad", DEGREES, True),
        ],
        joint,
        most=1,
    )
    errors = [error_of(run, joint) for run in runs]
    if any(values is not None for values, _ in errors):
        unit = errors[0][1]
        series = [
            series_of(named("true minus reference", names, place), run.columns["time_s"], values, place)
            for place, (run, (values, _)) in enumerate(zip(runs, errors, strict=True))
            if values is not None
        ]
        yield annotated(f"{shown}: error, {unit}", series, runs, names, joint)
    yield _chart(
        f"{shown}: current, A",
        runs,
        names,
        [
            ("motor", f"{joint}.motor_current_a", 1.0, False),
            ("command", f"{joint}.command_a", 1.0, True),
            ("measured", f"{joint}.measured_a", 1.0, False),
        ],
        joint,
        most=1,
        limit=_limit_a(runs, joint),
    )
    yield _chart(
        f"{shown}: speed, rad/s",
        runs,
        names,
        [
            ("true", f"{joint}.true_speed_rad_s", 1.0, False),
            ("measured", f"{joint}.measured_rad_s", 1.0, False),
            ("reference", f"{joint}.reference_rad_s", 1.0, True),
        ],
        joint,
        most=1,
    )
    internals = _internals(runs, joint)
    for name in internals:
        yield _chart(
            f"{shown}: {printable(name, 60)} of the law", runs, names, [(name, f"{joint}.{name}", 1.0, False)], joint
        )


def _internals(runs: Sequence[Run], joint: str) -> list[str]:
    """What the law adapts: the columns after those that every controller has."""
    found = (name.removeprefix(f"{joint}.") for run in runs for name in run.controller if name.startswith(f"{joint}."))
    return [each for each in dict.fromkeys(found) if each not in JOINT_COLUMNS][:MOST_INTERNALS]


def _object(runs: Sequence[Run], names: Sequence[str]) -> Iterable[Chart]:
    columns = [f"object.position_{axis}_m" for axis in "xyz"]
    if any(columns[0] in run.columns for run in runs):
        yield _chart(
            "The object's place, m",
            runs,
            names,
            [(axis, name, 1.0, False) for axis, name in zip("xyz", columns, strict=True)],
            None,
        )
        yield _chart("Squeeze of the object, N", runs, names, [("squeeze", "object.squeeze_n", 1.0, False)], None)


def _limit_a(runs: Sequence[Run], joint: str) -> float | None:
    for run in runs:
        try:
            drive = run.cell.joints[run.cell.joint_names.index(joint)].drive
        except (CanarmError, ValueError, AttributeError):
            continue
        limit = getattr(drive, "max_current_a", None)
        return float(limit) if isinstance(limit, int | float) else None
    return None


def _chart(
    title: str,
    runs: Sequence[Run],
    names: Sequence[str],
    wanted: Sequence[tuple[str, str, float, bool]],
    joint: str | None,
    most: int = MOST_INTERNALS,
    limit: float | None = None,
) -> Chart:
    """Curves of one run in a colour each; of several, the first `most` of `wanted`, each run in its colour."""
    series = []
    for place, run in enumerate(runs):
        chosen = wanted if len(runs) == 1 else wanted[:most]
        for number, (name, column, scale, dashed) in enumerate(chosen):
            if column in run.columns:
                colour = number if len(runs) == 1 else place
                series.append(
                    series_of(
                        named(name, names, place), run.columns["time_s"], run.columns[column] * scale, colour, dashed
                    )
                )
    for place, run in enumerate(runs if len(runs) > 1 else ()):
        for name, column, scale, dashed in wanted:
            if name == "reference" and column in run.columns and not (place and _is_same(column, run, runs[0])):
                values, colour = run.columns[column] * scale, place if place else GREY
                series.append(series_of(named(name, names, place), run.columns["time_s"], values, colour, dashed))
    drawn = [each for each in series if each.x]
    if limit is not None and drawn:
        ends = [min(each.x[0] for each in drawn), max(each.x[-1] for each in drawn)]
        series += [Series(f"limit {sign * limit:+g} A", ends, [sign * limit] * 2, GREY, True) for sign in (1, -1)]
    return annotated(title, series, runs, names, joint)


def _is_same(column: str, run: Run, first: Run) -> bool:
    """Whether the shorter of two runs has the same values there as the longer one, where both have any."""
    one, other = first.columns.get(column, np.empty(0)), run.columns[column]
    size = min(len(one), len(other))
    off = np.abs(one[:size] - other[:size])
    known = off[np.isfinite(off)]
    return bool(len(known)) and float(known.max()) < SAME_RAD


def annotated(title: str, series: list[Series], runs: Sequence[Run], names: Sequence[str], joint: str | None) -> Chart:
    """With fault spans, and with the detections if it is one run: of several nobody could tell them apart."""
    if len(runs) > 1:
        pairs = [(run, span, name) for run, name in zip(runs, names, strict=True) for span in spans_of(run)]
        return Chart(title, series, bands=[_band(span, run, f"{name}: ") for run, span, name in pairs[:MOST_BANDS]])
    spans = spans_of(runs[0])
    seen = [(f"{each.time_s:.4f} s: {printable(each.detection.detector, 60)}", each) for each in runs[0].detections]
    marks = [
        (each.time_s, text, str(k))
        for k, (text, each) in enumerate(seen, 1)
        if each.detection.where in (joint, None) or joint is None or each.detection.where not in _joints(runs)
    ]
    return Chart(title, series, bands=[_band(span, runs[0]) for span in spans], marks=marks[:200])


def _band(span: Span, run: Run, before: str = "") -> tuple[float, float, str]:
    times = run.columns.get("time_s", np.empty(0))
    last_s = float(times[-1]) if len(times) else span.begin_s
    return (
        span.begin_s,
        last_s if span.end_s is None else span.end_s,
        f"{before}{'' if span.is_stop else 'fault: '}{printable(span.what)}",
    )


def _histograms(runs: Sequence[Run], names: Sequence[str]) -> Iterable[Chart]:
    for key, title in HISTOGRAMS.items():
        series = []
        for place, run in enumerate(runs):
            pacing = run.configuration.get("pacing")
            found = pacing.get(key) if isinstance(pacing, Mapping) else None
            bins = found.get("histogram") if isinstance(found, Mapping) else None
            if not isinstance(bins, Mapping):
                continue
            pairs = list(zip(_numbers(bins.get("from_us")), _numbers(bins.get("count")), strict=False))
            if pairs:
                x, y = [each[0] for each in pairs], [each[1] for each in pairs]
                series.append(Series(named("cycles", names, place), x, list(y), place % COLOURS))
        if series:
            yield Chart(
                f"{title}: cycles in each bin, over us",
                series,
                "us; bins grow with the duration",
                "us",
                over_time=False,
                bars=True,
            )


def _numbers(values: object) -> list[float]:
    listed = values if isinstance(values, list) else []
    return [float(each) for each in listed if isinstance(each, int | float) and abs(each) < 1e15]


def named(name: str, names: Sequence[str], place: int) -> str:
    """The name of a curve; of several runs with the name of its run, which is at `place`."""
    return printable(name, 60) if len(names) == 1 else f"{printable(names[place], 60)}: {printable(name, 60)}"


def series_of(name: str, times_s: Floats, values: Floats, colour: int, dashed: bool = False) -> Series:
    """A curve of values over time, thinned out and with numbers as short as a picture can show."""
    order = np.argsort(times_s, kind="stable")
    x, y = thinned(times_s[order], values[order])
    plain = [float(f"{each:.6g}") if math.isfinite(each) and abs(each) < 1e15 else None for each in y.tolist()]
    return Series(name, [round(each, 6) for each in x.tolist()], plain, colour % COLOURS, dashed)


def thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """At most about `MOST_POINTS` points: minimum and maximum of each stretch."""
    if len(values) <= MOST_POINTS:
        return times_s, values
    length = -(-len(values) // (MOST_POINTS // 2))
    starts = np.arange(0, len(values), length)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    return np.repeat(times_s[starts], 2), np.column_stack((low, high)).ravel()
