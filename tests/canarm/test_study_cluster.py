"""A study on a Dask cluster: a scheduler and workers as processes of their own, one of which is killed on the way."""

import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from canarm.cli import run as canarm_here

pytest.importorskip("distributed")
parquet = pytest.importorskip("pyarrow.parquet")
TEXT = """
[run]
seconds = 1.0
[vary]
law = ["pd", "mras"]
seed = {from = 0, to = 7}
"""


@pytest.mark.slow
def test_a_cluster_comes_to_the_same_table_though_one_of_its_workers_is_killed(
    canarm: Any, until: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (canarm.folder / "my.toml").write_text(TEXT)
    port = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    scheduler = canarm.run(sys.executable, "-m", "distributed.cli.dask_scheduler", *port)
    address = scheduler.wait_for(r"Scheduler at:\s+(tcp://127\.0\.0\.1:\d+)").group(1)
    worker = (sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny")
    workers = [canarm.run(*worker, "--no-dashboard") for _ in range(3)]
    for each in workers:
        each.wait_for("Starting established connection")
    with monkeypatch.context() as patched:
        patched.setattr("canarm.study.cluster.version", lambda: "0.0.1")
        words = ["study", str(canarm.folder / "my.toml"), "--out", str(canarm.folder / "no"), "--scheduler", address]
        assert canarm_here(words) == 2
        assert "this is 0.0.1: they must be the same" in capsys.readouterr().err
    rows = canarm.folder / "cluster" / "rows.jsonl"
    study = canarm("study", "my.toml", "--out", "cluster", "--scheduler", address, "--json")
    until(lambda: rows.exists() and rows.read_bytes().count(b"\n") >= 2, "two rows")
    workers[0].send(signal.SIGKILL)
    assert study.wait() == 0, study
    assert study.json["states"] == {"done": 16}
    assert canarm("study", "my.toml", "--out", "here", "--jobs", "2").wait() == 0
    tables = [parquet.read_table(canarm.folder / name / "study.parquet") for name in ("cluster", "here")]
    assert tables[0].equals(tables[1])


def test_a_scheduler_that_is_not_there_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch) -> None:
    monkeypatch.setattr("canarm.study.cluster.ATTACH_S", 0.5)
    (tmp_path / "my.toml").write_text(TEXT)
    words = ["study", str(tmp_path / "my.toml"), "--out", str(tmp_path / "out")]
    assert canarm_here([*words, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "--scheduler tcp://127.0.0.1:9: no Dask scheduler answers" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
