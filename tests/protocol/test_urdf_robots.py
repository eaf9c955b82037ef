"""A cell that names a URDF file holds the arm itself once it is loaded, and says in one line what does not fit."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from canarm_protocol.cell.urdf_robots import resolve_urdf
from canarm_protocol.errors import CellError

ARMS = Path(__file__).parents[2] / "examples" / "arms"
NAMES = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_pitch", "tool_roll")
TEXT = '[[robot]]\nname = "r"\nurdf = "bench_arm.urdf"\n' + "".join(
    f'[[robot.joint]]\nname = "{name}"\n' for name in NAMES
)


def resolved(change: Callable[[dict[str, Any]], object] = lambda robot: None) -> dict[str, Any]:
    table = tomllib.loads(TEXT)
    robot: dict[str, Any] = table["robot"][0]
    change(robot)
    resolve_urdf(table, ARMS, "my.toml")
    return robot


def test_bodies_and_limits_take_the_place_of_the_file() -> None:
    robot = resolved()
    assert "urdf" not in robot
    assert robot["joint"][2]["body"]["axis"] == (0.0, 0.0, -1.0)
    assert robot["joint"][0]["limits_deg"] == [-180.0, 180.0]


def test_a_cell_may_narrow_limits_and_state_those_of_a_joint_without_stops() -> None:
    def change(robot: dict[str, Any]) -> None:
        robot["joint"][0]["limits_deg"] = [-300.0, 300.0]
        robot["joint"][1]["limits_deg"] = [-90.0, 90.0]

    robot = resolved(change)
    assert robot["joint"][0]["limits_deg"] == [-300.0, 300.0]
    assert robot["joint"][1]["limits_deg"] == [-90.0, 90.0]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            lambda robot: robot["joint"].pop(),
            "robot 'r'.joint: named waist, shoulder, elbow, forearm_roll, wrist_pitch;",
        ),
        (lambda robot: robot["joint"].reverse(), "those of bench_arm.urdf, base to tip, are waist, shoulder"),
        (lambda robot: robot.pop("joint"), "robot 'r'.joint: named none"),
        (lambda robot: robot.update(urdf=3), "robot 'r'.urdf: must be the name of a file"),
        (lambda robot: robot.update(urdf="no.urdf"), "no.urdf: no such file"),
        (lambda robot: robot["joint"][0].update(body={}), "joint 'waist'.body: bench_arm.urdf says"),
        (lambda robot: robot["joint"][0].update(link={}), "joint 'waist'.link: bench_arm.urdf says"),
        (
            lambda robot: robot["joint"][1].update(limits_deg=[-120.0, 90.0]),
            "joint 'shoulder'.limits_deg = [-120.0, 90.0]: bench_arm.urdf has [-114.592, 114.592]",
        ),
    ],
)
def test_what_does_not_fit_the_file_is_one_line(change: Callable[[dict[str, Any]], object], expected: str) -> None:
    with pytest.raises(CellError, match=re.escape(expected)) as caught:
        resolved(change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("table", [{}, {"robot": 3}, {"robot": [3]}, {"robot": [{"name": "r"}]}])
def test_what_names_no_file_is_left_to_the_schema(table: dict[str, Any]) -> None:
    resolve_urdf(table, ARMS, "my.toml")
