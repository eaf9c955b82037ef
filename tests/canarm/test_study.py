"""Studies: what is run, what is left after a kill, what the table and the page say, and what bad files are told."""

import gc
import json
import re
import shutil
import signal
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canarm import Rig
from canarm.cli import run as canarm_here
from canarm.study.findings import JUDGED
from canarm.study.heat import heat_map
from canarm.study.journal import ROWS_FILE, Journal
from canarm.study.objective import LOST, Objective
from canarm.study.one_run import Task, run_task
from canarm.study.plan import Sample, Settings
from canarm.study.running import Tasks
from canarm.study.study_file import read_study
from canarm.usage import UsageError
from canarm.workers.forking import CAN_FORK

parquet = pytest.importorskip("pyarrow.parquet")
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SHORT = """
[run]
seconds = 0.3
[vary]
law = ["pd", "mras"]
seed = {from = 0, to = 9}
"""
FIGURES = """
title = "two laws, <three> payloads"
[run]
seconds = 3.0
[vary]
law = ["pd", "mras"]
truth.joint3.mass = {from = 0.6, to = 2.4, count = 2}
"""

LAW = """
from canarm_controller.laws import ControlLaw


class MyLaw(ControlLaw):
    name = "mine"

    def __init__(self, arm, control, period_s):
        self.arm = arm

    def start(self, position_rad, velocity_rad_s, amplitude_rad):
        pass

    def update(self, cycle):
        return [0.0 for _ in cycle.position_rad]
"""


