"""Same cell, seed, law and truth: the same bytes."""

from pathlib import Path

import pytest

from canarm import Rig
from canarm_protocol.runs.run_folder import CAN_LOG_FILE

SIGNALS = ("signals/robot.csv", "signals/controller.csv", "memory.bin")


def record(folder: Path, seed: int = 7, law: str = "mras", mass_kg: float = 0.9, seconds: float = 2.0) -> Path:
    with Rig("konkuk1", law=law, seed=seed, truth={"joint3.mass": mass_kg}, out=folder) as rig:
        rig.run(seconds)
    return folder


def can_log(folder: Path) -> bytes:
    data = (folder / CAN_LOG_FILE).read_bytes()
    assert data.count(b"\n") > 2500
    return data


def test_two_runs_leave_the_same_bytes(tmp_path: Path) -> None:
    first, second = record(tmp_path / "a"), record(tmp_path / "b")
    assert can_log(first) == can_log(second)
    for name in SIGNALS:
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_a_run_cut_into_pieces_is_the_same_run(tmp_path: Path) -> None:
    whole = record(tmp_path / "whole")
    with Rig("konkuk1", law="mras", seed=7, truth={"joint3.mass": 0.9}, out=tmp_path / "cut") as rig:
        for seconds in (0.0025, 0.4975, 1.0, 0.5):
            rig.run(seconds)
    assert can_log(whole) == can_log(tmp_path / "cut")


def test_a_run_that_is_not_recorded_has_the_same_frames(tmp_path: Path) -> None:
    logged = can_log(record(tmp_path / "a", seconds=1.0)).decode().splitlines()
    with Rig("konkuk1", law="mras", seed=7, truth={"joint3.mass": 0.9}) as rig:
        rig.run(1.0)
    frames = [f"{frame.can_id:03X}#{frame.data.hex().upper()}" for _, frame in rig.frames]
    assert [line.split()[-1] for line in logged[: len(frames)]] == frames
    assert len(logged) - len(frames) < 40  # the planned stop


@pytest.mark.parametrize("other", [{"seed": 8}, {"law": "pd"}, {"mass_kg": 0.91}], ids=str)
def test_another_seed_law_or_truth_leaves_other_bytes(tmp_path: Path, other: dict[str, object]) -> None:
    assert can_log(record(tmp_path / "a")) != can_log(record(tmp_path / "b", **other))
