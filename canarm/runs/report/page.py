"""Runs as one HTML page that needs nothing else: no network, no other file.

Foreign texts are escaped here, all of them; what is drawn and what is said is decided elsewhere.
"""

import html
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

from canarm_protocol.shown import printable, printable_values

from ..run import Run, details_of
from .charts import Chart, charts_of
from .figures import Figure, above, figures_of
from .story import fault_spans, verdict

MOST_ROWS = 300
"""Longest table of events."""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The page may load nothing at all (Content Security Policy)."""
_PLAIN = ("time_s", "cycle", "source", "event", "power_on_s")
_SHOWN = 20000
"""Characters of a configuration that are shown."""


def report_page(runs: Sequence[Run], limits: Mapping[str, float] | None = None) -> str:
    """The page of one run, or of several, which are compared with the first.

    `limits` of ratios, as `above` takes them, are marked. Raises `UsageError` for a limit of no figure.
    """
    names = run_names(runs)
    charts = charts_of(runs, names)
    figures = figures_of(runs)
    title = f"canarm: {names[0]}" if len(runs) == 1 else f"canarm: {len(runs)} runs"
    body = [
        f"<h1>{_text(title)}</h1>",
        *(_head(run, name) for run, name in zip(runs, names, strict=True)),
        _figures(figures, names, limits or {}),
        '<h2>Over time <button id="whole" type="button">whole run</button></h2>',
        '<p class="soft">Drag to zoom, double-click to see all again; names show and hide their curves. '
        "Shaded: a fault acts; numbered lines: detections.</p>",
        *(_place(number, chart) for number, chart in enumerate(charts) if chart.over_time),
        *_tables(runs, names),
        *_histograms(charts),
        *(_origin(run, name) for run, name in zip(runs, names, strict=True)),
    ]
    return "\n".join(
        [
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{_text(title)}</title>",
            f"<style>\n{_resource('report.css')}</style>\n</head>\n<body>",
            *filter(None, body),
            f'<script id="charts" type="application/json">{_json([chart.as_plain() for chart in charts])}</script>',
            f"<script>\n{_resource('report.js')}</script>\n</body>\n</html>\n",
        ]
    )


def run_names(runs: Sequence[Run]) -> list[str]:
    """What to call each run: its folder, with more of its path where that is not enough."""
    paths = [run.path.resolve() for run in runs]
    for parts in range(1, max(len(path.parts) for path in paths) + 1):
        names = ["/".join(path.parts[-parts:]) for path in paths]
        if len(set(names)) == len(set(paths)):
            break
    return [printable(name, 80) for name in names]


def _head(run: Run, name: str) -> str:
    is_good, lines = verdict(run)
    said = "".join(f"<p>{_text(line)}</p>" for line in lines)
    kind = "verdict" if is_good else "verdict bad"
    return f'<p class="soft">{_text(name)}: {_text(run.headline)}</p>\n<div class="{kind}">{said}</div>'


def _figures(figures: Sequence[Figure], names: Sequence[str], limits: Mapping[str, float]) -> str:
    over = {(figure.key, place): limit for figure, place, limit in above(figures, limits)}
    heads = ["figure", names[0]]
    for name in names[1:]:
        heads += [name, "ratio"]
    rows = []
    for each in figures:
        cells = [_cell(each.key), _number(each.values[0])]
        for place in range(1, len(names)):
            limit = over.get((each.key, place))
            kind = "n" if limit is None else "n over"
            why = "" if limit is None else f" (above {limit:g})"
            ratio = each.ratio(place)
            shown = "–" if ratio is None else f"{ratio:.4g}"
            cells += [_number(each.values[place]), f'<td class="{kind}">{shown}{why}</td>']
        rows.append(cells)
    return "<h2>Figures</h2>\n" + _table(heads, rows) if rows else ""


def _tables(runs: Sequence[Run], names: Sequence[str]) -> Iterable[str]:
    for run, name in zip(runs, names, strict=True):
        of = "" if len(runs) == 1 else f" of {name}"
        spans = [
            [
                _cell(each.what),
                _number(each.begin_s),
                _number(each.end_s),
                _cell("–" if each.noticed is None else each.noticed.detection.detector),
                _cell((each.noticed and each.noticed.detection.where) or "–"),
                _number(each.latency_ms),
                _cell("–" if each.noticed is None else each.noticed.detection.reaction.value),
            ]
            for each in fault_spans(run)[:MOST_ROWS]
        ]
        heads = ["fault", "from, s", "to, s", "first detection after it", "at", "latency, ms", "reaction"]
        if spans:
            yield f"<h2>Faults and their detections{_text(of)}</h2>\n" + _table(heads, spans)
        events = [
            [_number(each["time_s"]), _number(each["cycle"]), _cell(each["event"]), _cell(details_of(each, _PLAIN))]
            for each in run.event_list[:MOST_ROWS]
        ]
        more = len(run.event_list) - MOST_ROWS
        if events:
            yield f"<h2>Events{_text(of)}</h2>\n" + _table(["time, s", "cycle", "event", "details"], events)
        if more > 0:
            yield f"<p>And {more} more, in events.jsonl.</p>"


def _histograms(charts: Sequence[Chart]) -> Iterable[str]:
    found = [_place(number, chart) for number, chart in enumerate(charts) if not chart.over_time]
    return ['<h2 id="timing">On the wall clock</h2>', *found] if found else []


def _origin(run: Run, name: str) -> str:
    bus = run.configuration.get("emulator_summary")
    wire = bus.get("wire") if isinstance(bus, Mapping) else None
    load = ""
    if isinstance(wire, Mapping) and isinstance(wire.get("load"), float):
        load = f"<p>Load of the bus: {wire['load']:.1%} since power-on; details below.</p>"
    shown = printable(str(run.path), 300)
    record = {key: value for key, value in run.configuration.items() if key != "summary"}
    text = json.dumps(printable_values(record), indent=1, ensure_ascii=False)
    rest = "" if len(text) <= _SHOWN else f"\n… and {len(text) - _SHOWN} characters more in run.json"
    return (
        f"<h2>Where it comes from: {_text(name)}</h2>\n{load}"
        f"<p>Again, byte for byte, if it ran in lockstep: <code>canarm replay {_text(shown)} --check</code></p>\n"
        "<details><summary>Configuration, versions, command lines</summary>"
        f"<pre>{_text(text[:_SHOWN] + rest)}</pre></details>"
    )


def _place(number: int, chart: Chart) -> str:
    return f'<h3>{_text(chart.title)}</h3>\n<div class="chart" data-chart="{number}"></div>'


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{_text(each)}</th>" for each in heads)
    body = "\n".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def _cell(text: str) -> str:
    return f"<td>{_text(printable(text, 500))}</td>"


def _number(value: float | None) -> str:
    return f'<td class="n">{"–" if value is None or not math.isfinite(value) else f"{value:.6g}"}</td>'


def _text(text: str) -> str:
    return html.escape(text)


def _json(value: Any) -> str:
    """JSON that no browser takes for markup."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _resource(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")
