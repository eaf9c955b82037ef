"""A run of the matrix as plain values, its CSV file, and the counts. Knows nothing of how it is made or judged."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

from canarm_protocol.shown import named_error

from .judgement import Findings, Verdict
from .plan import MatrixCell
from .reasons import why
from .shares import Share
from .undetectable import BEYOND_CONTROL, declared

RIGHT, WRONG = "right", "wrong"


@dataclass(frozen=True, slots=True)
class Row:
    """A run: which fault, what became of it. Empty where there is nothing of the kind; times in ms, safe_s in s,
    grip_n the greatest force of a hand on an object.

    `why` is what keeps the cell from passing, `note` its declaration, or the error that ended the run. `part` is
    what has failed, `named` whether the first detection says so: `RIGHT`, `WRONG`, or empty where there is none or
    nobody asks. `draw` counts the scenarios from 1, `repeat` is the command that runs this again.
    """

    tap: str
    fault: str
    family: str
    dangerous: bool
    verdict: Verdict
    detector: str = ""
    where: str = ""
    latency_ms: float | None = None
    reaction: str = ""
    clock_ms: float | None = None
    safe_s: float | None = None
    safe_by: str = ""
    is_safe: bool = True
    peak_error_lsb: float | None = None
    peak_current_a: float | None = None
    peak_speed_rad_s: float | None = None
    growth_rad_s: float | None = None
    grip_n: float | None = None
    is_excused: bool = False
    note: str = ""
    why: str = ""
    part: str = ""
    named: str = ""
    draw: int = 1
    repeat: str = ""

    @classmethod
    def of(cls, cell: MatrixCell, found: Findings, is_named_right: bool | None = None) -> Self:
        """The findings, with the reason if the fault is declared undetectable or beyond any controller."""
        verdict, safety, notes, is_excused = found.verdict, found.safety, [], False
        if verdict in (Verdict.MISSED, Verdict.LATE) and (reason := declared(cell)) is not None:
            verdict = Verdict.UNDETECTABLE
            notes.append(reason.reason)
        if not found.is_safe and (reason := declared(cell, BEYOND_CONTROL)) is not None:
            is_excused = True
            notes.append(reason.reason)
        return cls(
            tap=cell.tap,
            fault=cell.fault,
            family=cell.family,
            dangerous=found.drives_arm,
            verdict=verdict,
            detector=found.first.detector if found.first else "",
            where=found.first.where if found.first else "",
            latency_ms=_milliseconds(found.latency_s),
            reaction=found.reaction,
            clock_ms=_milliseconds(found.clock_s),
            safe_s=_rounded(safety.safe_s, 4),
            safe_by=safety.by,
            is_safe=found.is_safe,
            peak_error_lsb=_rounded(found.peak_error_lsb, 3),
            peak_current_a=_rounded(found.peak_current_a, 3),
            peak_speed_rad_s=_rounded(found.peak_speed_rad_s, 3),
            growth_rad_s=None if found.clock_s is None else _rounded(safety.growth_rad_s, 3),
            grip_n=_rounded(found.grip_n, 2),
            is_excused=is_excused,
            note="; ".join(notes),
            why=why(found),
            named="" if is_named_right is None else RIGHT if is_named_right else WRONG,
        )

    @classmethod
    def broken(cls, cell: MatrixCell, error: BaseException) -> Self:
        """The row of a run that failed with `error`."""
        note = named_error(error)
        verdict = Verdict.BROKEN
        return cls(cell.tap, cell.fault, cell.family, cell.is_dangerous, verdict, is_safe=False, note=note)

    @property
    def name(self) -> str:
        """Tap and fault."""
        return f"{self.tap} {self.fault}"

    @property
    def passes(self) -> bool:
        """Tolerated, detected in time or declared; and safe in time where that is required and possible.

        An undetectable fault must be safe all the same.
        """
        return self.verdict.passes and (self.is_safe or self.is_excused)

    def as_plain(self) -> dict[str, Any]:
        """The columns by name."""
        return {name: getattr(self, name) for name in COLUMNS}


COLUMNS = tuple(each.name for each in fields(Row))


@dataclass(frozen=True, slots=True)
class Tally:
    """A cell: its runs, one a draw and in their order."""

    rows: tuple[Row, ...]

    @property
    def worst(self) -> Row:
        """The run that is furthest from what it should be; of equals the first."""
        return max(self.rows, key=_badness)

    @property
    def share(self) -> Share:
        """The share of runs that pass."""
        return Share(sum(row.passes for row in self.rows), len(self.rows))

    @property
    def named(self) -> Share:
        """The share named right of the runs that have a detection and a right name."""
        return named_right(self.rows)

    def as_plain(self) -> dict[str, Any]:
        """The columns of its worst run, and what there is to be said of all."""
        share, named = self.share, self.named
        return self.worst.as_plain() | {
            "draws": share.count,
            "passed": share.hits,
            "share_low": round(share.low, 4),
            "share_high": round(share.high, 4),
            "named_right": named.hits,
            "named_of": named.count,
        }


CELL_COLUMNS = (*COLUMNS, "draws", "passed", "share_low", "share_high", "named_right", "named_of")


def tallies(rows: Iterable[Row]) -> list[Tally]:
    """The rows cell by cell, in the order in which the cells first come."""
    gathered: dict[str, list[Row]] = {}
    for row in rows:
        gathered.setdefault(row.name, []).append(row)
    return [Tally(tuple(each)) for each in gathered.values()]


def named_right(rows: Iterable[Row]) -> Share:
    """The share named right of the rows with a name."""
    names = [row.named for row in rows if row.named]
    return Share(names.count(RIGHT), len(names))


def _badness(row: Row) -> tuple[bool, bool, int, bool, float, float]:
    is_unnoticed_danger = row.dangerous and row.verdict is Verdict.MISSED
    is_unsafe = not (row.is_safe or row.is_excused)
    rank = list(Verdict).index(row.verdict)
    return not row.passes, is_unnoticed_danger, rank, is_unsafe, row.latency_ms or 0.0, row.safe_s or 0.0


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """A detection in a fault-free run: which run, which detector, where, when."""

    run: str
    detector: str
    where: str
    cycle: int


@dataclass(frozen=True, slots=True)
class Matrix:
    """The whole: rows in the order of the plan, for each cell those of all draws, and what the fault-free runs gave.

    `runs_left` is how many runs were not made: not 0 where the campaign was interrupted.
    """

    title: str
    rows: tuple[Row, ...]
    fault_free_runs: int
    false_alarms: tuple[FalseAlarm, ...]
    runs_left: int = 0

    @property
    def cells(self) -> list[Tally]:
        """The rows of each cell, in the order of the plan."""
        return tallies(self.rows)

    @property
    def counts(self) -> dict[Verdict, int]:
        """Runs by verdict, from good to bad."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in Verdict if counted[verdict]}

    @property
    def failed(self) -> list[Row]:
        """Runs that are not as they should be."""
        return [row for row in self.rows if not row.passes]

    @property
    def alarmed_runs(self) -> int:
        """Number of fault-free runs in which anything was noticed."""
        return len({each.run for each in self.false_alarms})

    @property
    def passes(self) -> bool:
        """Whether it is complete, every row passes, and no fault-free run raised an alarm."""
        return not (self.runs_left or self.failed or self.false_alarms)

    @property
    def runs(self) -> int:
        """Number of runs made, with and without a fault."""
        return len(self.rows) + self.fault_free_runs


def as_csv(rows: Iterable[Row], columns: Sequence[str] = COLUMNS) -> str:
    """The runs as CSV with a header; the same rows give the same bytes."""
    return _csv((row.as_plain() for row in rows), columns)


def cells_csv(cells: Iterable[Tally]) -> str:
    """The cells as CSV, a line each: its worst run, and what there is to be said of all."""
    return _csv((cell.as_plain() for cell in cells), CELL_COLUMNS)


def _csv(rows: Iterable[Mapping[str, object]], columns: Sequence[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell_text(row[name]) for name in columns] for row in rows)
    return text.getvalue()


def _cell_text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    return "" if value is None else str(value)


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1e3, 3)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
