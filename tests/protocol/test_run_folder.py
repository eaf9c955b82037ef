"""What a run leaves on disk: readable by others' tools, whole after a kill, shared by several processes."""

import csv
import fcntl
import json
import shutil
import signal
import subprocess
import sys

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.runs import own_file, run_folder
from canarm_protocol.runs.run_folder import (
    CanLog,
    EventLog,
    RunFolderError,
    SignalLog,
    candump_line,
    claim_run_folder,
    create_run_folder,
    new_run_folder,
    read_run_file,
    update_run_file,
)

BASE_FRAMES = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8), st.just(False), st.just(False))
EXTENDED_FRAMES = st.builds(Frame, st.integers(0, (1 << 29) - 1), st.binary(max_size=8), st.just(True), st.just(False))


@pytest.mark.parametrize(
    ("time_ns", "frame", "line"),
    [
        (2_500_000, Frame(0x80, b"\x01"), "(0000000000.002500) can0 080#01\n"),
        (0, Frame(0x80), "(0000000000.000000) can0 080#\n"),
        (1_234_567_890_123_456_789, Frame(0x712, b"\x7f"), "(1234567890.123456) can0 712#7F\n"),
        (0, Frame(0x123, b"\xab", is_extended=True), "(0000000000.000000) can0 00000123#AB\n"),
        (0, Frame(0x612, is_remote=True), "(0000000000.000000) can0 612#R\n"),
        (0, Frame(0x612, bytes(8), is_remote=True), "(0000000000.000000) can0 612#R8\n"),
    ],
)
def test_a_line_is_written_as_candump_writes_it(time_ns: int, frame: Frame, line: str) -> None:
    assert candump_line(time_ns, "can0", frame) == line


