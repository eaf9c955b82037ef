"""The golden copy of a share of rhino-pair's fault matrix: what was noticed, by whom and how soon is as it was."""

import importlib
import sys
from pathlib import Path

import pytest

from canarm.matrix.golden import read_golden
from canarm.workers.progress import Progress

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
pair_matrix = importlib.import_module("pair_matrix")


def test_the_golden_copy_has_every_chosen_fault_in_both_scenarios() -> None:
    names = read_golden(pair_matrix.GOLDEN.read_text(encoding="utf-8"))
    chosen = pair_matrix.cells_of(pair_matrix.SCENARIOS[0].load())[pair_matrix.FIRST :: pair_matrix.EVERY]
    assert len(names) == len(pair_matrix.SCENARIOS) * len(chosen)
    assert {name.rpartition(", draw ")[0] for name in names} == {cell.name for cell in chosen}
    assert not [name for name, each in names.items() if each.verdict == "BROKEN"]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_share_of_the_pairs_matrix_is_as_its_golden_copy() -> None:
    """Two minutes of one core: 21 faults in two scenarios."""
    matrix = pair_matrix.pair_matrix(1, Progress())
    assert not matrix.runs_left
    assert matrix.alarmed_runs == 0
    assert pair_matrix.changes(matrix) == []
