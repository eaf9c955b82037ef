"""A drawn figure: SVG text that notebooks show, and that can be saved as SVG or PNG.

What it shows is decided elsewhere.
"""

import io
from collections.abc import Sequence
from pathlib import Path

from canarm_protocol.runs.own_file import replace_file
from canarm_protocol.shown import quoted

from ..libraries import load_library, no_formula
from ..line_plot import COLOURS, Axis, Panel, draw
from ..usage import UsageError

WIDTH_INCH, PANEL_INCH, MARK_INCH, DPI = 9.0, 2.2, 0.2, 150
FORMATS = (".svg", ".png")


class Picture(str):
    """An SVG picture as text, which notebooks show."""

    _title: str
    _x_label: str
    _x: Axis
    _panels: tuple[Panel, ...]

    def save(self, path: Path | str) -> Path:
        """Write it into the file `path`, which ends in `.svg` or `.png`; returns the path.

        PNG is drawn by matplotlib: raises `MissingLibraryError` without it. Raises `UsageError` for another ending, and
        `OSError` with the name of a file that cannot be written.
        """
        __tracebackhide__ = True
        given: object = path
        if not isinstance(given, str | Path) or Path(path).suffix.lower() not in FORMATS:
            raise UsageError(f"save {quoted(given)}: must be the path of a file that ends in {' or '.join(FORMATS)}")
        path = Path(path)
        replace_file(path, self.encode("utf-8") if path.suffix.lower() == ".svg" else self._as_png())
        return path

    def _as_png(self) -> bytes:
        figures = load_library("matplotlib.figure", "a picture as PNG")
        marks = sorted({mark for panel in self._panels for mark in panel.marks}, key=lambda mark: mark.x)
        rows = max(len(self._panels), 1)
        size_inch = (WIDTH_INCH, PANEL_INCH * rows + MARK_INCH * (len(marks) + 2))
        figure = figures.Figure(figsize=size_inch, layout="constrained")
        figure.suptitle(no_formula(self._title))
        for panel, axes in zip(self._panels, figure.subplots(rows, squeeze=False)[:, 0], strict=False):
            for curve in panel.curves:
                style = "--" if curve.is_dashed else "-"
                axes.plot(*zip(*curve.points, strict=True), style, color=COLOURS[curve.colour], label=curve.label)
            for mark in panel.marks:
                axes.axvline(mark.x, color=COLOURS[mark.colour], linestyle=":")
                number = str(marks.index(mark) + 1)
                place, beside = (mark.x, 1.0), {"xytext": (3, -3), "textcoords": "offset points", "va": "top"}
                axes.annotate(number, place, xycoords=("data", "axes fraction"), **beside)
            axes.set_title(no_formula(panel.title), loc="left")
            axes.set(xlim=(self._x.low, self._x.high), ylim=(panel.y.low, panel.y.high))
            if panel.curves:
                axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        below = [self._x_label, *(f"{number}  {mark.label}" for number, mark in enumerate(marks, 1))]
        figure.supxlabel(no_formula("\n".join(below)), fontsize="medium")
        png = io.BytesIO()
        figure.savefig(png, format="png", dpi=DPI, metadata={"Software": None})
        return png.getvalue()

    def _repr_svg_(self) -> str:
        return str(self)


def picture_of(title: str, x_label: str, x: Axis, panels: Sequence[Panel]) -> Picture:
    """The picture of these panels, which share the x axis; see `canarm.line_plot.draw`."""
    picture = Picture(draw(title, x_label, x, panels))
    picture._title, picture._x_label, picture._x, picture._panels = title, x_label, x, tuple(panels)
    return picture
