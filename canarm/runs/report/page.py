"""Runs as one HTML page that needs nothing else: no network, no other file.

What is drawn and what is said is decided elsewhere.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from canarm_protocol.shown import printable, printable_values

from ..again import demo_again
from ..run import EMULATOR_SUMMARY, Run, shown_details
from .charts import Chart, charts_of
from .figures import Figure, above, figures_of, unlike
from .html_parts import cell_of, chart_place, escaped, number_cell, page_of, table_of
from .pose import pose_charts
from .story import Span, spans_of, verdict

MOST_ROWS = 300
"""Longest table of events."""
_SHOWN = 20000
"""Characters of a configuration that are shown."""


def report_page(runs: Sequence[Run], limits: Mapping[str, float] | None = None) -> str:
    """The page of one run, or of several, which are compared with the first.

    `limits` of ratios, as `above` takes them, are marked. Raises `UsageError` for a limit of no figure.
    """
    names = run_names(runs)
    charts = charts_in_page(runs)
    figures = figures_of(runs)
    title = f"canarm: {names[0]}" if len(runs) == 1 else f"canarm: {len(runs)} runs"
    body = [
        f"<h1>{escaped(title)}</h1>",
        *(_head(run, name) for run, name in zip(runs, names, strict=True)),
        _figures(figures, names, limits or {}, unlike(runs, names)),
        '<h2>Over time <button id="whole" type="button">whole run</button></h2>',
        '<p class="soft">Drag to zoom, double-click to see all again; names show and hide their curves. Shaded: a '
        f"fault acts; {'numbered lines: detections' if len(runs) == 1 else 'the pointer on it says of which run'}.</p>",
        *(chart_place(number, chart) for number, chart in enumerate(charts) if chart.over_time),
        *_tables(runs, names),
        *_histograms(charts),
        *(_origin(run, name) for run, name in zip(runs, names, strict=True)),
    ]
    return page_of(title, body, charts)


def charts_in_page(runs: Sequence[Run]) -> list[Chart]:
    """The charts of the page, in its order but for those that are not over time."""
    names = run_names(runs)
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged row may hold any number
        return [*charts_of(runs, names), *pose_charts(runs, names)]


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
    said = "".join(f"<p>{escaped(line)}</p>" for line in lines)
    kind = "verdict" if is_good else "verdict bad"
    return f'<p class="soft">{escaped(name)}: {escaped(run.headline)}</p>\n<div class="{kind}">{said}</div>'


def _figures(figures: Sequence[Figure], names: Sequence[str], limits: Mapping[str, float], caution: str | None) -> str:
    over = {(figure.key, place): limit for figure, place, limit in above(figures, limits)}
    heads = ["figure", names[0]]
    for name in names[1:]:
        heads += [name, "ratio"]
    rows = []
    for each in figures:
        cells = [cell_of(each.key), number_cell(each.values[0])]
        for place in range(1, len(names)):
            limit = over.get((each.key, place))
            kind = "n" if limit is None else "n over"
            why = "" if limit is None else f" (above {limit:g})"
            ratio = each.ratio(place)
            shown = "–" if ratio is None or not math.isfinite(ratio) else f"{ratio:.4g}"
            cells += [number_cell(each.values[place]), f'<td class="{kind}">{shown}{why}</td>']
        rows.append(cells)
    said = "" if caution is None else f'<div class="verdict bad"><p>{escaped(caution)}</p></div>\n'
    return f"<h2>Figures</h2>\n{said}{table_of(heads, rows)}" if rows else ""


def _tables(runs: Sequence[Run], names: Sequence[str]) -> Iterable[str]:
    for run, name in zip(runs, names, strict=True):
        of = "" if len(runs) == 1 else f" of {name}"
        spans = [
            [
                cell_of(each.what),
                number_cell(each.begin_s),
                number_cell(each.end_s),
                cell_of(_detector_of(each)),
                cell_of((each.noticed and each.noticed.detection.where) or "–"),
                number_cell(each.latency_ms),
                cell_of("–" if each.noticed is None else each.noticed.detection.reaction.value),
            ]
            for each in spans_of(run)[:MOST_ROWS]
        ]
        heads = ["fault", "from, s", "to, s", "first detection after it", "at", "latency, ms", "reaction"]
        if spans:
            yield f"<h2>Faults and their detections{escaped(of)}</h2>\n" + table_of(heads, spans)
        events = [
            [
                number_cell(each["time_s"]),
                number_cell(each["cycle"]),
                cell_of(each["event"]),
                _details(each),
            ]
            for each in run.event_list[:MOST_ROWS]
        ]
        more = len(run.event_list) - MOST_ROWS
        if events:
            yield f"<h2>Events{escaped(of)}</h2>\n" + table_of(["time, s", "cycle", "event", "details"], events)
        if more > 0:
            yield f"<p>And {more} more, in events.jsonl.</p>"


def _details(event: Mapping[str, Any]) -> str:
    """The cell with what else an event says; a fault script line by line."""
    shown, lines = shown_details(event)
    script = f"<pre>{escaped(chr(10).join(lines))}</pre>" if lines else ""
    return f"<td>{escaped(shown)}{script}</td>"


def _histograms(charts: Sequence[Chart]) -> Iterable[str]:
    found = [chart_place(number, chart) for number, chart in enumerate(charts) if not chart.over_time]
    return ['<h2 id="timing">On the wall clock</h2>', *found] if found else []


def _origin(run: Run, name: str) -> str:
    bus = run.configuration.get(EMULATOR_SUMMARY)
    wire = bus.get("wire") if isinstance(bus, Mapping) else None
    load = ""
    if isinstance(wire, Mapping) and isinstance(wire.get("load"), float):
        load = f"<p>Load of the bus: {wire['load']:.1%} since power-on; details below.</p>"
    shown = printable(str(run.path), 300)
    record = {key: value for key, value in run.configuration.items() if key != "summary"}
    text = json.dumps(printable_values(record), indent=1, ensure_ascii=False)
    rest = "" if len(text) <= _SHOWN else f"\n… and {len(text) - _SHOWN} characters more in run.json"
    again = demo_again(run)
    line = ""
    if again is not None:
        remarks = "".join(f'<p class="soft">{escaped(each)}</p>' for each in again.remarks)
        line = f"<p>Again: <code>{escaped(again.line)}</code></p>{remarks}\n"
    return (
        f"<h2>Where it comes from: {escaped(name)}</h2>\n{load}{line}"
        f"<p>Again, byte for byte, if it ran in lockstep: <code>canarm replay {escaped(shown)} --check</code></p>\n"
        "<details><summary>Configuration, versions, command lines</summary>"
        f"<pre>{escaped(text[:_SHOWN] + rest)}</pre></details>"
    )


def _detector_of(span: Span) -> str:
    if span.noticed is not None:
        return span.noticed.detection.detector
    return "the run was over" if span.is_late else "–"
