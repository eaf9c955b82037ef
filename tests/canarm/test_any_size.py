"""Cells of every size, as `canarm new-cell` writes them, under every command: one process where one does."""

import json
import os
import pty
import re
import select
import time
from pathlib import Path

import pytest

from canarm.cli import run
from canarm_protocol.cell.cell_file import load_cell, shipped_cells
from tests.canarm.conftest import DEADLINE_S, Commands

BENCH_ARM = Path(__file__).parents[2] / "examples" / "arms" / "bench_arm.urdf"
WAYS = {
    **{f"{count} joints": ["--joints", str(count)] for count in (1, 3, 5, 6, 7)},
    "a URDF file": ["--urdf", str(BENCH_ARM)],
    "encoders": ["--joints", "3", "--position-sensor", "encoder"],
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_every_command_takes_a_new_cell(
    way: str, canarm: Commands, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(canarm.folder)
    assert run(["new-cell", *WAYS[way], "--out", "my.toml"]) == 0
    cell = load_cell("my.toml")
    first, last = cell.joint_names[0], cell.joint_names[-1]

    assert run(["fault", "list", "--cell", "my.toml"]) == 0
    assert f"{last}.tachometer" in capsys.readouterr().out
    for format_ in ("eds", "dcf", "dbc"):
        assert run(["export", format_, "--cell", "my.toml", "--out", "exported"]) == 0
    exported = {path.name for path in Path("exported").iterdir()}
    assert {f"{cell.name}_{card.name}.dcf" for card in cell.card} | {
        f"{cell.name}_can0.dbc",
        f"{cell.name}_bench.dbc",
    } <= exported

    demo = canarm("demo", "--cell", "my.toml", "--seconds", "0.5", "--no-tui", "--json", "--out", "run")
    assert demo.wait() == 0, str(demo)
    assert demo.json["state"] == "done"
    assert list(demo.json["joints"]) == list(cell.joint_names)
    assert demo.json["detections"] == []

    matrix = canarm(
        "fault", "matrix", "--cell", "my.toml", "--only", f"{last}.tachometer stuck", "--jobs", "1", "--json"
    )
    emulator = canarm.emulator("sync", "--cell", "my.toml")
    address = ["--connect", f"127.0.0.1:{emulator.port}"]  # type: ignore[attr-defined]
    commands = f"current {first} 0.2; step 4; read"
    jog = canarm("jog", "--cell", "my.toml", "--clock", "sync", *address, "--do", commands)
    assert jog.wait() == 0, str(jog)
    time_ms = 3 * cell.bus.cycle_ns / 1e6
    assert f"cycle 3, {time_ms:g} ms: {first} " in "\n".join(jog.stdout)
    assert names_on_dashboard(canarm, ["tui", "--cell", "my.toml", *address], cell.joint_names)
    # Whether the controller did well by it is judged elsewhere; here a run has to come to a verdict.
    assert matrix.wait() in (0, 1), str(matrix)
    (judged,) = json.loads(matrix.stdout[-1])["cells"]
    assert (judged["tap"], judged["fault"]) == (f"{last}.tachometer", "stuck")
    assert judged["verdict"] != "broken"


def two_konkuks() -> str:
    """konkuk1 with a second robot like the first beside it, its cards in the same slots."""
    text = shipped_cells()["konkuk1"]
    head, robot = text.split("[[robot]]", 1)
    robot, *cards = robot.split("[[card]]")
    second = robot.replace('name = "konkuk1"', 'name = "konkuk2"').replace("number = 1\n", "number = 2\n", 1)
    parts = [
        head,
        "[[robot]]",
        robot,
        "[[robot]]",
        second.replace("number = 2\n", "number = 2\nbase_m = [1.0, 0.0, 0.0]\n"),
    ]
    for card in cards:
        other = card.replace('robot = "konkuk1"', 'robot = "konkuk2"').replace("node_id = 0x1", "node_id = 0x2")
        other = re.sub(r'name = "(\w+)"', r'name = "\1b"', other, count=1)
        parts += ["[[card]]", card, "\n[[card]]", other]
    return "".join(parts)


@pytest.mark.slow
def test_two_robots_of_one_kind_run_in_one_cell_from_the_command_line(canarm: Commands) -> None:
    (canarm.folder / "two.toml").write_text(two_konkuks())
    demo = canarm("demo", "--cell", "two.toml", "--seconds", "0.3", "--no-tui", "--json", "--out", "run")
    assert demo.wait() == 0, str(demo)
    assert list(demo.json["joints"]) == ["konkuk1_joint2", "konkuk1_joint3", "konkuk2_joint2", "konkuk2_joint3"]
    assert demo.json["state"] == "done"
    assert demo.json["detections"] == []


def names_on_dashboard(canarm: Commands, command: list[str], names: tuple[str, ...]) -> bool:
    """Whether the dashboard shows every joint and leaves at `q`."""
    ours, theirs = pty.openpty()
    shown = b""
    try:
        process = canarm.at_terminal(theirs, *command)
        deadline_s = time.monotonic() + DEADLINE_S
        while not all(name.encode() in shown for name in names) and time.monotonic() < deadline_s:
            if select.select([ours], [], [], 1.0)[0]:
                shown += os.read(ours, 65536)
        os.write(ours, b"q")
        while process.poll() is None and time.monotonic() < deadline_s:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65536)
        assert process.poll() == 0, shown[-2000:]
    finally:
        os.close(ours)
        os.close(theirs)
    return all(name.encode() in shown for name in names)
