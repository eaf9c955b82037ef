"""The matrix as one self-contained HTML page: definitions, counts, and a table that sorts and filters."""

import html
from collections.abc import Iterable
from typing import Any

from .judgement import DEFINITIONS, Verdict
from .table import Matrix, Row
from .text_report import out_of_date, part_of

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
}
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
            *(f"<dt>{html.escape(term)}</dt><dd>{html.escape(text)}</dd>" for term, text in DEFINITIONS),
            "</dl></details>",
            '<p><label>Filter: <input id="text" type="search" placeholder="words, such as joint2 stuck"></label>',
            '<select id="verdict"><option value="">every verdict</option>'
            f'<option value="!">not as it should be</option>{options}</select> <span id="shown"></span></p>',
            '<table id="cells"><thead><tr>',
            *(f"<th>{html.escape(heading)}</th>" for heading in _COLUMNS.values()),
            "</tr></thead><tbody>",
            *(_row(row) for row in matrix.rows),
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
    yield f"<p>{len(rows) - len(matrix.failed)} of {len(rows)} cells are as they should be.</p>"
    yield "<table><tr><th>verdict</th><th>cells</th><th>share</th></tr>"
    for verdict, count in matrix.counts.items():
        yield (
            f'<tr data-verdict="{verdict.value}"><td class="verdict">{verdict.value}</td>'
            f'<td class="number">{count}</td><td class="number">{count / len(rows):.1%}</td></tr>'
        )
    yield "</table>"
    if matrix.fault_free_runs:
        yield f"<p>{matrix.alarmed_runs} of {matrix.fault_free_runs} fault-free runs raised an alarm.</p><ul>"
        for alarm in matrix.false_alarms:
            yield f"<li>{html.escape(f'{alarm.run}: {alarm.detector} {alarm.where} in cycle {alarm.cycle}')}</li>"
        yield "</ul>"
    for text in out_of_date(rows):
        yield f"<p>Declared undetectable, but no such cell: {html.escape(text)}</p>"


def _row(row: Row) -> str:
    cells = "".join(_cell(row, name) for name in _COLUMNS)
    passes = "yes" if row.passes else "no"
    return f'<tr data-verdict="{row.verdict.value}" data-passes="{passes}">{cells}</tr>'


def _cell(row: Row, name: str) -> str:
    value: Any = getattr(row, name)
    if name == "verdict":
        return f'<td class="verdict">{html.escape(value.value)}</td>'
    if isinstance(value, bool):
        marked = ' class="unsafe"' if name == "is_safe" and not value else ""
        return f"<td{marked}>{'yes' if value else 'no'}</td>"
    if isinstance(value, float):
        return f'<td class="number">{value:g}</td>'
    return f"<td>{'' if value is None else html.escape(value)}</td>"
