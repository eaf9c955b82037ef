"""Benchmarks against an earlier run: what counts as slower, and what of the earlier file is needed."""

import json
import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
import against
import run
from against import EarlierError, Verdict, judge
from measure import Ratio, Row

COST, SPEED = "<= 2", ">= 30"


def row(low: float, median: float, high: float, goal: str = COST, what: str = "a cycle") -> Row:
    return Row(what, "the rival", Ratio(median, low, high, 9, low, high), goal, "")


THEN = Ratio(1.0, 0.9, 1.1, 9, 0.9, 1.1)


@pytest.mark.parametrize(
    ("low", "median", "high", "cost", "speed"),
    [
        (1.2, 1.3, 1.4, Verdict.SLOWER, Verdict.FASTER),
        (0.6, 0.7, 0.8, Verdict.FASTER, Verdict.SLOWER),
        (0.95, 1.05, 1.2, Verdict.SAME, Verdict.SAME),
        (0.95, 1.2, 1.3, Verdict.SAME, Verdict.SAME),  # the earlier median lies in this one's range
        (1.05, 1.08, 1.3, Verdict.SAME, Verdict.SAME),  # this median lies in the earlier range
    ],
)
def test_a_row_is_slower_only_beyond_the_spread_of_both(
    low: float, median: float, high: float, cost: Verdict, speed: Verdict
) -> None:
    assert judge(row(low, median, high), THEN) is cost
    assert judge(row(low, median, high, SPEED), THEN) is speed


def test_a_disturbed_block_hides_nothing() -> None:
    """Eight blocks at 1.3 and one at 0.9: the range covers the earlier one, the usual range does not."""
    now = Ratio.of([1.3] * 8 + [0.9], [1.0] * 9)
    assert (now.low, now.usual_low, now.high) == (0.9, 1.3, 1.3)
    assert judge(Row("a cycle", "the rival", now, COST, ""), THEN) is Verdict.SLOWER


def test_a_row_that_was_not_measured_then_is_not_judged() -> None:
    assert judge(row(1.0, 1.0, 1.0), None) is Verdict.NEW


def keep(path: Path, *rows: Row) -> Path:
    kept = [{"suite": "cycle", **each.as_json()} for each in rows]
    path.write_text(json.dumps({"machine": "a machine", "commit": "74eae64", "time": "", "rows": kept}))
    return path


def test_a_kept_run_is_compared_row_by_row(tmp_path: Path) -> None:
    earlier = against.read(keep(tmp_path / "then.json", row(0.9, 1.0, 1.1), row(1, 1, 1, what="gone")))
    rows = [("cycle", row(1.9, 2.0, 2.1)), ("cycle", row(1, 1, 1, what="new"))]
    lines = against.compared(rows, earlier)
    assert [line.split()[-1] for line in lines[1:]] == ["SLOWER", "then", "now"]
    assert "2.00  SLOWER" in lines[1]
    assert against.slower(rows, earlier) == ["a cycle"]


def test_rows_of_suites_that_are_not_run_now_are_not_missed(tmp_path: Path) -> None:
    earlier = against.read(keep(tmp_path / "then.json", row(0.9, 1.0, 1.1)))
    assert len(against.compared([("slave", row(1, 1, 1))], earlier)) == 2


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"machine": "", "commit": "", "rows": [{}]}'])
def test_a_file_that_is_no_result_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(EarlierError, match=r"other\.json: is no result of make bench"):
        against.read(path)


def test_a_file_that_is_not_there_is_refused_before_anything_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run.main(["--against", str(tmp_path / "none.json")])
    assert ended.value.code == 2
    assert "none.json: No such file" in capsys.readouterr().err


def test_what_has_become_slower_is_named_and_is_a_status_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    earlier = against.read(keep(tmp_path / "then.json", row(0.9, 1.0, 1.1)))
    assert run.show_comparison([("cycle", row(0.9, 1.0, 1.1))], earlier, "CPython") == 0
    assert run.show_comparison([("cycle", row(1.9, 2.0, 2.1))], earlier, "CPython") == run.SLOWER
    shown = capsys.readouterr().out
    assert "another machine then: a machine" in shown
    assert shown.endswith("1 slower beyond the spread of both: a cycle\n")