@given(st.lists(st.tuples(st.integers(0, 2**40), BASE_FRAMES | EXTENDED_FRAMES), min_size=20, max_size=20))
@settings(max_examples=20)
def test_python_can_reads_every_frame_back(tmp_path_factory, records: list[tuple[int, Frame]]) -> None:
    path = tmp_path_factory.getbasetemp() / "read-back.log"
    with CanLog(path) as log:
        for time_ns, frame in records:
            log.write(time_ns, frame)
    with can.CanutilsLogReader(path) as reader:
        messages = list(reader)
    found = [Frame(m.arbitration_id, bytes(m.data), m.is_extended_id, m.is_remote_frame) for m in messages]
    assert found == [frame for _, frame in records]
    assert [m.timestamp for m in messages] == pytest.approx([1.0 + time_ns // 1000 * 1e-6 for time_ns, _ in records])
    assert {m.channel for m in messages} == {"can0"}


def test_can_utils_log2asc_takes_the_log_from_its_first_frame(tmp_path) -> None:
    """can-utils 2020.11 takes a start second of 0 as unset, and then every frame of that second is the first."""
    with CanLog(tmp_path / "can0.log") as log:
        for step in range(3):
            log.write(step * 2_500_000, Frame(0x80, bytes((step + 1,))))
    assert (tmp_path / "can0.log").read_text().splitlines()[0] == "(0000000001.000000) can0 080#01"
    log2asc = shutil.which("log2asc")
    if log2asc is None:
        pytest.skip("can-utils are not installed")
    asc = subprocess.run(
        [log2asc, "-I", str(tmp_path / "can0.log"), "can0"], check=True, capture_output=True, text=True
    )
    stamps = [line.split()[0] for line in asc.stdout.splitlines() if " Rx " in line]
    assert stamps == ["0.000000", "0.002500", "0.005000"]


def test_signals_are_a_csv_with_a_row_a_cycle(tmp_path) -> None:
    with SignalLog(tmp_path / "robot.csv", ["joint2.angle_rad", "joint2.current_a"]) as log:
        log.write(0, 0, [0.1, -1.5])
        log.write(1, 2_500_000, [1 / 3, 1e-9])
    with (tmp_path / "robot.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["cycle", "time_s", "joint2.angle_rad", "joint2.current_a"]
    assert [row["cycle"] for row in rows] == ["0", "1"]
    assert [float(row["time_s"]) for row in rows] == [0.0, 0.0025]
    assert [float(row["joint2.angle_rad"]) for row in rows] == pytest.approx([0.1, 1 / 3], rel=1e-8)


WRITER = """
import os, signal, sys
from pathlib import Path
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.runs.run_folder import CanLog, EventLog, SignalLog, create_run_folder, update_run_file
folder = create_run_folder(Path(sys.argv[1]))
update_run_file(folder, "seed", 7)
log, signals = CanLog(folder / "can0.log"), SignalLog(folder / "signals" / "robot.csv", ["a"])
events = EventLog(folder / "events.jsonl", "emulator")
for k in range(1, 1001):
    log.write(k * 2_500_000, Frame(0x80, bytes((k % 240 + 1,))))
    signals.write(k, k * 2_500_000, [k * 0.5])
    events.write(k, "tick", number=k)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
def test_what_was_written_survives_a_kill(tmp_path) -> None:
    folder = tmp_path / "run"
    killed = subprocess.run([sys.executable, "-c", WRITER, str(folder)], check=False, timeout=120)
    assert killed.returncode == -signal.SIGKILL
    with can.CanutilsLogReader(folder / "can0.log") as reader:
        assert len(list(reader)) > 1000 - run_folder.FLUSH_EVERY
    with (folder / "signals" / "robot.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 1000 - run_folder.FLUSH_EVERY - 1
    assert all(float(row["a"]) == int(row["cycle"]) * 0.5 for row in rows)
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    assert [event["number"] for event in events] == list(range(1, 1001))
    assert read_run_file(folder) == {"seed": 7}


SHARER = """
import sys
from pathlib import Path
from canarm_protocol.runs.run_folder import EventLog, update_run_file
folder, name = Path(sys.argv[1]), sys.argv[2]
print("ready", flush=True)
sys.stdin.readline()
with EventLog(folder / "events.jsonl", name) as events:
    for k in range(30):
        update_run_file(folder, f"{name}{k}", {"number": k})
        for number in range(10):
            events.write(0, "tick", number=10 * k + number, padding="x" * 500)
"""


def test_two_processes_share_the_run_file_and_the_events_and_lose_nothing(tmp_path) -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    sharers = [subprocess.Popen([sys.executable, "-c", SHARER, str(tmp_path), name], **pipes) for name in "ab"]
    for sharer in sharers:
        assert sharer.stdout.readline() == "ready\n"
    for sharer in sharers:
        sharer.stdin.write("go\n")
        sharer.stdin.flush()
    for sharer in sharers:
        sharer.communicate(timeout=120)
        assert sharer.returncode == 0
    assert read_run_file(tmp_path) == {f"{name}{k}": {"number": k} for name in "ab" for k in range(30)}
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    for name in "ab":
        assert [event["number"] for event in events if event["source"] == name] == list(range(300))
    assert len(events) == 600
    assert sorted(path.name for path in tmp_path.iterdir()) == ["events.jsonl", "run.json"]


def test_a_lock_left_behind_by_a_killed_process_is_taken_over(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(own_file, "LOCK_S", 0.0)
    (tmp_path / ".run.json.lock").touch()
    update_run_file(tmp_path, "seed", 1)
    assert read_run_file(tmp_path) == {"seed": 1}
    assert not (tmp_path / ".run.json.lock").exists()


def test_a_folder_that_holds_a_run_is_refused_unless_it_may_be_used_again(tmp_path) -> None:
    folder = create_run_folder(tmp_path / "run")
    create_run_folder(folder)  # two programs of one run make it in either order
    (folder / "can0.log").touch()
    with pytest.raises(RunFolderError, match=r"holds a run already; name another folder, or remove it$"):
        create_run_folder(folder)
    assert create_run_folder(folder, reuse=True) == folder


def test_new_folders_have_names_of_their_own(tmp_path) -> None:
    folders = {new_run_folder(tmp_path / "runs") for _ in range(5)}
    assert len(folders) == 5
    assert all((folder / "signals").is_dir() for folder in folders)


def test_a_folder_that_cannot_be_made_says_so(tmp_path) -> None:
    (tmp_path / "file").touch()
    for make in (lambda: create_run_folder(tmp_path / "file"), lambda: new_run_folder(tmp_path / "file")):
        with pytest.raises(RunFolderError, match=r"cannot be made: (File exists|Not a directory)$"):
            make()
    with pytest.raises(RunFolderError, match=r"can0\.log: cannot be written: No such file or directory$"):
        CanLog(tmp_path / "nowhere" / "can0.log")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{", "Expecting property name"),
        ("null", "is no JSON object"),
        ('["run"]', "is no JSON object"),
        ("[" * 100_000, "nested too deep"),
        (f'{{"seed": {"9" * 5000}}}', "a whole number is too long; must have at most 600 digits"),
        ('{"seed": 1' + " " * (16 << 20) + "}", "is larger than 16777216 bytes"),
    ],
)
def test_a_run_file_that_is_none_says_so(tmp_path, text: str, why: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(RunFolderError, match=rf"run\.json: cannot be read: .*{why}"):
        read_run_file(tmp_path)


def test_a_folder_in_the_place_of_the_run_file_says_so(tmp_path) -> None:
    (tmp_path / "run.json").mkdir()
    with pytest.raises(RunFolderError, match=r"run\.json: cannot be read: is no regular file"):
        update_run_file(tmp_path, "seed", 1)


def test_a_log_may_be_closed_twice(tmp_path) -> None:
    log = CanLog(tmp_path / "can0.log")
    log.write(0, Frame(1))
    log.close()
    log.close()
    assert (tmp_path / "can0.log").stat().st_size == len(candump_line(0, "can0", Frame(1)))


def test_of_two_that_claim_a_folder_one_is_refused(tmp_path, monkeypatch) -> None:
    claim_run_folder(tmp_path / "run")
    monkeypatch.setattr(
        run_folder, "create_run_folder", lambda path, made: path
    )  # both have looked before either wrote
    with pytest.raises(RunFolderError, match="holds a run already"):
        claim_run_folder(tmp_path / "run")


@pytest.mark.parametrize("left", [0, 1, 40, 99])
def test_events_on_a_full_disk_are_whole_lines_and_go_on_when_there_is_room_again(tmp_path, full_at, left: int) -> None:
    path = tmp_path / "events.jsonl"
    with EventLog(path, "emulator") as emulator, EventLog(path, "controller") as controller:
        emulator.begin(0), controller.begin(0)
        emulator.write(0, "state")
        size = path.stat().st_size
        with full_at(size + left):
            with pytest.raises(OSError, match="File too large"):
                emulator.write(1, "emergency", padding="x" * 100)
            assert path.stat().st_size == size
        controller.write(2_000_000, "state")
    assert [json.loads(line)["time_s"] for line in path.read_text().splitlines()] == [0, 0.002]


def test_who_keeps_a_file_locked_holds_up_no_run(tmp_path) -> None:
    path = tmp_path / "events.jsonl"
    with EventLog(path, "emulator") as log, path.open() as planted:
        fcntl.flock(planted, fcntl.LOCK_EX)
        log.write(0, "state")
    assert json.loads(path.read_text())["event"] == "state"


def test_signals_on_a_full_disk_are_whole_rows_and_go_on_when_there_is_room_again(tmp_path, full_at) -> None:
    path = tmp_path / "robot.csv"
    log = SignalLog(path, ["a"])
    for tick in range(run_folder.FLUSH_EVERY - 1):
        log.write(tick, 0, [0.5])
    with full_at(1000), pytest.raises(OSError, match="File too large"):
        log.write(run_folder.FLUSH_EVERY - 1, 0, [0.5])
    assert 900 < path.stat().st_size <= 1000
    log.write(run_folder.FLUSH_EVERY, 0, [0.5])
    log.close()
    header, *rows = path.read_text(encoding="ascii").splitlines()
    ticks = [int(row.split(",")[0]) for row in rows]
    assert {len(row.split(",")) for row in (header, *rows)} == {3}
    assert ticks == [*range(len(ticks) - 1), run_folder.FLUSH_EVERY]


def test_a_full_disk_leaves_no_draft_and_names_the_file(tmp_path, full_at) -> None:
    with full_at(1000), pytest.raises(OSError, match="File too large") as raised:
        update_run_file(tmp_path, "summary", "x" * 5000)
    assert raised.value.filename == str(tmp_path / "run.json")
    assert list(tmp_path.iterdir()) == []
