"""The figures of this run beside those of an earlier one, kept as JSON: what is slower now, beyond the spread of both.

A row is slower if its median is worse than the usual range of the earlier one, and the earlier median better than the
usual range of this one. Rows that only one of them has are told, not judged.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from machine import python_text
from measure import Ratio, Row


class Verdict(Enum):
    """What has become of a row."""

    SLOWER = "SLOWER"
    FASTER = "faster"
    SAME = "within the spread"
    NEW = "not measured then"


@dataclass(frozen=True, slots=True)
class Earlier:
    """An earlier run: what it ran on, and its ratios by suite, row and rival."""

    name: str
    machine: str
    python: str
    commit: str
    ratios: dict[tuple[str, str, str], Ratio]


class EarlierError(Exception):
    """A file is no result of the benchmarks."""


def read(path: Path) -> Earlier:
    """The run kept in `path`. Raises `EarlierError` with the file and what is wrong with it."""
    try:
        kept: Any = json.loads(path.read_text(encoding="utf-8"))
        ratios = {(row["suite"], row["what"], row["against"]): _ratio(row["ratio"]) for row in kept["rows"]}
        python = python_text(kept["python"]) if "python" in kept else "not said"
        return Earlier(str(path), str(kept["machine"]), python, str(kept["commit"]), ratios)
    except OSError as error:
        raise EarlierError(f"{path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise EarlierError(
            f"{path}: is no result of make bench ({type(error).__name__}: {error}); "
            "it keeps them in benchmarks/results/, or where --out says"
        ) from None


def _ratio(kept: dict[str, Any]) -> Ratio:
    low, high = float(kept["low"]), float(kept["high"])
    usual_low, usual_high = float(kept.get("usual_low", low)), float(kept.get("usual_high", high))
    return Ratio(float(kept["median"]), low, high, int(kept["blocks"]), usual_low, usual_high)


def judge(row: Row, then: Ratio | None) -> Verdict:
    """What has become of `row`, which was `then`."""
    if then is None:
        return Verdict.NEW
    now = row.ratio
    if then.usual_high < now.median and then.median < now.usual_low:
        return Verdict.FASTER if row.more_is_better else Verdict.SLOWER
    if now.median < then.usual_low and now.usual_high < then.median:
        return Verdict.SLOWER if row.more_is_better else Verdict.FASTER
    return Verdict.SAME


def compared(rows: Sequence[tuple[str, Row]], earlier: Earlier) -> list[str]:
    """A line for each of `rows` (suite, row), and one for each earlier row that is missing now."""
    lines = [f"{'what':<42}{'against':<42}{'then':>8}{'now':>9}{'now/then':>10}"]
    left = dict(earlier.ratios)
    for suite, row in rows:
        then = left.pop((suite, row.what, row.against), None)
        verdict = judge(row, then)
        figures = (
            f"{'-':>8}{row.ratio.median:>9.3g}{'-':>10}"
            if then is None
            else (f"{then.median:>8.3g}{row.ratio.median:>9.3g}{row.ratio.median / then.median:>10.2f}")
        )
        lines.append(f"{row.what:<42}{row.against:<42}{figures}  {verdict.value}")
    suites = {suite for suite, _ in rows}
    lines += [f"{what:<42}{against:<42}  not measured now" for suite, what, against in left if suite in suites]
    return lines


def slower(rows: Sequence[tuple[str, Row]], earlier: Earlier) -> list[str]:
    """The names of the rows that have become slower."""
    return [
        row.what
        for suite, row in rows
        if judge(row, earlier.ratios.get((suite, row.what, row.against))) is Verdict.SLOWER
    ]
