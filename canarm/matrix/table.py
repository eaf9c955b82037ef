"""A row of the matrix as plain values, its CSV file, and the counts. Knows nothing of how a run is made or judged."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

from canarm_protocol.shown import named_error

from .judgement import Findings, Verdict
from .plan import MatrixCell
from .reasons import why
from .undetectable import BEYOND_CONTROL, declared


@dataclass(frozen=True, slots=True)
class Row:
    """A row: which fault, what became of it. Empty where there is nothing of the kind; times in ms, safe_s in s.

    `why` is what keeps the cell from being as it should be, `note` an excuse, or what has broken the run off.
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
    is_excused: bool = False
    note: str = ""
    why: str = ""

    @classmethod
    def of(cls, cell: MatrixCell, found: Findings) -> Self:
        """What was found, with the reason where it is declared undetectable, or beyond any controller."""
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
            is_excused=is_excused,
            note="; ".join(notes),
            why=why(found),
        )

    @classmethod
    def broken(cls, cell: MatrixCell, error: BaseException) -> Self:
        """The run broke off with `error`."""
        note = named_error(error)
        verdict = Verdict.BROKEN
        return cls(cell.tap, cell.fault, cell.family, cell.is_dangerous, verdict, is_safe=False, note=note)

    @property
    def name(self) -> str:
        """Tap and fault."""
        return f"{self.tap} {self.fault}"

    @property
    def passes(self) -> bool:
        """Tolerated, detected in time or declared, and safe in time where that was called for and can be.

        What cannot be detected has to be safe all the same.
        """
        return self.verdict.passes and (self.is_safe or self.is_excused)

    def as_plain(self) -> dict[str, Any]:
        """Its columns by name."""
        return {name: getattr(self, name) for name in COLUMNS}


COLUMNS = tuple(each.name for each in fields(Row))


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """Something that was noticed in a fault-free run: in which run, by which detector, where, when."""

    run: str
    detector: str
    where: str
    cycle: int


@dataclass(frozen=True, slots=True)
class Matrix:
    """The whole: rows in the order of the plan, and what the fault-free runs gave.

    `runs_left` is how many runs were not made: not 0 where the campaign was interrupted.
    """

    title: str
    rows: tuple[Row, ...]
    fault_free_runs: int
    false_alarms: tuple[FalseAlarm, ...]
    runs_left: int = 0

    @property
    def counts(self) -> dict[Verdict, int]:
        """Cells by verdict, from good to bad."""
        counted = Counter(row.verdict for row in self.rows)
        return {verdict: counted[verdict] for verdict in Verdict if counted[verdict]}

    @property
    def failed(self) -> list[Row]:
        """Rows that are not as they should be."""
        return [row for row in self.rows if not row.passes]

    @property
    def alarmed_runs(self) -> int:
        """Fault-free runs in which anything was noticed."""
        return len({each.run for each in self.false_alarms})

    @property
    def passes(self) -> bool:
        """Whether it is whole, every row is as it should be, and no fault-free run raised an alarm."""
        return not (self.runs_left or self.failed or self.false_alarms)

    @property
    def runs(self) -> int:
        """Runs that were made, with a fault and without."""
        return len(self.rows) + self.fault_free_runs


def as_csv(rows: Iterable[Row], columns: Sequence[str] = COLUMNS) -> str:
    """The rows as CSV with a header; the same rows give the same bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell_text(getattr(row, name)) for name in columns] for row in rows)
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
