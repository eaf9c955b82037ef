"""The example with two arms of one's own: it says where the slave may stand, and writes all ten joint paths."""

import csv
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from canarm.cooperation import forward

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_arms.py"


def test_the_example_plans_a_lift_within_the_limits_of_its_arms(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = importlib.util.spec_from_file_location("two_arms", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    ignored = (EXAMPLE.parents[1] / ".gitignore").read_text(encoding="utf-8").splitlines()
    assert f"/{example.FILE.parts[0]}/" in ignored, "what it writes would lie about in the checkout"
    example.main(tmp_path / "two_arms.csv")
    said = capsys.readouterr().out
    assert "% of the bases: works" in said
    assert "the slave at (" in said
    with (tmp_path / "two_arms.csv").open(encoding="utf-8") as stream:
        rows = np.array([[float(cell) for cell in row] for row in list(csv.reader(stream))[1:]])
    assert rows.shape == (801, 11)
    low, high = np.array(example.ARM.limits_deg).T
    for joints in (rows[:, 1:6], rows[:, 6:]):
        assert (joints >= low).all()
        assert (joints <= high).all()
    tip = forward(example.ARM, np.radians(rows[:, 1:6]))[:, :3, 3]
    np.testing.assert_allclose(tip[-1] - tip[0], [0.0, 0.0, 0.06], atol=1e-12)
