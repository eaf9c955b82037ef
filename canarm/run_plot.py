"""A picture of a run: every joint's angles and currents over time, with the faults and what was detected.

Says what is drawn; how it becomes SVG belongs to `line_plot`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .findings import Begun, Noticed
from .line_plot import Axis, Curve, Mark, Panel, draw
from .rig_joint import Floats, RigJoint

COLUMNS = 600
"""So many pairs of least and greatest value are drawn of a longer curve: more than the picture has pixels."""
PANEL_HEIGHT = 150
BLUE, ORANGE, GREEN, VIOLET, GREY = range(5)


def plot_run(
    title: str, joints: Mapping[str, RigJoint], begun: Sequence[Begun] = (), noticed: Sequence[Noticed] = ()
) -> str:
    """The picture as SVG text; without any cycle, axes alone."""
    marks = tuple(Mark(each.time_s, f"{each.tap} {each.fault}", ORANGE) for each in begun)
    marks += tuple(Mark(each.time_s, each.detection.detector, VIOLET) for each in noticed)
    panels, times_s = [], [0.0]
    for name, joint in joints.items():
        angles = [
            _curve("true", joint, "true_angle_rad", BLUE, 180.0 / math.pi),
            _curve("measured", joint, "measured_rad", GREEN, 180.0 / math.pi),
            _curve("reference", joint, "reference_rad", GREY, 180.0 / math.pi, is_dashed=True),
        ]
        currents = [
            _curve("current", joint, "current_a", BLUE),
            _curve("command", joint, "command_a", ORANGE, is_dashed=True),
        ]
        for what, curves in (("angle, degrees", angles), ("current (command dashed), A", currents)):
            panels.append(Panel(f"{name}: {what}", _fitting(_values(curves, 1)), PANEL_HEIGHT, tuple(curves), marks))
            times_s += _values(curves, 0)
    return draw(title, "time, s", _fitting(times_s), panels)


def _curve(label: str, joint: RigJoint, signal: str, colour: int, scale: float = 1.0, is_dashed: bool = False) -> Curve:
    span = joint.span(signal)
    times_s, values = _thinned(span.time_s, span.value * scale)
    return Curve(label, tuple(zip(times_s.tolist(), values.tolist(), strict=True)), colour, is_dashed)


def _thinned(times_s: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Least and greatest value of each of `COLUMNS` stretches, so that no spike is lost."""
    if len(values) <= 2 * COLUMNS:
        return times_s, values
    length = -(-len(values) // COLUMNS)
    starts = np.arange(0, len(values), length)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    return np.repeat(times_s[starts], 2), np.column_stack((low, high)).ravel()


def _values(curves: Iterable[Curve], place: int) -> list[float]:
    return [point[place] for curve in curves for point in curve.points if math.isfinite(point[1])]


def _fitting(values: Sequence[float]) -> Axis:
    """An axis that holds all `values`, with ticks at round numbers."""
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    if high - low < 1e-6:
        low, high = low - 0.5, high + 0.5
    rough = (high - low) / 5
    decade = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * decade for factor in (1, 2, 5, 10) if factor * decade >= rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, tuple(min(max(number * step, low), high) for number in range(first, last + 1)))
