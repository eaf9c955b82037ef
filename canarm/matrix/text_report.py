"""The matrix for a terminal: counts by family, right names, and the cells that are not as they should be."""

from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import median

from .judgement import Verdict
from .naming import Part
from .shares import Share
from .table import WRONG, Matrix, Row, Tally, named_right
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
    """Summary by family and by names, then what is not as it should be, cell by cell; then false alarms."""
    cells = matrix.cells
    lines = [matrix.title, "", *_families(matrix.rows), "", *_names(matrix.rows)]
    if matrix.runs_left:
        lines += [f"PARTIAL: {part_of(matrix)}", ""]
    failed = [cell for cell in cells if not cell.worst.passes]
    if failed:
        lines += ["not as it should be:", *_listed(failed), ""]
    if matrix.fault_free_runs:
        lines.append(f"{matrix.alarmed_runs} of {matrix.fault_free_runs} fault-free runs raised an alarm")
        lines += [f"  {each.run}: {each.detector} {each.where} in cycle {each.cycle}" for each in matrix.false_alarms]
    lines += [f"declared undetectable, but no such cell: {text}" for text in out_of_date(matrix.rows)]
    share = matrix.counts.get(Verdict.UNDETECTABLE, 0) / max(len(matrix.rows), 1)
    if share > HIGHEST_SHARE:
        lines.append(f"{share:.0%} of the runs are declared undetectable; must be at most {HIGHEST_SHARE:.0%}")
    return "\n".join([*lines, *as_they_should_be(matrix)])


def as_they_should_be(matrix: Matrix) -> list[str]:
    """What was noticed how fast, how many cells are as they should be, and of several draws how many runs."""
    cells, lines = matrix.cells, [*_noticed(matrix.rows)]
    good = sum(cell.worst.passes for cell in cells)
    if len(matrix.rows) == len(cells):
        return [*lines, f"{good} of {len(cells)} cells as they should be"]
    runs = Share(len(matrix.rows) - len(matrix.failed), len(matrix.rows))
    return [*lines, f"{good} of {len(cells)} cells as they should be in every draw", f"runs as they should be: {runs}"]


def _noticed(rows: Sequence[Row]) -> Iterable[str]:
    dangers = [row for row in rows if row.dangerous]
    unnoticed = [row for row in dangers if row.verdict is Verdict.MISSED]
    if dangers:
        yield f"dangerous and unnoticed: {len(unnoticed)} of {len(dangers)} dangerous runs"
    slowest = max((row for row in rows if _took(row) is not None), key=lambda row: _took(row) or 0.0, default=None)
    if slowest is not None:
        middle = median(took for took in map(_took, rows) if took is not None)
        yield f"noticed, where not tolerated: median {middle:g} ms, worst {_took(slowest):g} ms ({slowest.name})"


def _took(row: Row) -> float | None:
    """The latency in ms of a detection that was called for."""
    return None if row.verdict in (Verdict.TOLERATED, Verdict.BOTH) else row.latency_ms


def part_of(matrix: Matrix) -> str:
    """How much of an interrupted matrix was run."""
    return f"interrupted after {matrix.runs} of {matrix.runs + matrix.runs_left} runs"


def out_of_date(rows: Sequence[Row]) -> list[str]:
    """Declarations of undetectable faults that no cell of the run needs any more."""
    stale = []
    for each in DECLARED_UNDETECTABLE:
        covered = [row for row in rows if each.covers(row.tap, row.fault)]
        if covered and all(row.verdict is not Verdict.UNDETECTABLE for row in covered):
            stale.append(f"{each.tap} {each.fault}")
    return stale


def _families(rows: Sequence[Row]) -> list[str]:
    names = list(dict.fromkeys(row.family for row in rows))
    head = (
        f"{'family':<12}{'runs':>7}"
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


def _names(rows: Sequence[Row]) -> list[str]:
    """Which share of each part's faults the first detection named right, and what the others were called."""
    lines = [line for part in Part for line in _names_of(part, [row for row in rows if row.part == part.value])]
    return ["named right by the first detection:", *lines, ""] if lines else []


def _names_of(part: Part, rows: Sequence[Row]) -> list[str]:
    share = named_right(rows)
    if not share.count:
        return []
    short = "" if share.value >= part.aim else f"; aim {part.aim:.0%}"
    called = [f"    {text}" for text in wrong_names(rows)]
    return [f"  {part.value:<16}{share}{short}", *called]


def wrong_names(rows: Iterable[Row]) -> list[str]:
    """Detectors that named a fault wrong, from the most frequent on, each with how often and for which faults."""
    wrong = [row for row in rows if row.named == WRONG]
    faults: dict[str, Counter[str]] = {}
    for row in wrong:
        faults.setdefault(row.detector, Counter())[row.fault] += 1
    often = sorted(faults.items(), key=lambda each: (-each[1].total(), each[0]))
    return [
        f"{counts.total()} called {detector}: {', '.join(f'{fault} {count}' for fault, count in counts.most_common())}"
        for detector, counts in often
    ]


def _listed(cells: Sequence[Tally]) -> list[str]:
    width = max(len(cell.worst.name) for cell in cells)
    lines = []
    for cell in cells:
        worst = cell.worst
        many = f"{cell.share.hits} of {cell.share.count}, worst draw {worst.draw}: " if len(cell.rows) > 1 else ""
        lines.append(f"  {worst.name:<{width}}  {many}{_what(worst)}")
        lines += [f"  {'':<{width}}  {worst.repeat}"] if many else []
    return lines


def _what(row: Row) -> str:
    phrases = [phrase for phrase in (row.why, row.note) if phrase]
    if row.detector:
        phrases.append(f"first {row.detector} after {row.latency_ms:g} ms, {row.reaction}")
    return f"{row.verdict.value:<19}{'; '.join(phrases)}"
