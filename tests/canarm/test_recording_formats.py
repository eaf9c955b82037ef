"""A run in the formats of other tools: what their own readers find is what was recorded."""

import json
import shutil
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from canarm import Rig, Run, open_run
from canarm.cli import run as canarm_here
from canarm.runs.converting import convert, unit_of
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.parts import part_of, parts_of
from canarm_protocol.runs.run_folder import CanLog, Rotation, RunFolderError, SignalLog, create_run_folder

SIGNAL = "joint2.true_angle_rad"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("formats") / "run"
    with Rig(law="mras", seed=3, out=folder) as rig:
        rig.run(1.0)
    return folder


@pytest.fixture
def run(recorded: Path, tmp_path: Path) -> Run:
    return open_run(shutil.copytree(recorded, tmp_path / "run"))


def test_blf_has_every_frame_and_the_same_bytes_each_time(run: Run) -> None:
    (path,) = convert(run, "blf")
    first = path.read_bytes()
    convert(run, "blf")
    assert path.read_bytes() == first
    with can.BLFReader(path) as reader, can.CanutilsLogReader(run.path / "can0.log") as log:
        blf, candump = list(reader), list(log)
    assert [(m.arbitration_id, bytes(m.data)) for m in blf] == [(m.arbitration_id, bytes(m.data)) for m in candump]
    since_first = [m.timestamp - candump[0].timestamp for m in candump]  # BLF has no dates of 1970
    assert [m.timestamp for m in blf] == pytest.approx(since_first, abs=2e-6)


def test_mcap_has_signals_events_and_frames_for_its_own_reader(run: Run) -> None:
    reader_of = pytest.importorskip("mcap.reader")
    (path,) = convert(run, "mcap")
    found: dict[str, list[tuple[int, dict[str, object]]]] = {}
    with path.open("rb") as file:
        for _, channel, message in reader_of.make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    assert set(found) == {
        *("/robot/joint2", "/robot/joint3", "/controller/joint2", "/controller/joint3"),
        *("/events", "/can0"),
    }
    assert [each["true_angle_rad"] for _, each in found["/robot/joint2"]] == run.robot[SIGNAL].tolist()
    stamps = np.array([stamp for stamp, _ in found["/robot/joint2"]]) * 1e-9 - 1.0
    assert stamps == pytest.approx(run.robot["time_s"], abs=1e-9)
    frames = [(frame.can_id, frame.data.hex().upper()) for _, frame in log_frames(run.path / "can0.log")]
    assert [(each["id"], each["data"]) for _, each in found["/can0"]] == frames


def test_mf4_has_signals_with_units_and_a_logged_bus(run: Run) -> None:
    asammdf = pytest.importorskip("asammdf")
    frames, signals = convert(run, "mf4")
    with asammdf.MDF(signals) as file:
        signal = file.get(f"robot.{SIGNAL}")
        assert signal.samples.tolist() == run.robot[SIGNAL].tolist()
        assert signal.timestamps.tolist() == run.robot["time_s"].tolist()
        assert signal.unit == "rad"
        channels = {channel.name for group in file.groups for channel in group.channels} - {"time"}
        tables = (("robot", run.robot), ("controller", run.controller))
        assert channels == {f"{table}.{name}" for table, columns in tables for name in columns if name != "time_s"}
    with can.MF4Reader(frames) as reader:
        heard = [(message.arbitration_id, bytes(message.data)) for message in reader]
    assert sorted(heard) == sorted((frame.can_id, frame.data) for _, frame in log_frames(run.path / "can0.log"))


def test_parquet_takes_the_place_of_csv_with_seven_digits(run: Run) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    before, size = run.columns, (run.path / "signals" / "robot.csv").stat().st_size
    convert(run, "parquet")
    assert run.complaints == []
    path = run.path / "signals" / "robot-0001.parquet"
    table = parquet.read_table(path)
    assert str(table.schema.field("cycle").type) == "int64"
    assert table["time_s"].to_pylist() == before["time_s"].tolist()
    after = open_run(run.path)
    assert after.columns.keys() == before.keys()
    for name, values in before.items():
        np.testing.assert_allclose(after.columns[name], values, rtol=2**-23, atol=0, err_msg=name)
    assert path.stat().st_size < size / 3
    assert [path.suffix for path in (run.path / "signals").iterdir()] == [".parquet"] * 2, "no empty table beside it"
    convert(run, "parquet")
    assert len(open_run(run.path).robot["cycle"]) == len(before["cycle"]), "nothing twice"


