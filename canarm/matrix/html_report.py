"""The matrix as one self-contained HTML page: definitions, counts, and a table that sorts and filters."""

import html
from collections.abc import Iterable, Sequence
from typing import Any

from ..draws import CONFIDENCE
from . import naming, scenarios
from .judgement import DEFINITIONS, Verdict
from .naming import Part
from .shares import Share
from .table import Matrix, Row, Tally, named_right
from .text_report import as_they_should_be, out_of_date, part_of, wrong_names

_DEFINITIONS = (*DEFINITIONS, naming.DEFINITION, scenarios.DEFINITION)
_COLUMNS = {
    "tap": "tap",
    "fault": "fault",
    "family": "family",
    "dangerous": "dangerous",
    "verdict": "verdict",
    "detector": "detector",
    "where": "where",
    "latency_ms": "latency, ms",
    "reaction": "reaction",
    "clock_ms": "clock starts after, ms",
    "safe_s": "safe after, s",
    "safe_by": "safe by",
    "is_safe": "safe in time",
    "peak_error_lsb": "peak error, LSB",
    "peak_current_a": "peak current, A",
    "peak_speed_rad_s": "peak speed, rad/s",
    "growth_rad_s": "faster by, until safe, rad/s",
    "is_excused": "excused",
    "note": "note",
    "why": "why not as it should be",
    "named": "named right",
    "part": "part",
}
_OF_MANY = {
    "passed": "draws as they should be",
    "share_low": "at least",
    "share_high": "at most",
    "named_right": "draws named right",
    "named_of": "of",
    "draw": "worst draw",
    "repeat": "repeat with",
}
"""Columns of a cell that has several draws; the others are those of the worst."""
_COLOURS = {
    Verdict.TOLERATED: "#e3f1e3",
    Verdict.BOTH: "#cfe8d6",
    Verdict.DETECTED: "#dbe8f7",
    Verdict.UNDETECTABLE: "#eeeeee",
    Verdict.LATE: "#fde7c4",
    Verdict.MISSED: "#f6c6c2",
    Verdict.BROKEN: "#e9c8ef",
}
_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 1.5em; color: #1c1c1c; }
h1 { font-size: 1.3em; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .2em 1em; max-width: 75em; }
dt { font-weight: 600; } dd { margin: 0; }
table { border-collapse: collapse; margin-top: 1em; }
th, td { border: 1px solid #bbb; padding: .15em .5em; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
#cells th { position: sticky; top: 0; background: #fff; cursor: pointer; }
#cells th[data-order="1"]::after { content: " ▲"; } #cells th[data-order="-1"]::after { content: " ▼"; }
td.unsafe { font-weight: 700; }
input, select { font: inherit; padding: .2em .4em; }
"""
_SCRIPT = """
const table = document.getElementById("cells"), body = table.tBodies[0];
const text = document.getElementById("text"), verdict = document.getElementById("verdict");
const shown = document.getElementById("shown");
function filter() {
  const wanted = text.value.toLowerCase().split(/\\s+/).filter(Boolean);
  let count = 0;
  for (const row of body.rows) {
    const content = row.textContent.toLowerCase();
    const kind = !verdict.value || row.dataset.verdict === verdict.value
      || (verdict.value === "!" && row.dataset.passes === "no");
    row.hidden = !(kind && wanted.every(word => content.includes(word)));
    count += row.hidden ? 0 : 1;
  }
  shown.textContent = count + " of " + body.rows.length + " cells";
}
for (const head of table.tHead.rows[0].cells) head.onclick = () => {
  const order = head.dataset.order === "1" ? -1 : 1, place = head.cellIndex;
  for (const other of table.tHead.rows[0].cells) delete other.dataset.order;
  head.dataset.order = order;
  const key = row => row.cells[place].textContent;
  const isNumber = [...body.rows].every(row => key(row) === "" || !isNaN(key(row)));
  const compare = (one, two) => {
    const a = key(one), b = key(two);
    if (a === "" || b === "") return (a === "") - (b === "");
    return order * (isNumber ? a - b : a.localeCompare(b));
  };
  body.append(...[...body.rows].sort(compare));
};
text.oninput = verdict.onchange = filter;
filter();
"""


def as_html(matrix: Matrix) -> str:
    """The page. The same matrix gives the same bytes."""
    cells = matrix.cells
    columns = _COLUMNS | (_OF_MANY if len(matrix.rows) > len(cells) else {})
    title = html.escape(f"{'PARTIAL fault' if matrix.runs_left else 'Fault'} matrix: {matrix.title}")
    colours = "\n".join(f'tr[data-verdict="{verdict.value}"] td.verdict {{ background: {colour}; }}'
                        for verdict, colour in _COLOURS.items())  # fmt: skip
    options = "".join(f"<option>{verdict.value}</option>" for verdict in matrix.counts)
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f"<title>{title}</title>",
            f"<style>{_STYLE}{colours}\n</style></head><body>",
            f"<h1>{title}</h1>",
            *_facts(matrix),
            "<details open><summary>What the words mean</summary><dl>",
            *(f"<dt>{html.escape(term)}</dt><dd>{html.escape(text)}</dd>" for term, text in _DEFINITIONS),
            "</dl></details>",
            '<p><label>Filter: <input id="text" type="search" placeholder="words, such as joint2 stuck"></label>',
            '<select id="verdict"><option value="">every verdict</option>'
            f'<option value="!">not as it should be</option>{options}</select> <span id="shown"></span></p>',
            '<table id="cells"><thead><tr>',
            *(f"<th>{html.escape(heading)}</th>" for heading in columns.values()),
            "</tr></thead><tbody>",
            *(_row(cell, columns) for cell in cells),
            "</tbody></table>",
            f"<script>{_SCRIPT}</script>",
            "</body></html>",
            "",
        ]
    )


def _facts(matrix: Matrix) -> Iterable[str]:
    rows = matrix.rows
    if matrix.runs_left:
        yield f"<p><strong>{part_of(matrix)}: the other cells are missing.</strong></p>"
    yield "".join(f"<p>{html.escape(line)}.</p>" for line in as_they_should_be(matrix))
    yield f"<table><tr><th>verdict</th><th>runs</th><th>share</th><th>{CONFIDENCE:.0%} bounds</th></tr>"
    for verdict, count in matrix.counts.items():
        share = Share(count, len(rows))
        yield (
            f'<tr data-verdict="{verdict.value}"><td class="verdict">{verdict.value}</td>'
            f'<td class="number">{count}</td><td class="number">{share.value:.1%}</td>'
            f"<td>{share.low:.1%} to {share.high:.1%}</td></tr>"
        )
    yield "</table>"
    yield from _names(rows)
    if matrix.fault_free_runs:
        yield f"<p>{matrix.alarmed_runs} of {matrix.fault_free_runs} fault-free runs raised an alarm.</p><ul>"
        for alarm in matrix.false_alarms:
            yield f"<li>{html.escape(f'{alarm.run}: {alarm.detector} {alarm.where} in cycle {alarm.cycle}')}</li>"
        yield "</ul>"
    for text in out_of_date(rows):
        yield f"<p>Declared undetectable, but no such cell: {html.escape(text)}</p>"


def _names(rows: Sequence[Row]) -> Iterable[str]:
    if not named_right(rows).count:
        return
    yield "<table><tr><th>part</th><th>named right by the first detection</th><th>aim</th><th>else</th></tr>"
    for part in Part:
        of_part = [row for row in rows if row.part == part.value]
        share = named_right(of_part)
        if share.count:
            wrong = html.escape("; ".join(wrong_names(of_part)))
            yield f"<tr><td>{part.value}</td><td>{share}</td><td>{part.aim:.0%}</td><td>{wrong}</td></tr>"
    yield "</table>"


def _row(cell: Tally, columns: Iterable[str]) -> str:
    values = cell.as_plain()
    cells = "".join(_cell(values[name], name) for name in columns)
    passes = "yes" if cell.worst.passes else "no"
    return f'<tr data-verdict="{cell.worst.verdict.value}" data-passes="{passes}">{cells}</tr>'


def _cell(value: Any, name: str) -> str:
    if name == "verdict":
        return f'<td class="verdict">{html.escape(value.value)}</td>'
    if isinstance(value, bool):
        marked = ' class="unsafe"' if name == "is_safe" and not value else ""
        return f"<td{marked}>{'yes' if value else 'no'}</td>"
    if isinstance(value, (int, float)):
        return f'<td class="number">{value:g}</td>'
    return f"<td>{'' if value is None else html.escape(value)}</td>"
