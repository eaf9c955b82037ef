"""What somebody has planted in a run folder is never followed, and what was behind it stays as it was."""

import os
from pathlib import Path

import pytest

from canarm.rig.rig import Rig
from canarm_protocol.errors import ProtocolError
from canarm_protocol.runs import own_file
from canarm_protocol.runs.own_file import open_own, replace_file
from canarm_protocol.runs.run_folder import EventLog, RunFolderError, SignalLog, create_run_folder

SECRET = "somebody else's\n"


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    path = tmp_path / "victim"
    path.write_text(SECRET)
    return path


@pytest.mark.parametrize("name", ["can0.log", "events.jsonl", "signals/robot.csv", "signals/controller.csv"])
@pytest.mark.parametrize("kind", ["symlink", "hard link", "pipe"])
def test_a_run_does_not_write_through_what_was_planted(tmp_path: Path, victim: Path, name: str, kind: str) -> None:
    path = tmp_path / "run" / name
    path.parent.mkdir(parents=True)
    match kind:
        case "symlink":
            path.symlink_to(victim)
        case "hard link":
            path.hardlink_to(victim)
        case _:
            os.mkfifo(path)
    with pytest.raises(ProtocolError, match=rf"{path.name}: cannot be written|holds a run already"):
        Rig(out=tmp_path / "run")
    assert victim.read_text() == SECRET


@pytest.mark.parametrize("name", ["run.json", "signals"])
def test_a_link_in_the_place_of_the_folders_own_parts_is_refused(tmp_path: Path, victim: Path, name: str) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run" / name).symlink_to(tmp_path / "elsewhere" if name == "signals" else victim)
    with pytest.raises(RunFolderError, match=rf"{name} is a link; remove it"):
        create_run_folder(tmp_path / "run")


def test_a_link_is_replaced_and_not_followed_where_a_file_is_written_whole(tmp_path: Path, victim: Path) -> None:
    path = tmp_path / "memory.bin"
    path.symlink_to(victim)
    replace_file(path, b"image")
    assert (path.read_bytes(), path.is_symlink(), victim.read_text()) == (b"image", False, SECRET)


def test_a_draft_that_was_planted_is_not_followed_either(tmp_path: Path, victim: Path) -> None:
    (tmp_path / f".memory.bin.{os.getpid()}").symlink_to(victim)
    replace_file(tmp_path / "memory.bin", b"image")
    assert victim.read_text() == SECRET


def test_processes_that_share_a_log_append_to_it(tmp_path: Path) -> None:
    for source in ("emulator", "controller"):
        with EventLog(tmp_path / "events.jsonl", source) as log:
            log.write(0, "state")
    assert len((tmp_path / "events.jsonl").read_text().splitlines()) == 2


def test_what_is_there_is_emptied_where_it_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "robot.csv"
    path.write_text("x" * 999)
    with SignalLog(path, ["joint2.a"]):
        pass
    assert path.read_text() == "cycle,time_s,joint2.a\n"


def test_a_folder_in_the_place_of_a_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="Is a directory"):
        open_own(tmp_path)


def test_only_a_line_that_crosses_a_page_could_be_cut_and_it_is_written_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linux ends the write of a killed process between two pages (generic_perform_write, fatal_signal_pending)."""
    written: list[tuple[int, bytes]] = []
    write_all = own_file.write_all

    def noted(descriptor: int, data: bytes) -> None:
        written.append((os.fstat(descriptor).st_size, data))
        write_all(descriptor, data)

    monkeypatch.setattr(own_file, "write_all", noted)
    lines = [f"{number} {'x' * (number * 37 % 301)}\n".encode() for number in range(400)]
    lines += [b"long " * 3000 + b"\n", b"last\n"]
    path = tmp_path / "log"
    with path.open("ab", buffering=0) as file:
        for first in range(0, len(lines), 64):
            own_file.append_lines(file.fileno(), b"".join(lines[first : first + 64]))
    assert path.read_bytes() == b"".join(lines)
    for offset, piece in written:
        assert piece.endswith(b"\n")
        is_within = offset // own_file.PAGE == (offset + len(piece) - 1) // own_file.PAGE
        assert is_within or piece.count(b"\n") == 1
    assert len(written) < len(lines) / 5, "a call for each line"
