"""The charts of a report as files, SVG and PNG, for papers and slides. What they show is decided elsewhere."""

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from canarm_protocol.runs.own_file import replace_file

from ...libraries import load_library, no_formula
from .charts import Chart

FORMATS = ("svg", "png")
DPI = 150
SIZE_INCH = (9.0, 3.2)
COLOURS = ("#2563eb", "#d9650c", "#15803d", "#8b5cf6", "#6b7280", "#be185d", "#0e7490", "#a16207")
"""As in the page, on white."""
SETTINGS = {"svg.hashsalt": "canarm", "svg.fonttype": "none", "font.size": 9.0, "axes.grid": True, "grid.alpha": 0.3}
"""The same charts give the same bytes; texts stay texts."""


def draw_figures(charts: Sequence[Chart], folder: Path) -> list[Path]:
    """Write every chart into `folder`, which is made. Returns the paths.

    Raises `MissingLibraryError` without matplotlib, and `OSError` with the name of a file that cannot be written.
    """
    library = load_library("matplotlib", "--figures")
    figures = load_library("matplotlib.figure", "--figures")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with library.rc_context(SETTINGS):
        for number, chart in enumerate(charts, 1):
            figure = figures.Figure(figsize=SIZE_INCH, layout="constrained")
            _draw(chart, figure.add_subplot())
            for kind in FORMATS:
                path = folder / f"{number:02d}-{_slug(chart.title)}.{kind}"
                metadata = {"Date": None} if kind == "svg" else {"Software": None}
                drawn = io.BytesIO()
                figure.savefig(drawn, format=kind, dpi=DPI, metadata=metadata)
                replace_file(path, drawn.getvalue())
                written.append(path)
    return written


def _draw(chart: Chart, axes: Any) -> None:
    for series in chart.series:
        y = [float("nan") if each is None else each for each in series.y]
        colour = COLOURS[series.colour % len(COLOURS)]
        if chart.bars:
            axes.vlines(series.x, 0.0, y, color=colour, linewidth=2.0, label=_plain(series.name))
        else:
            style = "--" if series.dashed else "-"
            axes.plot(series.x, y, style, color=colour, linewidth=1.0, label=_plain(series.name))
    for begin, end, _ in chart.bands:
        axes.axvspan(begin, end, color="#d9650c", alpha=0.2, linewidth=0)
    for place, _, number in chart.marks:
        axes.axvline(place, color="#8b5cf6", linestyle=":", linewidth=1.0)
        axes.annotate(number, (place, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=7)
    axes.set_title(_plain(chart.title), loc="left", fontsize=9, fontweight="bold")
    axes.set_xlabel(_plain(chart.x_label))
    if chart.series:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def _plain(text: str) -> str:
    """A text that is no formula, nor a name that matplotlib hides: one that begins with _."""
    return no_formula(text).removeprefix("_")


def _slug(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:60] or "chart"
