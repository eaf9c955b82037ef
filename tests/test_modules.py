"""Modules stay small enough to be read in one go."""

from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ["canarm", "controller", "emulator", "protocol", "tui", "benchmarks", "scripts", "examples"]
MOST_LINES, MEDIAN_LINES = 400, 110


def modules() -> dict[str, int]:
    found = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            lines = len(path.read_text(encoding="utf-8").splitlines())
            if lines:
                found[path.relative_to(ROOT).as_posix()] = lines
    return found


@pytest.mark.parametrize(("module", "lines"), modules().items())
def test_a_module_has_at_most_400_lines(module: str, lines: int) -> None:
    assert lines <= MOST_LINES, module


def test_half_of_the_modules_have_at_most_110_lines() -> None:
    assert median(modules().values()) <= MEDIAN_LINES
