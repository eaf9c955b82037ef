"""A command that is refused leaves nothing in the place that --out names: no folder, no file, no half of one."""

import signal
import socket
from pathlib import Path

import pytest

from canarm import BusRig, Rig
from canarm_protocol.errors import CanarmError, FaultError
from canarm_protocol.runs.tentative import Tentative

EMULATOR = ("emulator", "--serve", "127.0.0.1:0")


def tree(folder: Path) -> dict[str, bytes | None]:
    """All that is in a folder, files with what is in them."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")
    }


@pytest.fixture
def taken():
    """An address that is in use."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield f"127.0.0.1:{other.getsockname()[1]}"


def bad_record(folder: Path) -> None:
    (folder / "run.json").write_text("{")


def linked_record(folder: Path) -> None:
    (folder / "run.json").symlink_to("elsewhere")


def folder_for_events(folder: Path) -> None:
    (folder / "events.jsonl").mkdir()


def folder_for_signals(folder: Path) -> None:
    for name in ("robot.csv", "controller.csv", "x"):
        (folder / "signals" / name).mkdir(parents=True)


def file_for_signals(folder: Path) -> None:
    (folder / "signals").write_text("mine")


@pytest.mark.parametrize(
    "obstacle", [bad_record, linked_record, folder_for_events, folder_for_signals, file_for_signals]
)
def test_a_refused_run_folder_stays_as_it_was(canarm, obstacle):
    obstacle_folder = canarm.folder / "run"
    obstacle_folder.mkdir()
    obstacle(obstacle_folder)
    before = tree(canarm.folder)
    emulator = canarm(*EMULATOR, "--out", "run")
    assert emulator.wait() == 2, emulator
    assert tree(canarm.folder) == before
    serving = canarm.emulator("sync")
    controller = canarm.controller(serving, "sync", "--seconds", "1", "--out", "run")
    assert controller.wait() == 2, controller
    assert tree(canarm.folder) == before
    with pytest.raises(CanarmError):
        Rig(out=obstacle_folder)
    assert tree(canarm.folder) == before


def test_a_demo_whose_emulator_is_refused_leaves_no_folder(canarm, taken):
    for out in (["--out", "new/deep/run"], []):
        demo = canarm("demo", "--no-tui", "--serve", taken, *out)
        assert demo.wait() == 1, demo
        assert "is in use" in demo.complaint
        assert tree(canarm.folder) == {}


def test_a_controller_that_finds_no_bus_leaves_no_folder(canarm):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        nobody = f"127.0.0.1:{probe.getsockname()[1]}"
    controller = canarm("controller", "--connect", nobody, "--out", "new/run")
    assert controller.wait() == 1, controller
    controller = canarm("controller", "-i", "canarm", "-c", "can0", "port=http", "--out", "new/run")
    assert controller.wait() == 2, controller
    assert tree(canarm.folder) == {}


def test_a_controller_with_the_wrong_clock_leaves_nothing_but_the_emulators_files(canarm, run_folder):
    emulator = canarm.emulator("sync", "--out", "run")
    for out in ("alone", "run"):
        controller = canarm.controller(emulator, "wall", "--out", out)
        assert controller.wait() == 2, controller
        assert controller.json["out"] is None
    assert not (canarm.folder / "alone").exists()
    assert set(run_folder(canarm.folder / "run").run) == {"cell", "emulator"}
    controller = canarm.controller(emulator, "sync", "--seconds", "0.1", "--out", "run")
    assert controller.wait() == 0, controller
    emulator.send(signal.SIGTERM)
    assert emulator.wait() == 0
    run_folder(canarm.folder / "run").check()


def test_an_export_writes_all_its_files_or_none(canarm):
    exported = canarm("export", "eds", "--out", "all")
    assert exported.wait() == 0
    last = max(path.name for path in (canarm.folder / "all").iterdir())
    (canarm.folder / "new" / last).mkdir(parents=True)
    before = tree(canarm.folder)
    refused = canarm("export", "eds", "--out", "new")
    assert refused.wait() == 2
    assert refused.complaint == f"canarm: --out new: {last} cannot be written: Is a directory"
    assert tree(canarm.folder) == before


@pytest.mark.parametrize("rig", [Rig, BusRig])
def test_a_rig_whose_faults_are_refused_leaves_no_folder(tmp_path, rig):
    with pytest.raises(FaultError):
        rig(out=tmp_path / "new" / "run", faults='[[set]]\n[[set.fault]]\ntap = "joint9.motor"\nfault = "open-load"\n')
    assert tree(tmp_path) == {}


def test_what_others_have_put_into_a_folder_meanwhile_stays(tmp_path):
    made = Tentative()
    made.folder(tmp_path / "a" / "b")
    made.file(tmp_path / "a" / "mine")
    (tmp_path / "a" / "mine").write_text("")
    (tmp_path / "a" / "theirs").write_text("theirs")
    made.take_back()
    assert tree(tmp_path) == {"a": None, "a/theirs": b"theirs"}
