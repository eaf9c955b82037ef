"""A picture of a run: every joint's angles and currents over time, with faults and detections.

Decides what is drawn; `picture` keeps it, and `line_plot` makes SVG of it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from canarm_protocol.shown import quoted

from ..line_plot import Curve, Mark, Panel, fitting
from ..usage import UsageError
from .findings import HALF_NS, Begun, Noticed
from .picture import Picture, picture_of
from .rig_joint import Floats, RigJoint

COLUMNS = 600
"""A longer curve is drawn as this many pairs of minimum and maximum, more than the picture has pixels."""
PANEL_HEIGHT = 150
LARGEST = 1e15
"""No figure of a robot is larger: what is, of a damaged record, is left out as infinity is, and all others are seen."""
BEFORE_S, AFTER_S = 0.3, 0.5
"""Time shown before the first fault, and after the last detection."""
BLUE, ORANGE, GREEN, VIOLET, GREY = range(5)
DEGREES = 180.0 / math.pi
_PANELS: tuple[tuple[str, tuple[tuple[Any, ...], ...]], ...] = (
    (
        "angle, degrees",
        (
            ("true", "true_angle_rad", BLUE, DEGREES),
            ("measured", "measured_rad", GREEN, DEGREES),
            ("reference", "reference_rad", GREY, DEGREES, True),
        ),
    ),
    ("true speed, rad/s", (("true", "true_speed_rad_s", BLUE),)),
    ("current, A", (("current", "current_a", BLUE), ("command", "command_a", ORANGE, 1.0, True))),
)
"""Title of each panel; label, signal, colour, factor and dashes of each curve."""


def plot_run(
    title: str, joints: Mapping[str, RigJoint], begun: Sequence[Begun] = (), noticed: Sequence[Noticed] = ()
) -> Picture:
    """The picture as SVG text: the time around faults and detections, or the whole run if there are none.

    A detection at a joint is marked in its panels, any other in all. Without cycles there are only axes.
    """
    if not isinstance(title, str):
        raise UsageError(f"title {quoted(title)}: must be text")
    low_s, high_s = _window(begun, noticed)
    faults = [Mark(each.time_s, f"{each.time_s:.4f} s  fault: {each.tap} {each.fault}", ORANGE) for each in begun]
    found = [(each.detection.where, Mark(each.time_s, _seen(each), VIOLET)) for each in noticed]
    panels, times_s = [], []
    for name, joint in joints.items():
        marks = [*faults, *(mark for where, mark in found if where == name or where not in joints)]
        shown = tuple(mark for mark in dict.fromkeys(marks) if low_s <= mark.x <= high_s)
        for what, signals in _PANELS:
            curves = [_curve(joint, low_s, high_s, *signal) for signal in signals]
            curves = [curve for curve in curves if curve.points]
            axis = fitting(_values(curves, 1))
            panels.append(Panel(f"{name}: {what}", axis, PANEL_HEIGHT, tuple(curves), shown))
            times_s += _values(curves, 0)
    return picture_of(title, "time, s", fitting(times_s), panels)


def _window(begun: Sequence[Begun], noticed: Sequence[Noticed]) -> tuple[float, float]:
    """The time from before the first fault to after the last detection, s."""
    events_s = [*(each.time_s for each in begun), *(each.time_s for each in noticed)]
    low_s = min((each.time_s for each in begun), default=min(events_s, default=-math.inf)) - BEFORE_S
    return low_s, max(events_s) + AFTER_S if noticed else math.inf


def _seen(each: Noticed) -> str:
    where = f" at {each.detection.where}" if each.detection.where else ""
    return f"{each.time_s:.4f} s  detected: {each.detection.detector}{where}"


def _curve(
    joint: RigJoint,
    low_s: float,
    high_s: float,
    label: str,
    signal: str,
    colour: int,
    scale: float = 1.0,
    is_dashed: bool = False,
) -> Curve:
    span = joint.span(signal)
    inside = (span.time_s >= low_s - HALF_NS) & (span.time_s <= high_s + HALF_NS) & (np.abs(span.time_s) <= LARGEST)
    value = span.value[inside]
    value = np.where(np.abs(value) <= LARGEST, value, np.nan)
    times_s, values = _thinned(span.time_s[inside], value * scale)
    return Curve(label, tuple(zip(times_s.tolist(), values.tolist(), strict=True)), colour, is_dashed)


def _thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Minimum and maximum of each of `COLUMNS` stretches, so that no spike is lost."""
    if len(values) <= 2 * COLUMNS:
        return times_s, values
    length = -(-len(values) // COLUMNS)
    starts = np.arange(0, len(values), length)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)  # past what is no number
    return np.repeat(times_s[starts], 2), np.column_stack((low, high)).ravel()


def _values(curves: Iterable[Curve], place: int) -> list[float]:
    return [point[place] for curve in curves for point in curve.points if math.isfinite(point[1])]
