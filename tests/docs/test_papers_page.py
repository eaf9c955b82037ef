"""The page on the first paper: what it says fits what is measured, and the committed page has it."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "scripts"))
paper = importlib.import_module("paper")
paper_page = importlib.import_module("paper_page")
paper_runs = importlib.import_module("paper_runs")
skeleton = importlib.import_module("ablation_page").skeleton


@pytest.fixture(scope="module")
def results() -> "paper_page.Results":
    return paper.compute(jobs=2)


def test_the_paper_s_memory_holds_ten_seconds_of_two_joints() -> None:
    # $2000 to $3FFF are 8192 bytes; two joints, a byte every 2.5 ms.
    assert paper_page.PAPERS_BYTES == 8192
    assert paper_runs.TABLE_S == 8192 / 2 * 0.0025


@pytest.mark.slow
def test_every_sentence_fits_the_figures_and_the_committed_page_has_them(results: "paper_page.Results") -> None:
    assert [claim.printed for claim in paper_page.claims(results) if not claim.holds] == []
    committed = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")
    assert skeleton(committed) == skeleton(paper_page.page(results))


@pytest.mark.slow
def test_a_sentence_that_no_longer_holds_is_named(results: "paper_page.Results") -> None:
    case = paper_runs.Case(paper_runs.FIXED, "table", "trapezoid")
    wrong = replace(results, runs={**results.runs, case: replace(results.runs[case], ripple=0.5)})
    failed = [claim.printed[:34] for claim in paper_page.claims(wrong) if not claim.holds]
    assert "The dynamics being computed, the j" in failed