def written(folder: Path, text: str, name: str = "my.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def table(folder: Path) -> list[dict[str, Any]]:
    return list(parquet.read_table(folder / "study.parquet").to_pylist())


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    assert canarm_here(["study", str(written(folder, FIGURES)), "--out", str(folder / "out"), "--jobs", "1"]) == 0
    return folder


def test_a_grid_takes_every_combination_and_the_last_axis_is_the_fastest(tmp_path: Path) -> None:
    text = '[vary]\nlaw = ["pd", "mras"]\nfaults = ["none", "a.toml"]\n"set".control.damping_ratio = [0.7, 1.0]'
    study, _ = read_study(written(tmp_path, text))
    rows = [tuple(study[number].values()) for number in range(len(study))]
    assert len(set(rows)) == 2 * 2 * 2
    assert rows[:3] == [("pd", 0.7, "none"), ("pd", 0.7, "a.toml"), ("pd", 1.0, "none")]
    assert study.settings(0).faults is None
    assert study.settings(1).faults == "a.toml"
    assert study.settings(2).settings == (("control.damping_ratio", "1"),)


def test_spans_reach_both_ends_evenly_or_by_equal_factors(tmp_path: Path) -> None:
    text = "[vary]\ntruth.joint3.mass = {from = 0.2, to = 1.8, count = 3}\nset.control.damping_ratio = "
    study, _ = read_study(written(tmp_path, text + '{from = 0.5, to = 2.0, count = 3, scale = "log"}'))
    assert sorted({row["truth.joint3.mass"] for row in study}) == pytest.approx([0.2, 1.0, 1.8])
    assert sorted({row["set.control.damping_ratio"] for row in study}) == pytest.approx([0.5, 1.0, 2.0])


def test_a_latin_hypercube_draws_once_from_each_slice_and_a_random_sample_anywhere(tmp_path: Path) -> None:
    text = "draws = 50\n[vary]\ntruth.joint3.mass = {from = 0.0, to = 1.0}\nseed = {from = 0, to = 1000}"
    cube, _ = read_study(written(tmp_path, f'sample = "latin-hypercube"\n{text}'))
    chance, _ = read_study(written(tmp_path, f'sample = "random"\n{text}'))
    assert cube.sample is Sample.LATIN_HYPERCUBE
    slices = [sorted(int(float(row["truth.joint3.mass"]) * 50) for row in each) for each in (cube, chance)]
    assert slices[0] == list(range(50))
    assert slices[1] != slices[0]
    assert [*cube] == [*read_study(written(tmp_path, f'sample = "latin-hypercube"\n{text}'))[0]]


def test_a_row_says_what_a_rig_would(finished: Path) -> None:
    rows = table(finished / "out")
    assert [row["run"] for row in rows] == [0, 1, 2, 3]
    (mine,) = [row for row in rows if row["law"] == "mras" and row["truth.joint3.mass"] == 0.6]
    with Rig(law="mras", truth={"joint3.mass": 0.6}) as rig:
        rig.run(3.0)
    for joint, figures in rig.joints.items():
        assert mine[f"{joint}.rms_lsb"] == pytest.approx(figures.rms_error_lsb, rel=1e-4)
        assert mine[f"{joint}.peak_current_a"] == pytest.approx(figures.peak_current_a, rel=1e-4)
    assert mine["worst.rms_lsb"] == max(mine["joint2.rms_lsb"], mine["joint3.rms_lsb"])
    assert mine["state"] == "done"


def test_the_command_of_a_run_repeats_it(finished: Path, canarm: Any) -> None:
    study, _ = read_study(finished / "my.toml")
    number = next(n for n in range(4) if study[n] == {"law": "mras", "truth.joint3.mass": 2.4})
    words = study.settings(number).command.split()
    process = canarm(*words[1:], "--json")
    process.wait()
    row = table(finished / "out")[number]
    assert process.json["joints"]["joint2"]["rms_lsb"] == row["joint2.rms_lsb"]
    assert process.json["state"] == row["state"]


def test_a_study_that_was_killed_goes_on_and_comes_to_the_same_table(canarm: Any, until: Any) -> None:
    written(canarm.folder, SHORT)
    killed = canarm("study", "my.toml", "--out", "killed", "--jobs", "2")
    rows = canarm.folder / "killed" / ROWS_FILE
    until(lambda: rows.exists() and rows.read_bytes().count(b"\n") >= 3, "three rows")
    killed.send(signal.SIGKILL)
    killed.wait()
    left = rows.read_bytes()
    whole, _, cut = left.rpartition(b"\n")
    before = [json.loads(line)["run"] for line in whole.splitlines()]
    assert len(set(before)) == len(before) >= 3
    rows.write_bytes(left + b'{"run": 19, "st')  # what a kill in the middle of a line would leave
    again = canarm("study", "my.toml", "--out", "killed", "--jobs", "2", "--json")
    assert again.wait() == 0, again
    assert again.json["ran"] == 20 - len(before)
    assert again.json["done"] == 20
    done = canarm("study", "my.toml", "--out", "whole", "--jobs", "1")
    assert done.wait() == 0, done
    assert table(canarm.folder / "killed") == table(canarm.folder / "whole")
    assert not cut, "append_lines writes whole lines within a page"


def test_an_interrupted_study_writes_what_it_has_and_says_so(canarm: Any, until: Any) -> None:
    written(canarm.folder, SHORT.replace("0.3", "2.0"))
    process = canarm("study", "my.toml", "--out", "out", "--jobs", "2")
    rows = canarm.folder / "out" / ROWS_FILE
    until(lambda: rows.exists() and rows.read_bytes().count(b"\n") >= 1, "a row")
    process.send(signal.SIGINT)
    assert process.wait() == 1
    assert "runs are done; again to go on" in process.complaint
    assert 1 <= len(table(canarm.folder / "out")) < 20


def test_another_study_is_not_mixed_into_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path / "out"), "--jobs", "1"]
    one = '[run]\nseconds = 0.05\n[vary]\nlaw = ["pd"]'
    assert canarm_here(["study", str(written(tmp_path, one)), *out]) == 0
    assert canarm_here(["study", str(written(tmp_path, one.replace("0.05", "0.1"))), *out]) == 2
    assert "holds another study" in capsys.readouterr().err


