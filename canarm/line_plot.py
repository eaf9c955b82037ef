"""Line plots as SVG text: stacked panels with curves and a legend, readable on light and dark pages.

What is drawn is not known here. The same input gives the same bytes.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

WIDTH, LEFT, RIGHT, TOP, GAP = 760, 64, 200, 34, 46
MARK_STRIP, MARK_WIDTH, MARK_ROW = 14, 14, 16
"""Height of the strip of mark numbers above a panel, width of a number, height of a line of text."""
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
        """Where `value` lies, 0 at `low` and 1 at `high`; clipped to these."""
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
    """A numbered vertical line at `x`, explained below the picture. `colour` is an index into `COLOURS`."""

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


def fitting(values: Sequence[float]) -> Axis:
    """An axis that holds all `values`, with ticks at round numbers."""
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    if high - low < 1e-6:
        low, high = low - 0.5, high + 0.5
    rough = (high - low) / 5
    decade = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * decade for factor in (1, 2, 5, 10) if factor * decade >= rough)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return Axis(low, high, tuple(min(max(number * step, low), high) for number in range(first, last + 1)))


def draw(title: str, x_label: str, x: Axis, panels: Sequence[Panel]) -> str:
    """The picture. All panels share the x axis; a panel has its own legend if its curves differ from the last.

    Marks are numbered along the x axis, across all panels.
    """
    marks = sorted(dict.fromkeys(mark for panel in panels for mark in panel.marks), key=lambda mark: mark.x)
    numbers = {mark: number for number, mark in enumerate(marks, start=1)}
    gap = GAP + (MARK_STRIP if marks else 0)
    plots_end = TOP + sum(panel.height + gap for panel in panels) + 8
    height = plots_end + (MARK_ROW * len(marks) + 8 if marks else 0)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img">',
        f"<title>{escape(title)}</title>",
        STYLE,
    ]
    top = TOP + gap - GAP
    legends: list[str] = []
    known: set[tuple[str, int, bool]] = set()
    for panel in panels:
        lines += _panel(panel, x, top, numbers)
        keys = [(curve.label, curve.colour, curve.is_dashed) for curve in panel.curves]
        if not known.issuperset(keys):
            legends += _legend(panel.curves, top)
        known.update(keys)
        top += panel.height + gap
    lines += [_text((LEFT + WIDTH - RIGHT) / 2, plots_end - 6, x_label, "middle"), *legends]
    for mark, number in numbers.items():
        row = plots_end + MARK_ROW * number
        lines.append(_text(LEFT, row, str(number), "end", colour=mark.colour))
        lines.append(_text(LEFT + 10, row, mark.label, "start"))
    return "\n".join([*lines, "</svg>", ""])


def _panel(panel: Panel, x: Axis, top: int, numbers: Mapping[Mark, int]) -> Iterable[str]:
    bottom, right = top + panel.height, WIDTH - RIGHT

    def across(value: float) -> float:
        return LEFT + x.place(value) * (right - LEFT)

    def down(value: float) -> float:
        return bottom - panel.y.place(value) * panel.height

    yield _text(LEFT, top - (10 + MARK_STRIP if numbers else 10), panel.title, "start", "title")
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
    free = 0.0
    for mark in sorted(panel.marks, key=lambda each: numbers[each]):
        place = across(mark.x)
        yield f'<path stroke="{COLOURS[mark.colour]}" stroke-dasharray="2 3" d="M{place:.1f} {top}V{bottom}"/>'
        if place > free - MARK_WIDTH:  # else there is no room for another number
            number_x = max(place, free)
            yield _text(number_x, top - 4, str(numbers[mark]), "middle", colour=mark.colour)
            free = number_x + MARK_WIDTH


def _legend(curves: Sequence[Curve], top: int) -> Iterable[str]:
    for row, curve in enumerate(curves):
        left, height = WIDTH - RIGHT + 16, top + 8 + 20 * row
        yield f'<path d="M{left} {height}h26" {_stroke(curve)}/>'
        yield _text(left + 32, height + 4, curve.label, "start")


def _stroke(curve: Curve) -> str:
    dashes = ' stroke-dasharray="5 4"' if curve.is_dashed else ""
    return f'fill="none" stroke="{COLOURS[curve.colour]}" stroke-width="2"{dashes}'


def _text(x: float, y: float, text: str, anchor: str, kind: str = "", colour: int | None = None) -> str:
    style = f' class="{kind}"' if kind else ""
    style += f' style="fill: {COLOURS[colour]}"' if colour is not None else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{style}>{escape(text)}</text>'
