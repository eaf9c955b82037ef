"""Compiled packages: which run is told, what was compiled from another source is refused, all can be taken back."""

import importlib
import json
import re
import sys
import sysconfig
from pathlib import Path

import pytest

from canarm.compiled import PACKAGES, compiled_packages, how_it_runs

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "scripts"))
import compiled  # noqa: E402

SUFFIX = sysconfig.get_config_var("EXT_SUFFIX") or ".so"
DERIVED_FROM = {
    "ControlLaw", "Mras", "MrasLyapunov", "SlotineLi", "ComputedTorque", "Pd", "Trajectory", "Fault", "SignalFault",
    "JointFault", "GripFault", "MessageFault", "NodeFault", "BusFault", "ClockFault", "Source", "AnalogueSource",
    "Converter", "DacConverters",
}  # fmt: skip
"""What users and contributors derive from, by docs/ and CONTRIBUTING.md."""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A checkout with one compiled module in each package, each with its library and the package's."""
    for package, folder in compiled.PACKAGES.items():
        home = tmp_path / folder / package
        home.mkdir(parents=True)
        (home / "cycle.py").write_text("PERIOD_US = 2500\n")
        (home / f"cycle{SUFFIX}").touch()
        (tmp_path / folder / f"{package}__mypyc{SUFFIX}").touch()
        hook = f'[tool.hatch.build.targets.wheel.hooks.mypyc]\ninclude = ["{package}/cycle.py"]\n'
        (tmp_path / folder / "pyproject.toml").write_text(hook)
        record = tmp_path / "build" / "compiled" / f"{package}.json"
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(compiled.digests(tmp_path / folder)))
    return tmp_path


def test_what_runs_is_what_is_imported() -> None:
    from canarm_emulator.robot import world

    is_library = not str(world.__file__).endswith(".py")
    assert ("canarm_emulator" in compiled_packages()) is is_library


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ((), "plain Python"),
        (PACKAGES, "compiled"),
        (("canarm_protocol", "canarm_emulator"), "compiled in part: canarm_protocol, canarm_emulator"),
    ],
)
def test_which_runs_is_told(monkeypatch: pytest.MonkeyPatch, found: tuple[str, ...], said: str) -> None:
    names = {f"{name}__mypyc" for name in found}
    monkeypatch.setattr("canarm.compiled.find_spec", lambda name: name if name in names else None)
    assert how_it_runs() == said


def test_libraries_of_these_sources_are_fresh(tree: Path) -> None:
    assert compiled.stale(tree) == []


def test_a_source_that_has_changed_since_is_named(tree: Path) -> None:
    (tree / "emulator" / "canarm_emulator" / "cycle.py").write_text("PERIOD_US = 1000\n")
    assert compiled.stale(tree) == ["emulator/canarm_emulator/cycle.py"]


def test_a_library_of_which_nobody_knows_the_source_is_stale(tree: Path) -> None:
    (tree / "build" / "compiled" / "canarm_protocol.json").unlink()
    assert compiled.stale(tree) == ["protocol/canarm_protocol/cycle.py"]


def test_one_line_says_that_other_sources_were_compiled(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["compiled.py", "fresh"])
    monkeypatch.setattr(compiled, "stale", lambda: ["emulator/canarm_emulator/cycle.py", "b.py", "c.py"])
    assert compiled.main() == 1
    assert capsys.readouterr().err == (
        "compiled: emulator/canarm_emulator/cycle.py and 2 more: not the source that was compiled. "
        "make compiled, or make plain\n"
    )


def test_without_libraries_nothing_is_stale(tree: Path) -> None:
    assert compiled.remove(tree) == 6
    (tree / "emulator" / "canarm_emulator" / "cycle.py").write_text("PERIOD_US = 1000\n")
    assert compiled.stale(tree) == []
    assert sorted(path.name for path in tree.rglob("*.py")) == ["cycle.py"] * 3


@pytest.mark.parametrize("folder", compiled.PACKAGES.values())
def test_modules_to_be_compiled_are_there_and_classes_that_others_derive_from_say_so(folder: str) -> None:
    names = compiled.included(ROOT / folder)
    assert names == sorted(set(names))
    for name in names:
        text = (ROOT / folder / name).read_text(encoding="utf-8")
        classes = re.findall(r"^(@mypyc_attr.*\n(?:@.*\n)*)?class (\w+)", text, re.MULTILINE)
        assert DERIVED_FROM.isdisjoint(name for says_so, name in classes if not says_so)


def test_between_two_classes_that_are_compiled_none_is_interpreted() -> None:
    """Mypyc takes the arguments of such a class for those of the one that it is derived from."""
    names = {name for folder in compiled.PACKAGES.values() for name in compiled.included(ROOT / folder)}
    modules = {name.removesuffix(".py").replace("/", ".") for name in names}
    found = [each for name in sorted(modules) for each in vars(importlib.import_module(name)).values()]
    classes = [each for each in found if isinstance(each, type) and each.__module__ in modules]
    assert len(classes) > 100
    between = {
        f"{base.__module__}.{base.__name__}, from which {each.__name__} is derived"
        for each in classes
        for base in each.__mro__
        if base.__module__ not in modules and any(beneath.__module__ in modules for beneath in base.__mro__)
    }
    assert between == set()


def test_without_a_compiler_one_line_says_what_is_needed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(sys, "argv", ["compiled.py", "build"])
    monkeypatch.setattr(compiled, "remove", lambda: 0)
    assert compiled.main() == 1
    said = capsys.readouterr().err
    assert said.startswith("compiled: there is no no-such-compiler. make compiled needs a C compiler")
    assert len(said.splitlines()) == 1
