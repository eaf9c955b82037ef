"""The pictures of docs/rhino.md: Fig. 6 of the paper redrawn, and the map of the slave's bases, as SVG text."""

from collections.abc import Iterator
from itertools import groupby

import numpy as np
from rhino_figures import PAIR, START, Results

from canarm.cooperation import CooperationPlan, ReachabilityMap, Reason, forward
from canarm.line_plot import COLOURS, STYLE, Curve, Panel, draw, fitting

JOINTS_PICTURE, MAP_PICTURE = "rhino-joints.svg", "rhino-map.svg"
EVERY = 10
"""Every tenth pose of a lap is drawn; a curve has 201 points."""
PIXELS_M, LEFT, TOP, LEGEND = 260.0, 46, 18, 250
BLUE, ORANGE, GREEN, VIOLET, GREY = COLOURS
LEVELS = ((1.5, 1.0), (2.0, 0.75), (3.0, 0.5), (5.0, 0.3), (float("inf"), 0.14))
"""Up to which ratio of travel a square has which opacity."""
FAILS = {
    Reason.OUT_OF_REACH: (GREY, 0.25),
    Reason.SINGULAR: (BLUE, 0.8),
    Reason.BASE_AXIS: (ORANGE, 1.0),
    Reason.BRANCH_FLIP: (ORANGE, 0.6),
    Reason.PARALLEL: (VIOLET, 0.8),
}


def pictures(results: Results) -> dict[str, str]:
    """File name and SVG text of each picture."""
    return {JOINTS_PICTURE: joints_picture(results.lap), MAP_PICTURE: map_picture(results)}


def joints_picture(plan: CooperationPlan) -> str:
    """All ten joint angles over the path, one panel each: their ranges lie too far apart for one."""
    times_s = plan.time_s[::EVERY].tolist()
    panels = []
    for name, angles in list(plan.columns().items())[1:]:
        robot, joint, _ = name.split("_")
        points = tuple(zip(times_s, angles[::EVERY].tolist(), strict=True))
        axis = fitting([angle for _, angle in points])
        curve = Curve(robot, points, 0 if robot == "master" else 1)
        panels.append(Panel(f"{robot}, θ{joint.removeprefix('joint')}, degrees", axis, 70, (curve,)))
    return draw("All ten joint angles over a lap", "time, s", fitting(times_s), panels)


def map_picture(results: Results) -> str:
    """Slave bases seen from above: how far the slave moves where it works, and why it does not elsewhere."""
    found = results.map
    step = float(found.x_m[1] - found.x_m[0])
    width = LEFT + PIXELS_M * (np.ptp(found.x_m) + step)
    height = TOP + PIXELS_M * (np.ptp(found.y_m) + step)
    title = "Where the slave's base may stand"
    size = f"0 0 {width + LEGEND:.0f} {height + 40:.0f}"
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{size}" role="img">', f"<title>{title}</title>", STYLE]
    lines += _squares(found, step)
    lines += _axes(found, step, width, height)
    lines += _places(results, step, width)
    lines += _legend(found, width)
    return "\n".join([*lines, "</svg>", ""])


def _across(found: ReachabilityMap, step: float, x_m: float) -> float:
    return float(LEFT + PIXELS_M * (x_m - found.x_m[0] + step / 2))


def _down(found: ReachabilityMap, step: float, y_m: float) -> float:
    return float(TOP + PIXELS_M * (found.y_m[-1] + step / 2 - y_m))


def _fill(reason: int, ratio: float) -> tuple[str, float]:
    if reason == Reason.NONE:
        return GREEN, next(opacity for most, opacity in LEVELS if ratio <= most)
    return FAILS[Reason(reason)]


def _squares(found: ReachabilityMap, step: float) -> Iterator[str]:
    """Equal neighbours in a row are one rectangle."""
    for row, y_m in enumerate(found.y_m.tolist()):
        fills = [_fill(int(a), float(b)) for a, b in zip(found.reason[row], found.travel_ratio[row], strict=True)]
        start = 0
        for (colour, opacity), group in groupby(fills):
            count = len(list(group))
            left = _across(found, step, float(found.x_m[start]) - step / 2)
            top = _down(found, step, y_m + step / 2)
            yield (
                f'<rect x="{left:.1f}" y="{top:.1f}" width="{PIXELS_M * step * count:.1f}" '
                f'height="{PIXELS_M * step:.1f}" fill="{colour}" fill-opacity="{opacity:g}"/>'
            )
            start += count


def _axes(found: ReachabilityMap, step: float, width: float, height: float) -> Iterator[str]:
    for x_m in np.arange(-0.8, 1.01, 0.2).tolist():
        yield _text(_across(found, step, x_m), height + 14, f"{x_m:.1f}".replace("-0.0", "0.0"), "middle")
    for y_m in np.arange(-1.2, 0.61, 0.2).tolist():
        yield _text(LEFT - 8, _down(found, step, y_m) + 4, f"{y_m:.1f}".replace("-0.0", "0.0"), "end")
    yield _text((LEFT + width) / 2, height + 32, "x and y of the slave's base in the master's, m", "middle")


def _places(results: Results, step: float, width: float) -> Iterator[str]:
    """The master's base, A, B and two bases, numbered."""
    tip = forward(PAIR.master, START[None])
    b = PAIR.carried.frame(tip)[0, :2, 3]
    best = results.arrangements[0].pair
    places = [
        ("the master's base", (0.0, 0.0)),
        ("A, the master's tip", tip[0, :2, 3]),
        ("B, 0.3 m from A", b),
        ("the base of the worked case", PAIR.slave_base_m[:2]),
        (f"the base of least motion ({best.carried.distance_m:g} m)", best.slave_base_m[:2]),
    ]
    for number, (label, (x_m, y_m)) in enumerate(places, start=1):
        x, y = _across(results.map, step, float(x_m)), _down(results.map, step, float(y_m))
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8" fill="#ffffff" stroke="#24292f"/>'
        yield f'<text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" style="fill: #24292f">{number}</text>'
        yield _text(width + 16, TOP + 260 + 20 * number, f"{number}  {label}", "start")


def _legend(found: ReachabilityMap, width: float) -> Iterator[str]:
    rows: list[tuple[str, float, str]] = []
    low = 0.0
    for most, opacity in LEVELS:
        words = (
            f"slave moves {low:g} to {most:g} times as far" if most < 1e9 else f"slave moves over {low:g} times as far"
        )
        rows.append((GREEN, opacity, words))
        low = most
    rows += [(*FAILS[reason], reason.words.split(":")[0]) for reason in FAILS if (found.reason == reason).any()]
    for number, (colour, opacity, words) in enumerate(rows):
        top = TOP + 20 * number
        place = f'x="{width + 16:.0f}" y="{top}" width="14" height="14"'
        yield f'<rect {place} fill="{colour}" fill-opacity="{opacity:g}"/>'
        yield _text(width + 38, top + 12, words, "start")


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>'
