"""The matrix for a terminal: counts by family, and the cells that are not as they should be."""

from collections.abc import Sequence

from .judgement import Verdict
from .table import Matrix, Row
from .undetectable import DECLARED_UNDETECTABLE, HIGHEST_SHARE

_HEADINGS = {
    Verdict.TOLERATED: "tolerated",
    Verdict.BOTH: "both",
    Verdict.DETECTED: "detected",
    Verdict.UNDETECTABLE: "undetectable",
    Verdict.LATE: "late",
    Verdict.MISSED: "missed",
    Verdict.BROKEN: "broken",
}


def as_text(matrix: Matrix) -> str:
    """Summary by family, then one line for each cell that does not pass; then false alarms."""
    lines = [matrix.title, "", *_families(matrix.rows), ""]
    if matrix.runs_left:
        lines += [f"PARTIAL: {part_of(matrix)}", ""]
    if matrix.failed:
        lines += ["not as it should be:", *_listed(matrix.failed), ""]
    if matrix.fault_free_runs:
        lines.append(f"{matrix.alarmed_runs} of {matrix.fault_free_runs} fault-free runs raised an alarm")
        lines += [f"  {each.run}: {each.detector} {each.where} in cycle {each.cycle}" for each in matrix.false_alarms]
    lines += [f"declared undetectable, but no such cell: {text}" for text in out_of_date(matrix.rows)]
    share = matrix.counts.get(Verdict.UNDETECTABLE, 0) / max(len(matrix.rows), 1)
    if share > HIGHEST_SHARE:
        lines.append(f"{share:.0%} of the cells are declared undetectable; must be at most {HIGHEST_SHARE:.0%}")
    lines.append(f"{len(matrix.rows) - len(matrix.failed)} of {len(matrix.rows)} cells as they should be")
    return "\n".join(lines)


def part_of(matrix: Matrix) -> str:
    """How much of an interrupted matrix there is."""
    return f"interrupted after {matrix.runs} of {matrix.runs + matrix.runs_left} runs"


def out_of_date(rows: Sequence[Row]) -> list[str]:
    """Declarations of undetectable faults that cover cells of the run, none of which needs it."""
    stale = []
    for each in DECLARED_UNDETECTABLE:
        covered = [row for row in rows if each.covers(row.tap, row.fault)]
        if covered and all(row.verdict is not Verdict.UNDETECTABLE for row in covered):
            stale.append(f"{each.tap} {each.fault}")
    return stale


def _families(rows: Sequence[Row]) -> list[str]:
    names = list(dict.fromkeys(row.family for row in rows))
    head = (
        f"{'family':<12}{'cells':>7}"
        + "".join(f"{text:>14}" for text in _HEADINGS.values())
        + f"{'unsafe':>9}{'excused':>9}"
    )
    return [head, *(_family(name, [row for row in rows if row.family == name]) for name in names), _family("all", rows)]


def _family(name: str, rows: Sequence[Row]) -> str:
    counts = [sum(row.verdict is verdict for row in rows) for verdict in _HEADINGS]
    unsafe = sum(not (row.is_safe or row.is_excused) for row in rows)
    excused = sum(row.is_excused for row in rows)
    texts = "".join(f"{count or '-':>14}" for count in counts)
    return f"{name:<12}{len(rows):>7}{texts}{unsafe or '-':>9}{excused or '-':>9}"


def _listed(rows: Sequence[Row]) -> list[str]:
    width = max(len(row.name) for row in rows)
    return [f"  {row.name:<{width}}  {_what(row)}" for row in rows]


def _what(row: Row) -> str:
    phrases = [phrase for phrase in (row.why, row.note) if phrase]
    if row.detector:
        phrases.append(f"first {row.detector} after {row.latency_ms:g} ms, {row.reaction}")
    return f"{row.verdict.value:<19}{'; '.join(phrases)}"