@pytest.mark.parametrize("size", [10, 10_000])
def test_a_full_disk_leaves_the_signals_as_they_were(run: Run, full_at: Any, size: int) -> None:
    pytest.importorskip("pyarrow.parquet")
    folder = run.path / "signals"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with full_at(size), pytest.raises(RunFolderError, match=r"robot-0001\.parquet: cannot be written: File too large"):
        convert(run, "parquet")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("format_", "file", "library"),
    [
        ("blf", "can0.blf", "can"),
        ("mcap", "run.mcap", "mcap"),
        ("mf4", "can0.mf4", "asammdf"),
        ("csv", "signals/robot-0001.csv", "pyarrow"),
    ],
)
def test_a_full_disk_is_told_with_the_file_that_does_not_fit_and_leaves_no_draft(
    run: Run, full_at: Any, format_: str, file: str, library: str
) -> None:
    pytest.importorskip(library)
    if format_ == "csv":
        convert(run, "parquet")
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    with full_at(1000), pytest.raises(RunFolderError) as raised:
        convert(run, format_)
    assert str(raised.value) == f"{run.path / file}: cannot be written: File too large"
    assert {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()} == before


def test_parquet_becomes_the_same_csv_again_to_the_digits_that_it_has(run: Run) -> None:
    """IEEE 754 single precision keeps 6 significant digits of any decimal, and here nearly always 7."""
    pytest.importorskip("pyarrow")
    folder = run.path / "signals"
    recorded = {name: (folder / name).read_text().splitlines() for name in ("robot.csv", "controller.csv")}
    convert(run, "parquet")
    before = open_run(run.path).columns
    assert sorted(path.name for path in convert(run, "csv")) == ["controller.csv", "robot.csv"]
    assert sorted(path.name for path in folder.iterdir()) == ["controller.csv", "robot.csv"]
    after = open_run(run.path)
    for name, values in before.items():
        np.testing.assert_allclose(after.columns[name], values, rtol=2**-24, atol=0, err_msg=name)
    assert after.complaints == []
    for name, lines in recorded.items():
        again = (folder / name).read_text().splitlines()
        assert again[0] == lines[0]
        assert len(again) == len(lines)
        for old, new in zip(lines[1:], again[1:], strict=True):
            assert new.split(",")[:2] == old.split(",")[:2], "times have double precision"
            for before_text, after_text in zip(old.split(","), new.split(","), strict=True):
                if len(before_text.strip("-0.").replace(".", "")) <= 6 and "e" not in before_text:
                    assert after_text == before_text
    texts = {name: (folder / name).read_bytes() for name in recorded}
    convert(run, "parquet")
    convert(run, "csv")
    assert {name: (folder / name).read_bytes() for name in recorded} == texts, "nothing more is lost"
    assert convert(run, "csv") == []


def test_parts_of_parquet_become_parts_of_csv(run: Run) -> None:
    pytest.importorskip("pyarrow")
    path = run.path / "signals" / "robot.csv"
    head, *rows = path.read_text().splitlines(keepends=True)
    part_of(path, 1).write_text(head + "".join(rows[:100]))
    part_of(path, 3).write_text(head + "".join(rows[100:200]))  # the second was lost
    path.write_text(head + "".join(rows[200:]))
    convert(run, "parquet")
    assert [each.name for each in parts_of(path, ".parquet")[:-1]] == [
        f"robot-000{number}.parquet" for number in (1, 3, 4)
    ]
    convert(run, "csv")
    assert [each.name for each in parts_of(path)] == [
        *(f"robot-000{number}.csv" for number in (1, 3, 4)),
        "robot.csv",
    ]
    assert not path.exists()
    assert open_run(run.path).robot["cycle"].tolist() == run.robot["cycle"].tolist()


def test_a_damaged_packed_table_stays_as_it_is(run: Run) -> None:
    pytest.importorskip("pyarrow")
    packed = run.path / "signals" / "robot-0001.parquet"
    packed.write_bytes(b"PAR1")
    with pytest.raises(RunFolderError, match=r"robot-0001\.parquet: cannot be unpacked: "):
        convert(run, "csv")
    assert packed.read_bytes() == b"PAR1"


def test_a_folder_whose_signals_are_packed_holds_a_run(run: Run) -> None:
    pytest.importorskip("pyarrow")
    convert(run, "parquet")
    (run.path / "can0.log").unlink()
    with pytest.raises(RunFolderError, match="holds a run already"):
        create_run_folder(run.path)


