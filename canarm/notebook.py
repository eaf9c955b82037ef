"""How a notebook shows a rig or a run: title, lines, a table of joints, a picture. All is escaped here."""

import base64
import html
import math
from collections.abc import Iterable, Mapping

from canarm_protocol.shown import printable

FIGURES = {
    "rms_lsb": "RMS error, LSB",
    "max_lsb": "largest error, LSB",
    "peak_current_a": "peak current, A",
    "saturated_cycles": "saturated cycles",
}
"""The figures of a joint that are shown."""
MOST_LINES = 12


def display(title: str, lines: Iterable[str], joints: Mapping[str, Mapping[str, object]], picture: str | None) -> str:
    """The HTML. `joints` has the figures of each joint by the names of `FIGURES`; `picture` is SVG.

    The picture is an image of its own, so that neither its styles nor anything in it reach the notebook.
    """
    shown = [*lines]
    more = [f"and {len(shown) - MOST_LINES} more"] if len(shown) > MOST_LINES else []
    said = "".join(f"<div>{_text(line)}</div>" for line in [*shown[:MOST_LINES], *more])
    rows = "".join(_row(name, figures) for name, figures in joints.items())
    heads = "".join(f"<th>{_text(head)}</th>" for head in ("joint", *FIGURES.values()))
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>" if rows else ""
    image = ""
    if picture:
        data = base64.b64encode(picture.encode()).decode("ascii")
        image = f'<img alt="{_text(title)}" style="max-width:100%" src="data:image/svg+xml;base64,{data}">'
    return f"<div><b>{_text(title)}</b>{said}{table}{image}</div>"


def _row(name: str, figures: Mapping[str, object]) -> str:
    return f"<tr><td>{_text(name)}</td>{''.join(f'<td>{_number(figures.get(key))}</td>' for key in FIGURES)}</tr>"


def _number(value: object) -> str:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e15
    return f"{value:.4g}" if is_number and isinstance(value, int | float) and math.isfinite(value) else "–"


def _text(text: str) -> str:
    return html.escape(printable(text, 400))