def test_a_law_that_was_edited_makes_another_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    law = written(
        tmp_path, Path("examples/my_law.py").read_text() if Path("examples/my_law.py").exists() else LAW, "l.py"
    )
    text = f'[run]\nseconds = 0.05\n[vary]\nlaw = ["{law}:MyLaw"]'
    words = ["study", str(written(tmp_path, text)), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert canarm_here(words) == 0
    law.write_text(law.read_text() + "\n# another one\n")
    assert canarm_here(words) == 2
    assert "other settings, files or version" in capsys.readouterr().err


def test_a_folder_serves_one_study_at_a_time(tmp_path: Path) -> None:
    about = {"title": "one"}
    with Journal(tmp_path, about) as journal:
        journal.add({"run": 0, "state": "done"})
        with pytest.raises(UsageError, match="goes on in another process"):
            Journal(tmp_path, about)
    with Journal(tmp_path, about) as journal:
        assert list(journal.places) == [0]


def test_what_somebody_has_written_among_the_rows_is_no_row(tmp_path: Path) -> None:
    lines = [
        '{"run": 1, "state": "done"}',
        "[]",
        "nonsense",
        '{"run": "2", "state": "done"}',
        '{"run": true}',
        '{"run": 3}',
        '{"run": 4, "state": "\\u001b[2Jdone"}',
        '{"run": 5, "state": []}',
        "[" * 100_000,
        " " * (2 << 20) + "nonsense",
        f'{{"run": {10**400}, "state": "done"}}',
        f'{{"run": 7, "state": "done", "worst.rms_lsb": {10**400}}}',
        '{"run": 8, "state": "done", "worst.rms_lsb": Infinity}',
        '{"run": 9, "state": "done", "law": ["pd"]}',
        '{"run": 10, "state": "done", "law": "\\ud800"}',
        '{"run": 11, "state": "failed"}',
    ]
    with Journal(tmp_path, {}):
        (tmp_path / ROWS_FILE).write_text("\n".join(lines) + "\n")
    with Journal(tmp_path, {}) as journal:
        assert list(journal.rows()) == [{"run": 1, "state": "done"}, {"run": 11, "state": "failed"}]


def test_a_full_disk_leaves_whole_rows_and_is_named(tmp_path: Path, full_at: Any) -> None:
    with Journal(tmp_path, {}) as journal:
        journal.add({"run": 0, "state": "done"})
        with full_at(40), pytest.raises(OSError, match=ROWS_FILE):
            journal.add({"run": 1, "state": "done"})
    with Journal(tmp_path, {}) as journal:
        assert list(journal.rows()) == [{"run": 0, "state": "done"}]


def test_rows_that_somebody_has_written_reach_no_terminal_raw_and_are_run_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = 'title = "\\u001b[2J"\n[run]\nseconds = 0.05\n[vary]\nlaw = ["pd", "mras"]\n'
    words = ["study", str(written(tmp_path, text)), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert canarm_here(words) == 0
    rows = tmp_path / "out" / ROWS_FILE
    first, second = map(json.loads, rows.read_text().splitlines())
    figures = {"worst.rms_lsb": None, "reason": "\x1b[2J", "\x1b[2J": "\x1b[2J"}
    rows.write_text(json.dumps(first | figures) + "\n" + json.dumps(second | {"state": "\x1b[2J"}) + "\n")
    assert canarm_here(words) == 0
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    assert f"run {first['run']}" not in said.out, "it has no figure by which it could be the worst"
    assert "\\x1b[2J: 2 runs of 0.05 s, 1 of them done before" in said.err
    assert "0 s left" not in said.err.partition("done before")[2].partition("100 %")[0], "before anything ran"
    assert {row["state"] for row in table(tmp_path / "out")} == {"done"}
    assert "\x1b" not in (tmp_path / "out" / "study.html").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[vary", "not valid TOML"),
        ("", "[vary]: is missing or empty"),
        ("[vary]\nlow = [1]", "vary.low: unknown key; did you mean 'law'?"),
        ('[vary]\nlaw = ["pdd"]', "vary.law, pdd: "),
        ('[vary]\nlaw = "pd"', "vary.law = 'pd': must be an array of values"),
        ("[vary]\nlaw = {from = 1, to = 2}", "vary.law: must be an array of names"),
        ("[vary]\nlaw = []", "must be an array of different values"),
        ("[vary]\nseed = {from = 3, to = 1}", "vary.seed.from = 3: must be below to = 1"),
        ("[vary]\nseed = [-1]", "vary.seed = -1: must be a whole number, 0 or more"),
        (f"[vary]\nseed = [0, {2**63}]", f"vary.seed = {2**63}: must be at most {2**63 - 1}"),
        (f"[run]\nseed = {2**64}\n[vary]\nlaw = ['pd']", f"run.seed = {2**64}: must be at most"),
        (f"[vary]\nseed = {{from = 0, to = {10**400}}}", "vary.seed.to = "),
        (f"[vary]\ntruth.joint3.mass = [{2**63}]", "must be a number of at most 64 bits"),
        (f"[vary]\ntruth.joint3.mass = {{from = 0, to = {10**400}}}", "vary.truth.joint3.mass.to = "),
        ("[vary]\ntruth.joint4.mass = [1.0]", "joint4.mass"),
        ("[vary]\ntruth.joint3.mass = [-1.0]", "vary.truth.joint3.mass, -1.0: truth joint3.mass=-1:"),
        ("[vary]\ntruth.joint3.mass = {from = 0.0, to = 1.0, scale = 'log'}", "must be above 0 and below to = 1"),
        ("[vary]\ntruth.joint3.mass = {from = nan, to = 1.0}", "must be a finite number"),
        ("[vary]\nset.control.damping = [1.0]", "did you mean 'damping_ratio'?"),
        ('sample = "grit"\n[vary]\nlaw = ["pd"]', "sample = 'grit': must be one of grid, random, latin-hypercube"),
        ('draws = 5\n[vary]\nlaw = ["pd"]', "a grid takes every combination"),
        ('[run]\nseconds = 0\n[vary]\nlaw = ["pd"]', "run.seconds = 0: must be a number of seconds above 0"),
        ('[run]\ncell = "konkuk9"\n[vary]\nlaw = ["pd"]', "run: konkuk9: no such file, and no cell of that name"),
        ('[vary]\ntrajectory = ["sin"]', "did you mean 'sine'?"),
        ('[vary]\nfaults = ["none", "missing.toml"]', "missing.toml"),
        ("[vary]\nseed = {from = 0, to = 999}\ntruth.joint3.mass = {from=0.1, to=1.0, count=5000}", "at most 1000000"),
        ('[vary]\nlaw = ["pd"]\n[tune]\nover = "median"', "tune.over = 'median': must be mean or worst"),
    ],
)
def test_a_bad_study_is_refused_in_a_line_before_anything_runs(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert canarm_here(["study", str(written(tmp_path, text)), "--out", str(tmp_path / "out")]) == 2
    complaint = capsys.readouterr().err
    assert said in complaint
    assert "my.toml" in complaint
    assert not (tmp_path / "out").exists()


def test_what_is_no_study_file_at_all_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert canarm_here(["study", str(tmp_path / "none.toml")]) == 2
    assert "none.toml: cannot be read: No such file" in capsys.readouterr().err
    assert canarm_here(["study", "/dev/zero"]) == 2
    assert "is no regular file" in capsys.readouterr().err


def test_a_run_that_cannot_be_carried_out_is_a_row_that_says_why(tmp_path: Path) -> None:
    study, _ = read_study(written(tmp_path, '[run]\nseconds = 0.05\n[vary]\ntrajectory = ["sine"]'))
    settings = study.base.changed({"trajectory": str(tmp_path / "gone.csv")})
    row = run_task(Task(0, settings, ()))
    assert row["state"] == "broken"
    assert "gone.csv" in row["reason"]


def test_runs_that_share_a_beginning_come_to_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faults = {
        "late.toml": '[[set]]\nat = 1.5\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"',
        "noisy.toml": '[[set]]\ncycle = 440\n[[set.fault]]\ntap = "joint3.potentiometer"\nfault = "noise"',
        "when.toml": '[[set]]\nwhen = "joint2.angle_deg>30"\n[[set.fault]]\ntap = "joint2.motor"\nfault = "open-load"',
        "wrong.toml": '[[set]]\nat = 1.5\n[[set.fault]]\ntap = "joint9.motor"\nfault = "open-load"',
    }
    names = ["none", *(str(written(tmp_path, text, name)) for name, text in faults.items())]
    study, _ = read_study(written(tmp_path, f"[run]\nseconds = 2.8\n[vary]\nseed = [3]\nfaults = {names}"))
    begun: list[int] = []

    def counted(*arguments: Any, **options: Any) -> Rig:
        begun.append(1)
        return Rig(*arguments, **options)

    monkeypatch.setattr("canarm.study.one_run.Rig", counted)
    tasks = list(Tasks(study, range(len(study))))
    assert all(task.shares for task in tasks)
    together = [run_task(task) for task in tasks]
    assert len(begun) == (4 if CAN_FORK else 5), "the last one goes on from the beginning of another"
    alone = [run_task(replace(task, shares=False)) for task in tasks]
    assert together == alone
    assert [row["state"] for row in alone] == ["done", "done", "failed", "failed", "broken"]
    assert [row["first_detector"] is not None for row in alone[:4]] == [False, True, True, True]


def test_a_process_keeps_nothing_of_the_runs_that_it_has_done() -> None:
    counts = []
    for number in range(12):
        run_task(Task(number, Settings(seed=number, seconds=0.05), ()))
        if number in (5, 11):
            gc.collect()
            counts.append(len(gc.get_objects()))
    # A run makes thousands of objects; six more of them, none that stays.
    assert counts[1] - counts[0] < 100


def test_a_heat_map_has_the_mean_of_each_field_and_the_share_of_stopped_runs(finished: Path) -> None:
    from canarm.study.description import description
    from canarm.study.findings import findings_of

    study, _ = read_study(finished / "my.toml")
    with Journal(finished / "out", description(study)) as journal:
        found = findings_of(study, journal)
    drawn = heat_map(study.axes[0], study.axes[1], found)
    rows = {(row["law"], row["truth.joint3.mass"]): row for row in table(finished / "out")}
    assert drawn.across == ("pd", "mras")
    for down, mass in enumerate((0.6, 2.4)):
        for across, law in enumerate(drawn.across):
            row = rows[law, mass]
            is_done = row["state"] == "done"
            assert drawn.lost[down, across] == (0.0 if is_done else 1.0)
            if is_done:
                assert drawn.means[down, across] == pytest.approx(row[JUDGED])
    worst = found.worst[0]
    assert worst.values["truth.joint3.mass"] == 2.4
    assert np.all(drawn.counts == 1)


def test_tuning_counts_a_stopped_run_as_worse_than_any_other() -> None:
    rows = [{"state": "done", "worst.rms_lsb": 0.5, "joint2.rms_lsb": 0.1}, {"state": "done", "worst.rms_lsb": 1.5}]
    assert Objective().of(rows) == 1.0
    assert Objective(over="worst").of(rows) == 1.5
    assert Objective("joint2.rms_lsb", "worst").of(rows[:1]) == 0.1
    assert Objective().of([{"state": "failed", "worst.rms_lsb": 0.01}]) == LOST


def test_gains_that_nobody_has_are_told_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(written(tmp_path, '[vary]\nlaw = ["mras"]\nset.control.mras.gamma_bias = [10.0, 20.0]'))
    out = ["--out", str(tmp_path / "out")]
    assert canarm_here(["study", path, *out, "--tune", "control.mras.gama"]) == 2
    assert "--tune control.mras.gama: fits no gain above 0" in capsys.readouterr().err
    assert canarm_here(["study", path, *out, "--tune", "control.mras.*"]) == 2
    assert "the study itself varies control.mras.gamma_bias" in capsys.readouterr().err


@pytest.mark.slow
def test_tuning_finds_a_frequency_that_follows_better_and_prints_cell_lines(canarm: Any) -> None:
    text = '[run]\nlaw = "pd"\nseconds = 3.84\n[vary]\ntruth.joint3.mass = [0.6, 0.9]\n[tune]\nevaluations = 16'
    written(canarm.folder, text)
    process = canarm("study", "my.toml", "--tune", "control.natural_frequency_rad_s", "--out", "out")
    assert process.wait() == 0, process
    said = "\n".join(process.stdout)
    before, after = map(float, re.findall(r"([\d.]+) with", said))
    # Without feed-forward the error of a proportional loop falls with the square of its natural frequency.
    assert after < 0.5 * before
    assert re.search(r"^\[control\]\nnatural_frequency_rad_s = [\d.]+  # was 12$", said, re.MULTILINE)
    again = canarm("study", "my.toml", "--tune", "control.natural_frequency_rad_s", "--out", "out")
    assert again.wait() == 0
    assert again.stdout == process.stdout


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_real_browser_draws_the_page(finished: Path, tmp_path: Path) -> None:
    page = finished / "out" / "study.html"
    assert "<three>" not in page.read_text()
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={tmp_path}"]
    done = subprocess.run(
        [str(CHROMIUM), *flags, "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=200, check=True
    )
    assert "CONSOLE" not in done.stderr, done.stderr
    assert 'data-drawn="3"' in done.stdout
    assert done.stdout.count('class="heat"') == 1
