"""A law may change the working folder: the record goes on where it began, and is called as it was named."""

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from canarm import Rig
from canarm_controller.laws.base import Cycle
from canarm_controller.laws.pd import Pd
from canarm_protocol.runs.out_folder import OutFolder
from canarm_protocol.runs.run_folder import RunFolderError, read_run_file

LEAVING = """
import os
from canarm_controller.laws.pd import Pd

os.chdir({elsewhere!r})


class Leaving(Pd):
    name = "leaving"

    def update(self, cycle):
        os.chdir("/")
        return super().update(cycle)
"""


class Leaving(Pd):
    """In its first cycle."""

    name = "leaving"

    def update(self, cycle: Cycle) -> Sequence[float]:
        os.chdir("/")
        return super().update(cycle)


def test_a_rigs_record_stays_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Rig(law=Leaving, out="run") as rig:
        rig.run(0.05)
    assert read_run_file(tmp_path / "run")["summary"]["ticks"] == 20
    assert rig.summary().out == "run"
    assert Path.cwd() == Path("/")


def test_a_folder_that_is_taken_is_called_as_it_was_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with Rig(out="run") as rig:
        rig.run(0.01)
    with pytest.raises(RunFolderError, match=r"^--out run: holds a run already; name another folder, or remove it$"):
        Rig(out="run")
    assert OutFolder.at(Path("run")).said(f"{tmp_path}/run/can0.log: full") == "run/can0.log: full"


def test_a_demos_record_stays_in_its_folder(canarm, run_folder) -> None:  # type: ignore[no-untyped-def]
    (canarm.folder / "elsewhere").mkdir()
    (canarm.folder / "laws.py").write_text(LEAVING.format(elsewhere=str(canarm.folder / "elsewhere")))
    demo = canarm("demo", "--no-tui", "--json", "--seconds", "0.1", "--law", "laws.py:Leaving", "--out", "run")
    assert demo.wait() == 0, demo
    assert demo.json["out"] == "run"
    recorded = run_folder(canarm.folder / "run").run
    assert recorded["summary"]["ticks"] == demo.json["ticks"]
    assert "emulator_summary" in recorded
    assert list((canarm.folder / "elsewhere").iterdir()) == []
