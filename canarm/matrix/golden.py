"""The golden copy of a matrix: verdict, detector and latency of every run, and what has changed against it."""

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

from .table import Row, as_csv

GOLDEN_COLUMNS = ("tap", "fault", "draw", "verdict", "detector", "latency_ms")


@dataclass(frozen=True, slots=True)
class Expected:
    """What the golden copy says of a run."""

    verdict: str
    detector: str
    latency_ms: float | None

    @classmethod
    def of(cls, row: Row) -> Self:
        """The entry for a run."""
        return cls(row.verdict.value, row.detector, row.latency_ms)

    def __str__(self) -> str:
        if self.latency_ms is None:
            return self.verdict
        return f"{self.verdict} by {self.detector} after {self.latency_ms:g} ms"

    def agrees(self, other: "Expected", cycle_ms: float) -> bool:
        """Whether all is equal, latency to within a cycle."""
        if (self.verdict, self.detector) != (other.verdict, other.detector):
            return False
        if self.latency_ms is None or other.latency_ms is None:
            return self.latency_ms is other.latency_ms
        return abs(self.latency_ms - other.latency_ms) <= cycle_ms * (1.0 + 1e-6)


def golden_text(rows: Iterable[Row]) -> str:
    """The golden copy of `rows`."""
    return as_csv(rows, GOLDEN_COLUMNS)


def read_golden(text: str) -> dict[str, Expected]:
    """The golden copy as "TAP FAULT, draw N" and what is expected. Raises `ValueError` for a text that is none."""
    reader = csv.DictReader(io.StringIO(text))
    if tuple(reader.fieldnames or ()) != GOLDEN_COLUMNS:
        raise ValueError(f"columns are {reader.fieldnames}; must be {', '.join(GOLDEN_COLUMNS)}")
    return {
        _name(f"{each['tap']} {each['fault']}", each["draw"]): Expected(
            each["verdict"], each["detector"], float(each["latency_ms"]) if each["latency_ms"] else None
        )
        for each in reader
    }


def draws_of(golden: Iterable[str]) -> int:
    """How many draws a cell has in a golden copy, from its names."""
    return max(int(name.rpartition(" ")[2]) for name in golden)


def differences(rows: Iterable[Row], golden: dict[str, Expected], cycle_ms: float) -> list[str]:
    """One line for every run that differs, is new, or is gone; in the order of the rows."""
    found, lines = {_name(row.name, row.draw): Expected.of(row) for row in rows}, []
    for name, now in found.items():
        before = golden.get(name)
        if before is None:
            lines.append(f"+ {name}: {now}")
        elif not now.agrees(before, cycle_ms):
            lines.append(f"! {name}: was {before}; is {now}")
    lines += [f"- {name}: was {before}" for name, before in golden.items() if name not in found]
    return lines


def _name(cell: str, draw: int | str) -> str:
    return f"{cell}, draw {draw}"
