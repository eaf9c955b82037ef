"""The parts of every page: a frame that loads nothing, tables, and places for charts. All texts are escaped here."""

import html
import json
import math
from collections.abc import Iterable, Sequence
from importlib import resources
from typing import Any

from canarm_protocol.shown import printable

from .charts import Chart

POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The page may load nothing at all (Content Security Policy)."""


def page_of(title: str, body: Iterable[str], charts: Sequence[Chart]) -> str:
    """A page that needs nothing else: no network, no other file. `body` is markup; its places show the `charts`."""
    return "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escaped(title)}</title>",
            f"<style>\n{_resource('report.css')}</style>\n</head>\n<body>",
            *filter(None, body),
            f'<script id="charts" type="application/json">{_json([chart.as_plain() for chart in charts])}</script>',
            f"<script>\n{_resource('report.js')}</script>\n</body>\n</html>\n",
        ]
    )


def chart_place(number: int, chart: Chart) -> str:
    """Where the page shows chart `number`."""
    return f'<h3>{escaped(chart.title)}</h3>\n<div class="chart" data-chart="{number}"></div>'


def table_of(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; `rows` are made of `cell_of` and `number_cell`."""
    head = "".join(f"<th>{escaped(each)}</th>" for each in heads)
    body = "\n".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def cell_of(shown: str) -> str:
    """A cell with a text."""
    return f"<td>{escaped(printable(shown, 500))}</td>"


def number_cell(value: float | None) -> str:
    """A cell with a number, or a dash."""
    return f'<td class="n">{"–" if value is None or not math.isfinite(value) else f"{value:.6g}"}</td>'


def escaped(shown: str) -> str:
    """A foreign text as markup that shows it."""
    return html.escape(shown)


def _json(value: Any) -> str:
    """JSON that no browser takes for markup."""
    written = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return written.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _resource(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")
