"""Studies whose runs end before errors count: they are told so, and a missing figure is never the worst one.

`canarm demo` says in the summary of such a run what a study has to say: after how many cycles errors count.
"""

import re
from pathlib import Path

import pytest

from canarm import Rig
from canarm.cli import run as canarm_here

TWO_LAWS = '[run]\nseconds = {seconds}\n[vary]\nlaw = ["pd", "mras"]\n'
CYCLE_S = 2.5e-3
"""konkuk1's, by its paper."""


def summary_line() -> str:
    """What the summary of a short run says, without what it calls its option."""
    with Rig() as rig:
        rig.run(0.05)
        (line,) = [each for each in rig.summary().as_text().splitlines() if each.startswith("errors count")]
    return line.partition(" (--")[0]


def study(folder: Path, seconds: float, *words: str) -> int:
    path = folder / "my.toml"
    path.write_text(TWO_LAWS.format(seconds=seconds))
    return canarm_here(["study", str(path), "--out", str(folder / "out"), "--jobs", "1", *words])


def test_who_studies_short_runs_is_told_before_the_first_of_them_that_they_have_no_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert study(tmp_path, 0.05) == 0
    said = capsys.readouterr()
    first, *_ = said.err.splitlines()
    assert summary_line() in first
    assert "2.56 s of konkuk1" in first
    assert f"2 runs without a figure of errors: {summary_line()}" in said.out
    assert "canarm demo" not in said.out, "no run is the worst"
    page = (tmp_path / "out" / "study.html").read_text()
    assert summary_line() in page
    assert "Mean of the peak current, A" in page, "the figure that they have"
    assert '<td class="n" style="background:#f87171;color:#111">–' not in page
    assert not re.search(r"<code>canarm demo", page)


@pytest.mark.slow
def test_who_studies_runs_with_one_cycle_of_errors_is_told_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert study(tmp_path, 1025 * CYCLE_S) == 0
    said = capsys.readouterr()
    assert "errors count" not in said.out + said.err
    assert "run 0, " in said.out


def test_who_tunes_on_runs_without_errors_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert study(tmp_path, 1024 * CYCLE_S, "--tune", "control.natural_frequency_rad_s") == 2
    said = capsys.readouterr().err
    assert "--tune would compare nothing" in said
    assert summary_line() in said
    assert not (tmp_path / "out").exists()
