"""Fault-free runs of every law and motion, drawn over seeds and payloads: nothing is detected."""

import runpy
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "scripts" / "false_alarms.py"
RUNS = 20


def test_twenty_runs_without_a_fault_raise_no_alarm() -> None:
    script = runpy.run_path(str(SCRIPT))
    drawn = script["draws"](RUNS, seed=1)
    assert {draw.law for draw in drawn} == set(script["LAWS"])
    assert {(draw, *alarms) for draw in drawn for _, alarms in [script["run"](draw)] if alarms} == set()
