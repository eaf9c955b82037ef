"""`examples/my_law.py` runs, and does what docs/your-own-law.md says of it."""

import ast
import re
from pathlib import Path
from typing import Any

import pytest

from canarm import Rig

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "my_law.py"
PAGE = ROOT / "docs" / "your-own-law.md"


def rms_lsb(mass3_kg: float) -> float:
    with Rig("konkuk1", law=f"{EXAMPLE}:MyLaw", trajectory="sine", seed=0, truth={"joint3.mass": mass3_kg}) as rig:
        rig.run(seconds=10.24)
    return max(joint.rms_error_lsb for joint in rig.joints.values())


@pytest.mark.parametrize(("mass3_kg", "documented_lsb"), [(0.6, 1.9), (0.9, 3.7)])
def test_example_follows_as_well_as_its_page_says(mass3_kg: float, documented_lsb: float) -> None:
    assert rms_lsb(mass3_kg) == pytest.approx(documented_lsb, rel=0.05)


def blocks() -> list[str]:
    """The page's Python: `update`, and a test."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_page_shows_the_update_of_the_example() -> None:
    assert shape_of_update(blocks()[0]) == shape_of_update(EXAMPLE.read_text(encoding="utf-8"))


def test_the_test_on_the_page_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(compile(blocks()[1], str(PAGE), "exec"), names)
    names["test_my_law_holds_the_arm"]()


def shape_of_update(text: str) -> list[str]:
    """The statements of `update`, docstring left out."""
    [update] = [
        node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef) and node.name == "update"
    ]
    statements = [
        node for node in update.body if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    ]
    return [ast.dump(node) for node in statements]
