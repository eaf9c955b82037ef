"""Whole robots drawn from the box, in runs without a fault: nothing is detected, nothing stopped."""

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

from canarm_controller.laws.loading import LAWS

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
alarms = importlib.import_module("alarms")

SOME, MANY, SEED = 8, 100, 20


KNOWN: set[int] = set()
KNOWN_OF_CELLS = {3, 4, 6, 7, 11, 13, 15, 18, 19}
"""Draws that are accused wrongly, as docs/detectors.md counts them. None may come, each that goes is taken out."""


def accused(wanted: list[Any]) -> dict[int, str]:
    """What is said of each draw that is accused, by its number."""
    results = {job.number: alarms.run(job) for job in wanted}
    return {
        number: "\n".join(alarms.lines_of(each, ""))
        for number, each in results.items()
        if each.alarms or each.is_stopped
    }


def test_some_whole_robots_raise_no_alarm() -> None:
    assert accused(alarms.jobs(MANY, SEED, False)[:SOME]) == {}


MENDED = {
    "a payload that turns with both joints": (3000, 7, 106),
    "a code that stands while another joint shows that the payload has changed": (3000, 7, 73),
    "an arm with an elastic wire that swings back from a payload that was changed": (300, 8, 132),
    "a code that stands at the end of a motor's swing": (100, 20, 62),
}
"""Draws, seed and number of runs in which a whole robot was accused."""


@pytest.mark.parametrize("run", MENDED.values(), ids=MENDED)
def test_no_whole_robot_is_accused_of(run: tuple[int, int, int]) -> None:
    draws, seed, number = run
    assert accused(alarms.jobs(draws, seed, False)[number : number + 1]) == {}


@pytest.mark.slow
def test_of_a_hundred_whole_robots_none_but_the_known_ones_are_accused() -> None:
    drawn = alarms.jobs(MANY, SEED, False)
    assert {job.run["law"] for job in drawn} == set(LAWS)
    assert _others(accused(drawn[SOME:]), KNOWN) == {}


@pytest.mark.slow
def test_of_whole_robots_of_other_cells_none_but_the_known_ones_are_accused() -> None:
    drawn = alarms.jobs(20, SEED, True)
    assert {job.cell["joints"] for job in drawn} == set(range(1, 8))
    assert _others(accused(drawn), KNOWN_OF_CELLS) == {}


def _others(found: dict[int, str], known: set[int]) -> dict[int, str]:
    return {number: said for number, said in found.items() if number not in known}


def test_an_alarm_is_printed_with_what_repeats_it(capsys: pytest.CaptureFixture[str]) -> None:
    """A wire far softer than any of the box is no whole robot."""
    (job,) = alarms.jobs(1, SEED, False)
    soft = {"joint2.wire": "elastic", "joint2.wire_stiffness": 0.02, "joint3.wire": "rigid"}
    job.robot.update(soft)
    job.run.update(law="mras", motion="sine", cycle=2.5, change="no")
    result = alarms.run(job)
    assert result.alarms
    lines = list(alarms.lines_of(result, "--draws 1 --draw-seed 20"))
    assert lines[-1].endswith("make alarms ARGS='--draws 1 --draw-seed 20 --only 0'")
    verdict = "\n".join(alarms.verdict_lines([result]))
    assert "false alarms: 1 of 1 runs; 95 % bounds 2.5 to 1e+02 %" in verdict  # 0.025 and 1


def test_a_change_of_payload_may_be_noticed_for_three_seconds_and_is_no_stop() -> None:
    assert alarms._is_change("acceleration-mismatch", 500, 400, 0.0025)
    assert not alarms._is_change("acceleration-mismatch", 1700, 400, 0.0025)  # 3.25 s later
    assert not alarms._is_change("acceleration-mismatch", 399, 400, 0.0025)
    assert not alarms._is_change("tachometer-stuck", 500, 400, 0.0025)
    assert not alarms._is_change("acceleration-mismatch", 500, None, 0.0025)
