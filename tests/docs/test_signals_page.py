"""docs/signals.md names every column of the CSV files, and what it says of them is so."""

import re
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig

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
