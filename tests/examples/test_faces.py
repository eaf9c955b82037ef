"""What users read and copy imports public faces: packages with `__all__`, never a module within one."""

import importlib
import json
import re
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
FROM = re.compile(r"^\s*from (canarm\w*(?:\.\w+)*) import (?:\(([^)]*)\)|(.+))$", re.MULTILINE)
PLAIN = re.compile(r"^\s*import (canarm\w*\.[\w.]+)", re.MULTILINE)
FACES = [
    "canarm",
    "canarm.cooperation",
    "canarm_controller.cooperation",
    "canarm_controller.dynamics",
    "canarm_controller.laws",
    "canarm_controller.run",
    "canarm_controller.supervision",
    "canarm_emulator.faults",
    "canarm_protocol.canopen",
    "canarm_protocol.cell",
    "canarm_protocol.decoding",
    "canarm_protocol.faults",
    "canarm_protocol.runs",
    "canarm_protocol.transport",
]


def texts() -> list[Path]:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")]
    return [*pages, *(ROOT / "examples").rglob("*.py")]


def text_of(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        return "\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"] if cell["cell_type"] == "code")
    return text


@pytest.mark.parametrize("path", texts(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_users_read_imports_faces(path: Path) -> None:
    text = text_of(path)
    assert PLAIN.findall(text) == []
    for module, in_brackets, in_line in FROM.findall(text):
        offered = importlib.import_module(module).__all__
        names = [name.split(" as ")[0].strip() for name in (in_brackets or in_line).split("#")[0].split(",")]
        assert {name for name in names if name} <= set(offered), f"{path.name}: from {module}"


def test_there_are_imports_to_look_at() -> None:
    assert sum(len(FROM.findall(text_of(path))) for path in texts()) > 10


@pytest.mark.parametrize("face", FACES)
def test_a_face_offers_what_it_names(face: str) -> None:
    package = importlib.import_module(face)
    assert all(hasattr(package, name) for name in package.__all__)
    assert not [name for name in package.__all__ if isinstance(getattr(package, name), ModuleType)]  # of its name
    with pytest.raises(AttributeError, match=rf"'{face}' has no attribute 'nothing'"):
        _ = package.nothing
