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
from canarm_protocol.runs.run_folder import CanLog, Rotation, RunFolderError, SignalLog, parts_of

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
    convert(run, "parquet")
    assert len(open_run(run.path).robot["cycle"]) == len(before["cycle"]), "nothing twice"


@pytest.mark.parametrize("size", [10, 10_000])
def test_a_full_disk_leaves_the_signals_as_they_were(run: Run, full_at: Any, size: int) -> None:
    pytest.importorskip("pyarrow.parquet")
    folder = run.path / "signals"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with full_at(size), pytest.raises(RunFolderError, match=r"cannot be (packed|written)"):
        convert(run, "parquet")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


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
    assert (tmp_path / "robot.csv").read_text() == "cycle,time_s,a\n"


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
