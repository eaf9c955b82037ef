"""Loading control laws by name and from files, and what is said when that fails."""

from pathlib import Path

import pytest

from canarm_controller.errors import LawError
from canarm_controller.laws import ControlLaw, Mras, Pd, load_law

GOOD = """\
from __future__ import annotations
from dataclasses import dataclass
from canarm_controller.laws import ControlLaw

@dataclass
class Gains:
    stiffness: float = 1.0

class Limp(ControlLaw):
    name = "limp"
    def __init__(self, arm, control, period_s):
        self.gains = Gains()
    def start(self, position_rad, velocity_rad_s, amplitude_rad):
        pass
    def update(self, cycle):
        return [0.0] * len(cycle.position_rad)
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.py"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("name", "law"), [("pd", Pd), ("mras", Mras)])
def test_shipped_laws_load_by_name(name: str, law: type[ControlLaw]) -> None:
    assert load_law(name) is law


def test_a_law_loads_from_a_file(tmp_path: Path) -> None:
    law = load_law(f"{write(tmp_path, GOOD)}:Limp")
    assert (law.name, law.default_feedforward, law.feedforward_excludes_inertia) == ("limp", "none", False)


@pytest.mark.parametrize("spec", ["pid", "mine.txt:Limp"])
def test_an_unknown_name_is_refused_with_the_choices(spec: str) -> None:
    laws = "pd, computed-torque, mras, mras-lyapunov, slotine-li"
    with pytest.raises(LawError, match=rf"must be one of {laws}, or path/to/file\.py:ClassName"):
        load_law(spec)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LawError, match=r"no file .*mine\.py"):
        load_law(f"{tmp_path / 'mine.py'}:Limp")


@pytest.mark.parametrize(
    ("text", "class_name", "message"),
    [
        ("x = 1\ndef broken(:\n", "Limp", r"mine\.py, line 2: invalid syntax"),
        ("x = 1\ny = '\0'\n", "Limp", r"law file .*mine\.py(, line 2)?: source code .* null bytes$"),
        ("x = 1\n\nimport no_such_module\n", "Limp", r"mine\.py, line 3: ModuleNotFoundError: .*no_such_module"),
        ("x = 1\ny = x / 0\n", "Limp", r"mine\.py, line 2: ZeroDivisionError"),
        ("raise SystemExit(3)\n", "Limp", r"mine\.py, line 1: SystemExit: 3"),
        (GOOD, "", r"mine\.py:'?: names no class; leave the colon out where .*mine\.py has only one"),
        (GOOD, "Lmip", "has no class Lmip; its classes: Gains, Limp"),
        ("", "Limp", "has no class Limp; its classes: none"),
        (GOOD, "Gains", r"Gains is not a law; derive it from canarm_controller\.laws\.ControlLaw"),
        (GOOD.replace("def update", "def refresh"), "Limp", r"not a complete law; missing or wrong: update\(\)$"),
        (GOOD + "    shift = update = 5\n", "Limp", r"missing or wrong: update \(a method\), shift \(a method\)$"),
        (GOOD.replace('name = "limp"', "pass"), "Limp", r"missing or wrong: name \(a text\)$"),
        (
            GOOD.replace('name = "limp"', 'name = "limp"; default_feedforward = "tabel"'),
            "Limp",
            r"default_feedforward \(one of none, table, online\)$",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_what_is_missing(tmp_path: Path, text: str, class_name: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(LawError, match=message) as caught:
        load_law(f"{path}:{class_name}")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_refused_with_or_without_a_class() -> None:
    for spec in ("mine.py", "mine.py:Mine"):
        with pytest.raises(LawError, match=r"no file mine\.py; must be an existing Python file"):
            load_law(spec)


def test_a_file_of_two_laws_is_asked_which(tmp_path: Path) -> None:
    path = tmp_path / "two.py"
    path.write_text("from canarm_controller.laws.pd import Pd\n\nclass One(Pd): ...\n\nclass Two(Pd): ...\n")
    with pytest.raises(LawError, match=r"which class\? .* has One, Two"):
        load_law(str(path))
