"""A study as one HTML page, in the frame of a run's report: heat maps, distributions, and the worst runs."""

import math
from collections.abc import Iterable
from itertools import combinations

import numpy as np

from canarm_protocol.shown import printable

from ..draws import Choice
from ..runs.report.charts import COLOURS, Chart, Series, thinned
from ..runs.report.html_parts import cell_of, chart_place, escaped, number_cell, page_of, table_of
from .findings import JUDGED, METRICS, Findings
from .heat import HeatMap, heat_map
from .one_run import DONE
from .plan import Axis, Study

PAGE_FILE = "study.html"
MOST_MAPS = 12
MOST_CURVES = COLOURS
_HUES = ("#dbeafe", "#93c5fd", "#fde68a", "#fdba74", "#f87171")
"""From the best to the worst; the number stands in every field as well."""


def study_page(study: Study, found: Findings) -> str:
    """The page. The same findings give the same bytes."""
    charts = list(_distributions(study, found))
    body = [
        f"<h1>{escaped(f'canarm study: {printable(study.title)}')}</h1>",
        _head(study, found),
        *_maps(study, found),
        '<h2>Distributions <button id="whole" type="button">whole range</button></h2>',
        '<p class="soft">Share of the runs, ended as planned, whose figure is at most that. Drag to zoom, double-click '
        "to see all again; names show and hide their curves.</p>",
        *(chart_place(number, chart) for number, chart in enumerate(charts)),
        "<h2>Worst runs</h2>",
        _worst(study, found),
    ]
    return page_of(f"canarm study: {printable(study.title)}", body, charts)


def _head(study: Study, found: Findings) -> str:
    is_good = set(found.states) == {DONE}
    axes = "; ".join(printable(str(axis), 120) for axis in study.axes)
    said = "".join(f"<p>{escaped(line)}</p>" for line in found.outcome())
    missing = len(study) - found.runs
    part = f"<p>{missing} {'runs are' if missing != 1 else 'run is'} still to be done.</p>" if missing else ""
    how = f"{study.sample.value} of {len(study)} run{'s' * (len(study) != 1)} of {study.base.seconds:g} s each: {axes}"
    return f'<p class="soft">{escaped(how)}</p>\n<div class="verdict{"" if is_good else " bad"}">{said}{part}</div>'


def _maps(study: Study, found: Findings) -> Iterable[str]:
    axes = [axis for axis in study.axes if len(np.unique(found.columns[axis.name])) > 1]
    pairs = list(combinations(axes, 2)) or [(axis, axis) for axis in axes]
    if not pairs:
        return
    shown = next((metric for metric in METRICS if found.known(metric).any()), JUDGED)
    yield "<h2>Heat maps</h2>"
    yield (
        f'<p class="soft">Mean of the {escaped(METRICS[shown])}, of the worst joint, over all runs of a field that '
        "ended as planned and have it; in brackets the share that did not end so, where there is any.</p>"
    )
    for across, down in pairs[:MOST_MAPS]:
        yield _map(across, heat_map(across, down, found, shown))
    if len(pairs) > MOST_MAPS:
        yield f"<p>And {len(pairs) - MOST_MAPS} pairs of settings more, in the table.</p>"


def _map(across: Axis, found: HeatMap) -> str:
    known = found.means[np.isfinite(found.means)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    head = "".join(f"<th>{escaped(printable(name, 40))}</th>" for name in found.across)
    rows = []
    for name, means, lost, counts in zip(found.down, found.means, found.lost, found.counts, strict=True):
        fields = "".join(
            _field(float(m), float(s), int(n), low, high) for m, s, n in zip(means, lost, counts, strict=True)
        )
        rows.append(f"<tr><th>{escaped(printable(name, 40))}</th>{fields}</tr>")
    title = printable(found.title, 120)
    corner = escaped(printable(across.name, 60))
    return (
        f'<h3>{escaped(title)}</h3>\n<table class="heat"><thead><tr><th>{corner} →</th>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _field(mean: float, lost: float, count: int, low: float, high: float) -> str:
    if not count:
        return '<td class="n">–</td>'
    share = f" ({lost:.0%})" if lost else ""
    if not math.isfinite(mean) and lost < 1.0:
        return f'<td class="n">–{share}</td>'
    if not math.isfinite(mean):
        return f'<td class="n" style="background:{_HUES[-1]};color:#111">–{share}</td>'
    place = 0.0 if high <= low else (mean - low) / (high - low)
    hue = _HUES[min(int(place * len(_HUES)), len(_HUES) - 1)]
    return f'<td class="n" style="background:{hue};color:#111">{mean:.3g}{share}</td>'


def _distributions(study: Study, found: Findings) -> Iterable[Chart]:
    apart = next(
        (axis for axis in study.axes if isinstance(axis, Choice) and 1 < len(axis.values) <= MOST_CURVES), None
    )
    for metric, title in METRICS.items():
        values, series = found.columns[metric], []
        is_known = found.is_done & np.isfinite(values)
        for place, name in enumerate(["all runs"] if apart is None else map(str, apart.values)):
            mine = is_known if apart is None else is_known & (found.columns[apart.name] == place)
            ordered = np.sort(values[mine])
            if len(ordered):
                x, y = thinned(ordered, np.arange(1, len(ordered) + 1) / len(ordered))
                shares: list[float | None] = [float(f"{each:.6g}") for each in y]
                figures = [float(f"{each:.6g}") for each in x]
                series.append(Series(printable(name, 60), figures, shares, place % COLOURS))
        if series:
            by = "" if apart is None else f", by {printable(apart.name, 60)}"
            yield Chart(f"{title}, worst joint{by}", series, title, "", over_time=False)


def _worst(study: Study, found: Findings) -> str:
    heads = ["run", "state", METRICS[JUDGED], *(axis.name for axis in study.axes), "why", "again"]
    rows = [
        [
            number_cell(case.number),
            cell_of(case.state),
            number_cell(case.figure),
            *(_value(case.values.get(axis.name)) for axis in study.axes),
            cell_of(case.reason or ""),
            f"<td><code>{escaped(printable(case.command, 2000))}</code></td>",
        ]
        for case in found.worst
    ]
    return table_of([printable(head, 60) for head in heads], rows)


def _value(value: object) -> str:
    return number_cell(float(value)) if isinstance(value, int | float) else cell_of("" if value is None else str(value))