def test_of_a_parted_table_an_empty_last_part_is_told_for_what_it_is(
    run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a full disk leaves: the part before was complete, and not even the first line of the next one fitted."""
    path = run.path / "signals" / "robot.csv"
    path.rename(part_of(path, 1))
    path.touch()
    again = open_run(run.path)
    assert again.robot["cycle"].tolist() == run.robot["cycle"].tolist()
    assert again.complaints == ["robot.csv: is empty: the record broke off"]
    (run.path / "run.json").write_text("{")
    assert canarm_here(["runs", "show", str(run.path)]) == 1
    assert max(line.count("cannot be read") for line in capsys.readouterr().out.splitlines()) == 1


def test_a_table_that_does_not_fit_is_named(tmp_path: Path, full_at: Any) -> None:
    with full_at(0), pytest.raises(RunFolderError, match=r"robot\.csv: cannot be written: File too large"):
        SignalLog(tmp_path / "robot.csv", ["a"])


@pytest.mark.parametrize(
    ("column", "unit"), [("joint2.true_angle_rad", "rad"), ("a.true_speed_rad_s", "rad/s"), ("cycle", ""), ("b_a", "A")]
)
def test_units_are_those_of_the_names(column: str, unit: str) -> None:
    assert unit_of(column) == unit


def test_a_log_that_is_parted_is_read_as_one(tmp_path: Path) -> None:
    """Each part is whole lines, of the size that was asked for; tables repeat their head."""
    with (
        CanLog(tmp_path / "can0.log", rotation=Rotation(10_000)) as log,
        SignalLog(tmp_path / "robot.csv", ["a"], Rotation(10_000, takes_last=True)) as table,
    ):
        for k in range(2000):
            log.write(k * 1_000_000, Frame(k % 0x700, bytes([k % 256])))
            table.write(k, k * 1_000_000, [k * 0.5])
    parts = parts_of(tmp_path / "can0.log")
    assert len(parts) > 3
    assert all(10_000 <= part.stat().st_size < 20_000 for part in parts[:-1])
    assert [frame.can_id for _, frame in log_frames(tmp_path / "can0.log")] == [k % 0x700 for k in range(2000)]
    from canarm.signal_table import read_table

    complaints: list[str] = []
    found = read_table(tmp_path / "robot.csv", complaints.append)
    assert found["a"].tolist() == [k * 0.5 for k in range(2000)]
    assert complaints == []
    assert not (tmp_path / "robot.csv").exists(), "a tool that opens it would find an empty run"


def test_a_demo_is_recorded_in_all_formats_and_parted(canarm, run_folder) -> None:
    for library in ("pyarrow", "asammdf", "mcap"):
        pytest.importorskip(library)
    demo = canarm(
        *("demo", "--no-tui", "--seconds", "2", "--law", "pd", "--out", "run", "--rotate", "1"),
        *("--record", "parquet,blf,mcap,mf4"),
    )
    assert demo.wait() == 0, demo
    run = open_run(canarm.folder / "run")
    assert len(run.controller["cycle"]) == 800
    assert run.complaints == []
    names = {path.relative_to(run.path).as_posix() for path in run.path.rglob("*")}
    assert {"can0.blf", "run.mcap", "can0.mf4", "signals.mf4", "signals/robot-0001.parquet"} <= names
    assert not [name for name in names if name.endswith(".csv")]
    assert not [name for name in names if "draft" in name]


def test_the_benchs_own_bus_is_recorded_where_that_is_asked_for(canarm, run_folder) -> None:
    pytest.importorskip("pyarrow")
    demo = canarm("demo", "--no-tui", "--seconds", "0.5", "--out", "run", "--record", "bench,parquet,blf")
    assert demo.wait() == 0, demo
    run = open_run(canarm.folder / "run")
    with can.CanutilsLogReader(run.path / "bench.log") as log, can.BLFReader(run.path / "bench.blf") as blf:
        candump, packed = list(log), list(blf)
    assert {message.channel for message in candump} == {"bench"}
    # What the controller reports of every cycle (docs/faults.md): its tick comes in the bench node's first RPDO.
    ticks = [message for message in candump if message.arbitration_id == 0x200 + run.cell.bus.bench_node_id]
    assert len(ticks) >= 10
    assert [(m.arbitration_id, bytes(m.data)) for m in packed] == [(m.arbitration_id, bytes(m.data)) for m in candump]
    assert run.bench_frames["data"].tolist() == [bytes(message.data) for message in candump]
    assert run.complaints == []


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["emulator", "--record", "blf"], "--record: there is no record; name its folder with --out"),
        (
            ["demo", "--no-tui", "--record", "wav", "--out", "r"],
            "--record 'wav': must be bench, blf, mcap, mf4, p",
        ),
        (["controller", "--record", "blf", "--out", "r"], "the emulator records the frames"),
        (["emulator", "--rotate", "0", "--out", "r"], "rotate"),
    ],
)
def test_a_wrong_wish_is_refused(
    words: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert canarm_here(words) == 2
    assert why in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
