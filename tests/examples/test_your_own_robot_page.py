"""docs/your-own-robot.md says what is: its commands are run as they stand there, and print what it shows."""

import re
import shutil
from pathlib import Path

import pytest

from canarm.cli import run


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
