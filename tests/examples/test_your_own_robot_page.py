"""docs/your-own-robot.md says what is: its commands are run as they stand there, and print what it shows."""

import re
import shutil
from pathlib import Path

import pytest

from canarm.cli import run
from canarm_protocol.cell.cell_file import load_cell


@pytest.fixture
def page(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The page's text, in a folder that has the arm that it starts from where the repository has it."""
    arms = Path("examples", "arms")
    (tmp_path / arms).mkdir(parents=True)
    shutil.copy(root / arms / "bench_arm.urdf", tmp_path / arms)
    monkeypatch.chdir(tmp_path)
    return (root / "docs" / "your-own-robot.md").read_text(encoding="utf-8")


def test_the_cell_is_made_as_shown_and_the_program_runs(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    command, shown = re.findall(r"```console\n\$ canarm (new-cell[^\n]*)\n(.*?)```", page, flags=re.DOTALL)[0]
    assert run(command.split()) == 0
    assert capsys.readouterr().out == shown
    (program,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    exec(compile(program, "your-own-robot.md", "exec"), {})


def test_the_other_commands_take_the_cell(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["new-cell", "--joints", "3", "--out", "my.toml"]) == 0
    assert "canarm new-cell --joints 3 --out my.toml" in page
    for command in ("canarm fault list --cell my.toml", "canarm export dcf --cell my.toml --out dcf"):
        assert f"`{command}`" in page
        assert run(command.split()[1:]) == 0
    assert "elbow.tachometer" in capsys.readouterr().out


def test_a_second_robot_is_added_as_the_page_says(page: str) -> None:
    assert run(["new-cell", "--joints", "2", "--out", "my.toml"]) == 0
    (second,) = re.findall(r"```toml\n(\[\[robot\]\]\n.*?)```", page, flags=re.DOTALL)
    text = Path("my.toml").read_text()
    joints = text[text.index("[[robot.joint]]") :]
    for own, other in (('robot = "arm2"', 'robot = "right"'), ("node_id = 0x1", "node_id = 0x2")):
        joints = joints.replace(own, other)
    Path("my.toml").write_text(text + second + joints.replace('[[card]]\nname = "', '[[card]]\nname = "right_'))
    cell = load_cell("my.toml", {"control.right_elbow.natural_frequency_rad_s": "8"})
    assert cell.joint_names == ("arm2_shoulder", "arm2_elbow", "right_shoulder", "right_elbow")
    assert [card.node_id for card in cell.card] == [0x12, 0x13, 0x14, 0x22, 0x23, 0x24]
    assert cell.robot[1].base_m == (0.0, -0.6, 0.0)
