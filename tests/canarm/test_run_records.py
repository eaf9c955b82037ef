"""What a user is told around records: one that broke off, small parts, nothing to prune, missing libraries."""

import importlib.util
import re
import resource
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm_here
from canarm.libraries import how_to_get
from canarm.recording import parse_recording
from canarm.rig.arguments import RigWarning
from canarm_protocol.runs.parts import part_of, parts_of

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_the_summary_of_a_demo_on_a_full_disk_says_that_it_is_recorded_in_part(canarm: Any) -> None:
    def limit_file_size() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))

    demo = canarm("demo", "--no-tui", "--seconds", "1", "--out", "small", preexec_fn=limit_file_size)
    assert demo.wait() == 1, demo
    said = "\n".join(demo.stdout)
    assert "recorded in part: the recording broke off; what there is stands in small" in said
    assert "recorded in small" not in said


def test_the_summary_of_a_rig_on_a_full_disk_says_so_too(
    tmp_path: Path, full_at: Callable[[int], AbstractContextManager[None]]
) -> None:
    rig = Rig(out=tmp_path / "run")
    with full_at(40_000), pytest.warns(RigWarning, match="recording failed"):
        rig.run(1.0)
    summary = rig.finish()
    assert summary.broke_off
    assert summary.as_json()["broke_off"] is True
    assert "recorded in part: " in summary.as_text()


def test_parts_may_be_smaller_than_a_megabyte(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert parse_recording(None, 0.1, tmp_path, print).rotate_bytes == 100_000
    words = ["demo", "--no-tui", "--seconds", "0.05", "--out", str(tmp_path / "run"), "--rotate"]
    for size in ("0.01", "0", "nan", "x"):
        assert canarm_here([*words, size]) == 2
        assert "--rotate" in capsys.readouterr().err


def test_parts_beyond_the_9999th_are_read_as_well(tmp_path: Path) -> None:
    log = tmp_path / "can0.log"
    paths = [part_of(log, number) for number in (1, 9999, 10_000, 12_345)]
    for path in (*paths, log, tmp_path / "can0-0001x.log", tmp_path / f"can0-{'9' * 100}.log"):
        path.touch()
    assert parts_of(log) == [*paths, log]


def test_prune_says_why_nothing_would_go(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b"):
        with Rig(out=tmp_path / name) as rig:
            rig.run(0.01)
    for words, why in (
        (["--keep", "2"], "and the newest 2 are kept"),
        (["--older-than", "1"], "and none was written more than 1 day ago"),
        (["--keep", "1", "--older-than", "1"], "the newest 1 are kept, and none of the others was written more than 1"),
    ):
        assert canarm_here(["runs", "prune", str(tmp_path), *words]) == 0
        said = capsys.readouterr().out
        assert said.startswith(f"nothing to remove: 2 runs below {tmp_path}")
        assert why in said
    assert open_run(tmp_path / "a").summary


def test_a_gain_that_nobody_has_is_answered_by_a_few_that_look_like_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "my.toml").write_text('[vary]\nlaw = ["mras"]\n')
    assert canarm_here(["study", str(tmp_path / "my.toml"), "--tune", "control.nix"]) == 2
    said = capsys.readouterr().err
    named = re.search(r"the nearest are (.*)", said)
    assert named is not None
    assert 0 < len(named.group(1).split(", ")) <= 4
    assert all(each.startswith("control.") for each in named.group(1).split(", "))
    assert len(said) < 300


def test_in_a_clone_a_missing_library_is_brought_by_make() -> None:
    assert how_to_get("mf4") == "make extra EXTRA=mf4 (in this clone; elsewhere pip install 'canarm[mf4]')"
    spec = importlib.util.spec_from_file_location("extra", ROOT / "scripts" / "extra.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert script.requirements("mf4") == extras["mf4"]
    assert script.command(["a>=1"], "/x/uv")[:3] == ["/x/uv", "pip", "install"]
    assert script.command(["a>=1"], None)[1:] == ["-m", "pip", "install", "a>=1"]
    with pytest.raises(SystemExit, match="there are pandas, "):
        script.requirements("nix")
    assert re.search(
        r"^extra: setup .*\n\t@\$\(BIN\)/python scripts/extra.py \$\(EXTRA\)$", (ROOT / "Makefile").read_text(), re.M
    )
