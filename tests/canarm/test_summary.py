"""The summary of a run as text and as JSON."""

import json
import math
from dataclasses import replace

import pytest

from canarm.summary import Summary
from canarm_controller.bus.assessment import JointFigures

GOOD = JointFigures(rms_lsb=0.0612345678, max_lsb=0.17, peak_current_a=0.817, saturated_cycles=0, speed_ripple=0.021)
UNKNOWN = JointFigures(rms_lsb=None, max_lsb=None, peak_current_a=0.0, saturated_cycles=0, speed_ripple=None)
SUMMARY = Summary(
    cell="konkuk1",
    law="mras",
    trajectory="sine",
    feedforward="table",
    clock="sync",
    seed=0,
    state="done",
    reason=None,
    ticks=4096,
    missed=0,
    late=0,
    real_time_factor=12.3456789,
    joints={"joint2": GOOD, "joint3": replace(GOOD, saturated_cycles=12)},
    out="runs/x",
)


def test_json_has_the_promised_keys_and_rounded_numbers() -> None:
    document = json.loads(json.dumps(SUMMARY.as_json()))
    promised = {"cell", "law", "clock", "seed", "state", "ticks", "missed", "real_time_factor", "joints", "out"}
    assert promised <= document.keys()
    assert {"rms_lsb", "max_lsb", "peak_current_a"} <= document["joints"]["joint2"].keys()
    assert document["real_time_factor"] == 12.346
    assert document["joints"]["joint2"]["rms_lsb"] == 0.061235
    assert document["joints"]["joint3"]["saturated_cycles"] == 12
    assert document["ticks"] == 4096


def test_text_shows_every_joint_and_says_who_saturated() -> None:
    lines = SUMMARY.as_text().splitlines()
    assert lines[0] == "DONE: konkuk1, mras on sine, feed-forward table, clock sync"
    assert lines[1] == "4096 cycles, 12.3 x real time, 0 missed, 0 late"
    (second,) = (line for line in lines if line.startswith("joint2"))
    (third,) = (line for line in lines if line.startswith("joint3"))
    assert second.split() == [
        "joint2",
        "0.061",
        "LSB",
        "0.170",
        "LSB",
        "0.817",
        "A",
        "2.1",
        "%",
        "within",
        "its",
        "limit",
    ]
    assert third.endswith("saturated in 12 cycles")
    assert lines[-1] == "recorded in runs/x"


def test_a_failed_run_gives_its_reason_before_its_figures() -> None:
    lines = (
        replace(SUMMARY, state="failed", reason="heartbeat-lost: card 'adc' silent", out=None).as_text().splitlines()
    )
    assert lines[:2] == [
        "FAILED: konkuk1, mras on sine, feed-forward table, clock sync",
        "heartbeat-lost: card 'adc' silent",
    ]


def test_what_is_not_known_is_null_and_a_dash() -> None:
    summary = replace(SUMMARY, joints={"joint2": UNKNOWN}, seed=None, real_time_factor=None)
    document = summary.as_json()
    assert document["joints"]["joint2"]["rms_lsb"] is None
    assert document["seed"] is None
    (line,) = (line for line in summary.as_text().splitlines() if line.startswith("joint2"))
    assert line.split()[:3] == ["joint2", "-", "-"]


def test_columns_stand_under_their_heads() -> None:
    lines = [line for line in SUMMARY.as_text().splitlines() if line.startswith("joint")]
    head, *rows = lines
    assert {row.index("LSB") + 3 for row in rows} == {head.index("RMS error") + len("RMS error")}


@pytest.mark.parametrize("value", [math.pi * 1e-9, 123456.789, 0.0])
def test_five_digits_are_kept_whatever_the_size(value: float) -> None:
    document = replace(SUMMARY, real_time_factor=value).as_json()
    assert document["real_time_factor"] == pytest.approx(value, rel=5e-5)


def test_a_run_that_was_too_short_to_be_assessed_says_from_when_on_errors_count() -> None:
    short = replace(SUMMARY, ticks=400, joints={"joint2": UNKNOWN, "joint3": UNKNOWN})
    text = short.as_text()
    assert (
        "errors count after the first 1024 cycles, in which the motion blends in: take more of them (--seconds)" in text
    )
    assert "errors count" not in SUMMARY.as_text()
    assert "errors count" not in replace(short, ticks=4096).as_text()
