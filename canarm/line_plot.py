"""Line plots as SVG text: panels one below the other, with curves and a legend; readable on light and dark pages.

Knows nothing of what it draws. The same input gives the same bytes.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

WIDTH, LEFT, RIGHT, TOP, GAP = 760, 64, 200, 34, 46
MARK_ROWS = 5
"""The words of marks stand in so many rows, one below the other, before they begin at the top again."""
COLOURS = ("#3b82f6", "#e0781f", "#22a06b", "#9a6fd6", "#8a8f98")
STYLE = """<style>
text { font: 12px system-ui, sans-serif; fill: #24292f }
.title { font-weight: 600 }
.axis { stroke: #8a8f98; fill: none }
.grid { stroke: #8a8f98; stroke-opacity: 0.25 }
@media (prefers-color-scheme: dark) { text { fill: #e6edf3 } }
</style>"""


@dataclass(frozen=True)
class Axis:
    """The range of an axis and where it is labelled; ticks lie within the range. A logarithmic one is above zero."""

    low: float
    high: float
    ticks: tuple[float, ...]
    is_log: bool = False

    def place(self, value: float) -> float:
        """Where `value` lies, 0 at `low` and 1 at `high`; beyond them it is drawn at the edge."""
        value = min(max(value, self.low), self.high)
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Curve:
    """Points (x, y) joined by a line; a point that is not finite is left out. `colour` is an index into `COLOURS`."""

    label: str
    points: tuple[tuple[float, float], ...]
    colour: int
    is_dashed: bool = False


@dataclass(frozen=True)
class Mark:
    """A vertical line at `x` with a word beside it. `colour` is an index into `COLOURS`."""

    x: float
    label: str
    colour: int


@dataclass(frozen=True)
class Panel:
    """One plot of a picture: a line of title, its y axis, its height in pixels, its curves, and marks on its x axis."""

    title: str
    y: Axis
    height: int
    curves: tuple[Curve, ...]
    marks: tuple[Mark, ...] = ()


def draw(title: str, x_label: str, x: Axis, panels: Sequence[Panel]) -> str:
    """The picture. All panels share the x axis; the legend is that of the first."""
    height = TOP + sum(panel.height + GAP for panel in panels) + 8
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">',
        f"<title>{escape(title)}</title>",
        STYLE,
    ]
    top = TOP
    for panel in panels:
        lines += _panel(panel, x, top)
        top += panel.height + GAP
    lines.append(_text((LEFT + WIDTH - RIGHT) / 2, height - 6, x_label, "middle"))
    lines += _legend(panels[0].curves)
    return "\n".join([*lines, "</svg>", ""])


def _panel(panel: Panel, x: Axis, top: int) -> Iterable[str]:
    bottom, right = top + panel.height, WIDTH - RIGHT

    def across(value: float) -> float:
        return LEFT + x.place(value) * (right - LEFT)

    def down(value: float) -> float:
        return bottom - panel.y.place(value) * panel.height

    yield _text(LEFT, top - 10, panel.title, "start", "title")
    for tick in x.ticks:
        yield f'<path class="grid" d="M{across(tick):.1f} {top}V{bottom}"/>'
        yield _text(across(tick), bottom + 16, f"{tick:g}", "middle")
    for tick in panel.y.ticks:
        yield f'<path class="grid" d="M{LEFT} {down(tick):.1f}H{right}"/>'
        yield _text(LEFT - 8, down(tick) + 4, f"{tick:g}", "end")
    yield f'<path class="axis" d="M{LEFT} {top}V{bottom}H{right}"/>'
    for curve in panel.curves:
        places = [f"{across(a):.1f},{down(b):.1f}" for a, b in curve.points if math.isfinite(b)]
        yield f'<polyline points="{" ".join(places)}" {_stroke(curve)}/>'
    for row, mark in enumerate(panel.marks):
        place, height = across(mark.x), top + 12 + 13 * (row % MARK_ROWS)
        yield f'<path stroke="{COLOURS[mark.colour]}" stroke-dasharray="2 3" d="M{place:.1f} {top}V{bottom}"/>'
        if place > (LEFT + right) / 2:
            yield _text(place - 4, height, mark.label, "end")
        else:
            yield _text(place + 4, height, mark.label, "start")


def _legend(curves: Sequence[Curve]) -> Iterable[str]:
    for row, curve in enumerate(curves):
        left, height = WIDTH - RIGHT + 16, TOP + 8 + 20 * row
        yield f'<path d="M{left} {height}h26" {_stroke(curve)}/>'
        yield _text(left + 32, height + 4, curve.label, "start")


def _stroke(curve: Curve) -> str:
    dashes = ' stroke-dasharray="5 4"' if curve.is_dashed else ""
    return f'fill="none" stroke="{COLOURS[curve.colour]}" stroke-width="2"{dashes}'


def _text(x: float, y: float, text: str, anchor: str, kind: str = "") -> str:
    style = f' class="{kind}"' if kind else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{style}>{escape(text)}</text>'
