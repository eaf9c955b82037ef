"""docs/signals.md names every column of the CSV files, and what it says of them is so."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig
from canarm_protocol.faults.fault_events import FAULT_BEGINS, FAULT_ENDS

PAGE = Path(__file__).parents[2] / "docs" / "signals.md"
JOINT = "joint2"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """The two files of a short run, by the headings of the page."""
    folder = tmp_path_factory.mktemp("signals") / "run"
    with Rig(law="pd", out=folder) as rig:
        rig.run(1.0)
    return {
        name: np.genfromtxt(folder / "signals" / name, delimiter=",", names=True, deletechars="", encoding="ascii")
        for name in ("robot.csv", "controller.csv")
    }


def columns_of_the_page(heading: str) -> list[str]:
    """The first column of the table below a heading, or before the first."""
    text = PAGE.read_text(encoding="utf-8")
    section = text.split(f"## {heading}\n")[1].split("\n## ")[0] if heading else text.split("\n## ")[0]
    return re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)


@pytest.mark.parametrize("name", ["robot.csv", "controller.csv"])
def test_the_page_names_the_columns_that_there_are(tables: dict[str, np.ndarray], name: str) -> None:
    names = list(tables[name].dtype.names or ())
    assert names[:2] == columns_of_the_page("The tables of signals")
    assert [each for each in names[2:] if "." not in each] == (["power_on_s"] if name == "robot.csv" else [])
    assert [each.split(".")[1] for each in names if each.startswith(JOINT)] == columns_of_the_page(name)


def test_a_command_acts_at_the_next_sync(tables: dict[str, np.ndarray]) -> None:
    commanded, acting = (tables[name][f"{JOINT}.command_a"] for name in ("controller.csv", "robot.csv"))
    count = len(commanded) - 1
    step_a = 1.5 / 255
    assert np.abs(commanded[:count] - acting[1 : count + 1]).max() < 0.75 * step_a
    assert np.abs(commanded[:count] - acting[:count]).max() > 5 * step_a


def test_the_measured_current_has_the_sign_of_the_last_command(tables: dict[str, np.ndarray]) -> None:
    table = tables["controller.csv"]
    measured, commanded = table[f"{JOINT}.measured_a"][1:], table[f"{JOINT}.command_a"][:-1]
    assert (measured * commanded >= 0.0).all()


def test_the_measured_angle_is_that_of_sync(tables: dict[str, np.ndarray]) -> None:
    """Two steps of the potentiometer: its noise, its grain, and the offset of neither."""
    measured, true = tables["controller.csv"][f"{JOINT}.measured_rad"], tables["robot.csv"][f"{JOINT}.true_angle_rad"]
    assert np.abs(measured - true[: len(measured)]).max() < 2.0 * np.radians(260.0 / 255)


WRITERS = {"event", "_event", "_note"}
"""Methods of recorders that write an event of a name, and what passes one on to them."""
ROOT = PAGE.parents[1]


def constants(trees: list[ast.Module]) -> dict[str, str]:
    """Texts that have a name in a module."""
    return {
        target.id: statement.value.value
        for tree in trees
        for statement in tree.body
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant)
        for target in statement.targets
        if isinstance(target, ast.Name) and isinstance(statement.value.value, str)
    }


def written_events() -> dict[str, set[str]]:
    """Name → keys of every event that the code can write, as far as its calls spell the keys."""
    trees = [
        ast.parse(path.read_text(encoding="utf-8"))
        for package in ("emulator/canarm_emulator", "controller/canarm_controller", "canarm")
        for path in (ROOT / package).rglob("*.py")
    ]
    named, found = constants(trees), dict[str, set[str]]()
    for call in (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)):
        if not isinstance(call.func, ast.Attribute) or call.func.attr not in WRITERS:
            continue
        for name in call.args[:2]:
            text = name.value if isinstance(name, ast.Constant) else named.get(getattr(name, "id", ""))
            texts = [text]
            if isinstance(name, ast.IfExp):
                texts = [each.value for each in (name.body, name.orelse) if isinstance(each, ast.Constant)]
            if isinstance(name, ast.Call) and getattr(name.func, "id", "") == "event_name":
                texts = [FAULT_BEGINS, FAULT_ENDS]
            for each in filter(None, texts):
                found.setdefault(each, set()).update(word.arg for word in call.keywords if word.arg)
    return found


def test_the_page_names_the_events_that_the_code_can_write_and_their_keys() -> None:
    section = PAGE.read_text(encoding="utf-8").split("## events.jsonl\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (`[a-z`, -]+`) \|[^|]*\|(.*)\|$", section, re.MULTILINE)
    page = {name: set(re.findall(r"`(\w+)`", keys)) for names, keys in rows for name in re.findall(r"[a-z-]+", names)}
    written = written_events()
    assert set(page) == set(written)
    for name, keys in written.items():
        assert keys - {"cycle"} <= page[name], name
