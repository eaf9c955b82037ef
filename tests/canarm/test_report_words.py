"""What a report says where its figures alone would mislead: early faults, short runs, unlike runs, fault scripts."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig, open_run
from canarm.cli import run as canarm
from canarm.runs.report.page import charts_in_page, report_page
from canarm.runs.report.story import verdict

STEP_RAD = np.radians(270.0 / 255)
"""konkuk1's potentiometer: 270 degrees over the 255 steps of an ADC0809."""


def broken(folder: Path, seconds: float, at: float, **arguments: object) -> Path:
    """A run whose joint2 gets 8 codes too much for half a second."""
    with Rig(out=folder, **arguments) as rig:  # type: ignore[arg-type]
        rig.inject("joint2.dac.code", "offset", value=8, at=at, duration=0.5)
        rig.run(seconds)
    return folder


@pytest.fixture(scope="module")
def early(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return broken(tmp_path_factory.mktemp("words") / "early", 2.7, at=1.0)


def said_of_the_part_left_out(folder: Path) -> list[str]:
    return [line for line in verdict(open_run(folder))[1] if "left out:" in line or "left out," in line]


def test_who_reads_of_a_fault_before_errors_count_is_told_how_far_the_joint_went_from_its_begin_on(early: Path) -> None:
    run = open_run(early)
    (said,) = said_of_the_part_left_out(early)
    true, reference, time_s = (
        run.columns[name] for name in ("joint2.true_angle_rad", "joint2.reference_rad", "time_s")
    )
    most = np.nanmax(np.abs(true - reference)[time_s >= 1.0]) / STEP_RAD
    assert "joint2.dac.code offset lies in the part that is left out: from its begin on, " in said
    figure = re.search(r"joint2 erred by ([\d.e-]+) steps", said)
    assert figure is not None
    assert float(figure.group(1)) == pytest.approx(most, rel=5e-3)
    counted = run.summary["joints"]["joint2"]["max_lsb"]
    assert float(figure.group(1)) > 1.2 * counted, "the figures of the run do not have it"


def test_a_fault_that_reaches_into_what_counts_only_begins_in_the_part_left_out(tmp_path: Path) -> None:
    (said,) = said_of_the_part_left_out(broken(tmp_path / "run", 2.7, at=2.2))
    assert "joint2.dac.code offset begins in the part" in said


def test_of_a_fault_after_the_part_left_out_the_figures_say_enough(tmp_path: Path) -> None:
    assert not said_of_the_part_left_out(broken(tmp_path / "run", 2.7, at=2.5625))  # cycle 1025


def test_a_report_of_a_short_run_says_from_when_errors_count(tmp_path: Path) -> None:
    with Rig(out=tmp_path / "run") as rig:
        rig.run(0.1)
    assert any("errors count after the first 1024 cycles" in line for line in verdict(open_run(tmp_path / "run"))[1])


def test_a_fault_script_is_read_line_by_line(early: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert canarm(["runs", "show", str(early)]) == 0
    shown = capsys.readouterr().out
    lines = [line.strip() for line in shown.splitlines()]
    for text in (shown, report_page([open_run(early)])):
        assert "\\n" not in text.partition("fault-script")[2].partition("fault-begins")[0]
    begin = lines.index("[[set]]")
    assert "at = 1.0" in lines[begin:]
    assert lines[lines.index("[[set.fault]]") + 1] == 'tap = "joint2.dac.code"'


def test_a_script_that_somebody_has_written_obeys_nothing(early: Path, tmp_path: Path) -> None:
    for name in ("run.json", "events.jsonl"):
        (tmp_path / name).write_bytes((early / name).read_bytes())
    foreign = {"time_s": 0.0, "cycle": 0, "source": "emulator", "event": "fault-script", "power_on_s": 0.0}
    with (tmp_path / "events.jsonl").open("a") as file:
        for text in ("a\x1b[2J\n</pre><script>1", 7):
            file.write(json.dumps({**foreign, "toml": text}) + "\n")
    page = report_page([open_run(tmp_path)])
    assert "\x1b" not in page
    assert "</pre><script>1" not in page
    assert "&lt;/pre&gt;&lt;script&gt;1" in page


def test_runs_of_unlike_motions_and_lengths_are_compared_with_a_word_of_that(
    early: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = broken(tmp_path / "other", 1.0, at=0.4, trajectory="trapezoid")
    page = tmp_path / "page.html"
    assert canarm(["report", str(early), str(other), "--out", str(page)]) == 0
    said = (
        "These runs differ in their motions (sine of early, trapezoid of other) and lengths (1080 cycles of early, "
        "400 cycles of other): ratios compare what is not alike."
    )
    assert said in capsys.readouterr().err
    assert said in page.read_text()
    charts = {chart.title: chart for chart in charts_in_page([open_run(early), open_run(other)])}
    angle = charts["joint2: angle, degrees"]
    assert {"early: reference", "other: reference"} <= {each.name for each in angle.series}
    spans = {(text.partition(":")[0], round(begin, 4), round(end, 4)) for begin, end, text in angle.bands}
    assert spans == {("early", 1.0, 1.5), ("other", 0.4, 0.9)}


def test_of_runs_of_one_motion_one_reference_is_drawn_and_something_against_nothing_has_no_ratio(
    early: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Rig(out=tmp_path / "whole") as rig:
        rig.run(2.7)
    runs = [open_run(tmp_path / "whole"), open_run(early)]
    charts = {chart.title: chart for chart in charts_in_page(runs)}
    references = [each.name for each in charts["joint2: angle, degrees"].series if "reference" in each.name]
    assert references == ["whole: reference"]
    page = report_page(runs)
    assert "These runs differ" not in page
    row = re.search(r"<td>faults</td>.*", page)
    assert row is not None
    assert "inf" not in row.group()
    assert canarm(
        ["report", *(str(run.path) for run in runs), "--out", str(tmp_path / "p"), "--fail-above", "faults=2"]
    )
    assert "faults of early: 1 where whole has none, above 2" in capsys.readouterr().out
