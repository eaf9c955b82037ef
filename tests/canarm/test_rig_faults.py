"""Faults through the rig: how they are asked for and refused, what is told, shown and recorded of them."""

import inspect
import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from canarm import Rig
from canarm.rig.findings import Noticed
from canarm.rig.recorded import RecordedHistory, fault_events, noticed, read_events, recorded_joints
from canarm.rig.rig import State
from canarm.rig.rig_faults import FaultControl, read_script
from canarm.rig.rig_joint import SIGNALS, TRUE_SIGNALS, RigJoint, Span
from canarm.rig.run_plot import plot_run
from canarm.usage import UsageError
from canarm_controller.supervision.detection import Detection, Reaction
from canarm_emulator.faults import declaration
from canarm_emulator.faults.declaration import declared_faults
from canarm_emulator.faults.parameters import parameters_at
from canarm_emulator.faults.taps import taps_of
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_toml import as_toml
from canarm_protocol.faults.script import parse_faults

CYCLE_S = 0.0025
SVG = "{http://www.w3.org/2000/svg}"
TEXT = """\
[[set]]
name = "tachometer dies"
at = 0.5
duration = 0.25
[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
"""


def frames(rig: Rig) -> list[object]:
    return [(time_ns, frame) for time_ns, frame in rig.frames]


# Asking for faults


def test_a_fault_begins_and_ends_when_it_was_said_to() -> None:
    with Rig(law="pd") as rig:
        name = rig.inject("joint2.tachometer", "stuck", at=0.5, duration=0.25)
        rig.run(1.0)
        events = [(each.time_s, each.event, each.detail) for each in rig.events if each.event.startswith("fault")]
    assert name == "joint2.tachometer stuck"
    assert events == [
        (pytest.approx(0.5), "fault begins", "joint2.tachometer stuck"),
        (pytest.approx(0.75), "fault ends", "joint2.tachometer stuck"),
    ]
    assert [(each.cycle, each.is_begin) for each in rig.fault_events] == [(200, True), (300, False)]


def test_a_fault_without_a_trigger_begins_with_the_next_cycle() -> None:
    with Rig(law="pd") as rig:
        rig.run(0.5)
        rig.inject("joint2.tachometer", "stuck")
        rig.run(0.1)
        assert [each.cycle for each in rig.fault_events] == [200]


def test_a_fault_waits_for_its_cycle_or_its_condition() -> None:
    with Rig(law="pd") as rig:
        rig.inject("joint2.current_sense", "offset", cycle=77)
        rig.inject("joint3.current_sense", "offset", when="joint2.speed_rad_s > 0.2")
        rig.run(4.0)
        cycles = {each.tap: each.cycle for each in rig.fault_events}
        speeds_rad_s = rig.joints["joint2"].true_speed_rad_s
    assert cycles["joint2.current_sense"] == 77
    assert cycles["joint3.current_sense"] == int(np.argmax(speeds_rad_s > 0.2))


def test_a_manual_fault_waits_for_trigger_and_lasts_until_clear() -> None:
    with Rig(law="pd") as rig:
        name = rig.inject("joint2.current_sense", "offset", manual=True, name="mine")
        rig.run(0.1)
        assert [(each.name, each.state.value) for each in rig.fault_status] == [("mine", "waiting")]
        rig.trigger(name)
        rig.run(0.1)
        assert [each.state.value for each in rig.fault_status] == ["active"]
        rig.clear(name)
        rig.run(0.1)
        assert rig.fault_status == []
        assert [(each.cycle, each.is_begin) for each in rig.fault_events] == [(40, True), (79, False)]


def test_clear_without_a_name_clears_all() -> None:
    with Rig(law="pd") as rig:
        for tap in ("joint2.current_sense", "joint3.current_sense"):
            rig.inject(tap, "offset")
        rig.run(0.1)
        rig.clear()
        assert rig.fault_status == []
        assert sum(not each.is_begin for each in rig.fault_events) == 2


def test_repetitions_come_a_period_apart() -> None:
    with Rig(law="pd") as rig:
        rig.inject("joint2.current_sense", "offset", at=0.1, duration=0.05, repeat=3, period=0.2)
        rig.run(1.0)
        begins = [each.cycle for each in rig.fault_events if each.is_begin]
    assert begins == [40, 120, 200]


@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_the_same_fault_twice_gets_a_name_of_its_own() -> None:
    with Rig(law="pd") as rig:
        names = [rig.inject("joint2.current_sense", "offset", value=0.1) for _ in range(3)]
        assert names == [
            "joint2.current_sense offset",
            "joint2.current_sense offset #2",
            "joint2.current_sense offset #3",
        ]


@pytest.mark.parametrize("given", ["path", "name of a file", "text", "script", "constructor", "inject"])
def test_every_way_in_gives_the_same_frames(tmp_path: Path, given: str) -> None:
    (tmp_path / "faults.toml").write_text(TEXT)
    sources = {
        "path": tmp_path / "faults.toml",
        "name of a file": str(tmp_path / "faults.toml"),
        "text": TEXT,
        "script": parse_faults(TEXT),
    }
    with (
        Rig(law="mras", seed=1) as expected,
        Rig(law="mras", seed=1, faults=TEXT if given == "constructor" else None) as rig,
    ):
        assert expected.inject_file(TEXT) == ("tachometer dies",)
        if given == "inject":
            rig.inject("joint2.tachometer", "stuck", at=0.5, duration=0.25, name="tachometer dies")
        elif given != "constructor":
            assert rig.inject_file(sources[given]) == ("tachometer dies",)
        for each in (expected, rig):
            each.run(1.0)
        assert frames(rig) == frames(expected)
        assert len(rig.fault_events) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tap": "joint2.tacho"}, "no tap 'joint2.tacho'"),
        ({"fault": "stuk"}, "is not supported at joint2.tachometer (voltage of a sensor); did you mean 'stuck'?"),
        ({"fault": "wire-broken"}, "acts at: drive wire"),
        ({"valu": 3}, "no parameter 'valu'; did you mean 'value'?"),
        ({"value": 7.0}, "value = 7.0: must be a number from 0 to 5 V"),
        ({"at": -1}, "at = -1: must be a number of seconds"),
        ({"at": 1.0, "cycle": 3}, "has at and cycle; must have one trigger"),
        ({"when": "joint2.angl > 3"}, "no signal 'joint2.angl'"),
        ({"repeat": 2}, "needs a duration"),
        ({"repeat": True}, "repeat = True: must be a whole number"),
        ({"manual": 0}, "manual = 0: must be true or false"),
        ({"name": "taken"}, "a set named 'taken' is there already"),
        ({"tap": "can0.wire", "fault": "bus-off"}, "start the emulator with --wire, a Rig with wire=True"),
    ],
    ids=str,
)
@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_what_is_not_supported_is_refused_at_once_and_changes_nothing(arguments: dict, message: str) -> None:
    with Rig(law="pd") as rig:
        rig.inject("joint2.current_sense", "offset", manual=True, name="taken")
        before = rig.fault_status
        with pytest.raises(FaultError) as caught:
            rig.inject(**{"tap": "joint2.tachometer", "fault": "stuck", **arguments})
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
        assert rig.fault_status == before


@pytest.mark.parametrize("command", ["trigger", "clear"])
@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_a_set_that_there_is_not_is_refused(command: str) -> None:
    with Rig(law="pd") as rig, pytest.raises(FaultError, match=f"no set 'mine' to {command}; there are none"):
        getattr(rig, command)("mine")


def test_a_fault_file_that_cannot_be_read_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(FaultError, match=r"^fault file .*nowhere\.toml: cannot be read: .*No such file"):
        Rig(law="pd", faults=tmp_path / "nowhere.toml")


def test_no_parameter_of_a_fault_has_the_name_of_an_argument_of_inject() -> None:
    taken = set(inspect.signature(FaultControl.inject).parameters) - {"parameters"}
    taps = taps_of(load_cell("konkuk1")).values()
    for (name, kind), fault in declared_faults().items():
        tap = next((each for each in taps if each.kind is kind), None)
        if tap is not None:
            assert not taken & {each.name for each in parameters_at(fault, tap)}, name


@pytest.mark.parametrize(
    "text",
    [
        TEXT,
        'clear = "x"',
        'trigger = "a set with \\"signs\\" \\\\ and ü"',
        'parallel = true\n[[set]]\nwhen = "joint2.angle_deg > 3"\n'
        "[[set]]\nmanual = true\nduration = 1\nrepeat = 2\nperiod = 3\n"
        '[[set.fault]]\ntap = "a"\nfault = "b"\nword = "c"\nswitch = true\nnumber = 1e-3\nwhole = 5\n',
    ],
)
def test_a_script_as_text_is_read_as_the_same_script(text: str) -> None:
    script = read_script(text)
    assert parse_faults(as_toml(script)) == script


# Times that are over, or never come


@pytest.mark.parametrize(
    ("trigger", "message"),
    [
        ({"at": 0.1}, "set 'x': at = 0.1 s is over: it is 0.4983 s, in cycle 199; to begin now, leave it out"),
        ({"cycle": 199}, "set 'x': cycle = 199 is over: it is 0.4983 s, in cycle 199"),
    ],
)
def test_a_time_that_is_over_is_refused_with_the_time_that_it_is(trigger: dict, message: str) -> None:
    with Rig(law="pd") as rig:
        rig.run(0.5)
        with pytest.raises(FaultError) as caught:
            rig.inject("joint2.current_sense", "offset", name="x", **trigger)
        assert re.sub(r"it is 0\.49\d\d s", "it is 0.4983 s", str(caught.value)).startswith(message)
        assert rig.fault_status == []
        rig.inject("joint2.current_sense", "offset", name="x", at=0.5)
        rig.run(0.1)
        assert [each.cycle for each in rig.fault_events] == [200]


def test_of_an_ordered_file_only_the_first_set_can_be_too_late() -> None:
    later = TEXT.replace("tachometer dies", "again").replace("at = 0.5", "at = 0.1")
    with Rig(law="pd") as rig:
        rig.run(0.3)
        assert rig.inject_file(TEXT + later) == ("tachometer dies", "again")
        with pytest.raises(FaultError, match=r"set 'again': at = 0\.1 s is over"):
            rig.inject_file(later + TEXT)


def test_sets_that_never_began_are_told_at_the_end() -> None:
    with Rig(law="pd") as rig:
        for name, at in (("early", 0.1), ("on the last cycle", 0.5), ("late", 5.0)):
            rig.inject("joint2.current_sense", "offset", name=name, at=at)
        rig.clear(rig.inject("joint2.current_sense", "offset", manual=True, name="cleared"))
        rig.run(0.5)
        rig.finish()
        rig.finish()
    assert rig.never_begun == ["on the last cycle", "late"]
    told = [each.detail for each in rig.events if each.event == "fault never began"]
    assert told == ["on the last cycle", "late"]


def test_a_faulty_fault_is_told_by_run_and_the_run_may_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    declared_faults()
    monkeypatch.setattr(declaration, "_DECLARED", dict(declaration._DECLARED))

    @dataclass
    class Faulty(declaration.SignalFault, name="faulty", acts_on=[declaration.TapKind.SENSOR]):
        """Divides by zero."""

        def apply(self, value: float, now_ns: int) -> float:
            return value / 0

    with Rig(law="pd") as rig:
        rig.inject("joint2.tachometer", "faulty", at=0.1)
        expected = r"^joint2.tachometer faulty failed: ZeroDivisionError: .* \(.*test_rig_faults.py:\d+\)$"
        with pytest.raises(FaultError, match=expected):
            rig.run(0.5)
        rig.run(0.1)
        assert (rig.state, [each.is_begin for each in rig.fault_events]) == (State.RUNNING, [True, False])
        assert [each.event for each in rig.events if "failed: ZeroDivisionError" in each.detail] == ["fault ends"]


@pytest.mark.parametrize(
    "typo",
    [
        lambda rig: rig.inject("joint2.tacho", "stuck"),
        lambda rig: rig.inject("joint2.tachometer", "stuck", at=-1.0),
        lambda rig: rig.inject_file("[["),
        lambda rig: rig.trigger("mine"),
        lambda rig: rig.clear("mine"),
        lambda rig: rig.detected("tacho"),
        lambda rig: rig.joints["joint2"].stays_below("curent_a", 1.0),
        lambda rig: rig.joints["joint2"].departure("curent_a", 1.0, since=0.0),
        lambda rig: rig.joints["joint7"],
    ],
)
@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_a_typo_is_shown_where_it_stands_without_our_own_frames(typo: Callable[[Rig], object]) -> None:
    with Rig(law="pd") as rig, pytest.raises((FaultError, UsageError)) as caught:
        typo(rig)
    shown = [entry for entry in caught.traceback if not entry.ishidden(caught)]
    assert {entry.path.name for entry in shown} == {Path(__file__).name}


@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_a_tap_is_suggested_by_its_beginning() -> None:
    with Rig(law="pd") as rig, pytest.raises(FaultError, match=r"did you mean 'joint2\.tachometer'"):
        rig.inject("joint2.tacho", "stuck")


# The picture


def test_the_picture_shows_the_time_around_fault_and_detection() -> None:
    with Rig(law="mras") as rig:
        rig.inject("joint2.tachometer", "stuck", at=1.0)
        rig.run(2.0)
        found = [
            Noticed(1.1, Detection("tachometer-stuck", "joint2", 0, "", Reaction.CONTINUE)),
            Noticed(1.2, Detection("inputs-missing", None, 0, "", Reaction.CONTINUE)),
        ]
        root = ElementTree.fromstring(plot_run("title", rig.joints, rig.begun, found))
    lines = [each.get("points", "").split() for each in root.iter(f"{SVG}polyline")]
    assert len(lines) == 2 * 6
    assert all(len(points) == round((0.3 + 0.7) / CYCLE_S) + 1 for points in lines)
    texts = ["".join(each.itertext()) for each in root.iter(f"{SVG}text")]
    assert {"joint2: true speed, rad/s", "1.0000 s  fault: joint2.tachometer stuck"} <= set(texts)
    assert "1.1000 s  detected: tachometer-stuck at joint2" in texts
    # Numbers above the panels, and once more before the words: 1 fault, 2 at one joint, 3 everywhere.
    assert [sum(text == number for text in texts) - 1 for number in ("3",)] == [6]
    marks = [each for each in root.iter(f"{SVG}path") if each.get("stroke-dasharray") == "2 3"]
    assert len(marks) == 6 + 3 + 6


def test_the_picture_has_no_legend_for_curves_that_there_are_not() -> None:
    class TruthAlone:
        def span(self, joint: int, signal: str) -> Span:
            size = 5 if SIGNALS.index(signal) < TRUE_SIGNALS else 0
            return Span(np.arange(size), np.arange(size) * CYCLE_S, np.ones(size))

    root = ElementTree.fromstring(plot_run("title", {"joint2": RigJoint(TruthAlone(), 0, "joint2", 1.0)}))
    texts = ["".join(each.itertext()) for each in root.iter(f"{SVG}text")]
    assert {"true", "current", "command"} <= set(texts)
    assert not {"measured", "reference"} & set(texts)


# What a fault does to the rig itself


def test_a_rig_whose_fault_never_begins_has_the_same_frames() -> None:
    with Rig(law="mras", seed=5) as plain, Rig(law="mras", seed=5) as armed:
        armed.inject("joint2.tachometer", "stuck", at=1000.0)
        for rig in (plain, armed):
            rig.run(1.0)
        assert frames(plain) == frames(armed)


def test_frames_that_a_fault_sends_reach_the_controller() -> None:
    """A heartbeat with the controller's node-ID that it did not send is what it calls a foreign master."""
    with Rig(law="mras", wire=True) as rig:
        rig.inject("can0.tx", "babbling-idiot", cob_id=0x701, at=0.5)
        rig.run(1.0)
        assert rig.detected("foreign-master").within(0.0025)
        assert rig.state is State.FAILED


def test_error_frames_are_no_data_to_the_controller() -> None:
    with Rig(law="mras", wire=True) as rig:
        rig.inject("can0.wire", "error-frames", cob_id=0x294, at=0.5, duration=0.05)
        rig.run(1.0)
        assert any(frame.is_error for _, frame in rig.frames)
        assert rig.controller.ignored_frames == 0


def test_a_broken_wire_ends_in_torque_off() -> None:
    with Rig(law="mras") as rig:
        rig.inject("joint2.wire", "wire-broken", at=1.0)
        rig.run(0.9)
        assert not rig.torque_is_off
        rig.run(2.0)
        assert (rig.state, rig.torque_is_off) == (State.FAILED, True)
        assert rig.joints["joint2"].stays_below("command_a", 0.0, since=1.1)


# The record


def test_the_summary_has_faults_and_detections() -> None:
    with Rig(law="mras") as rig:
        rig.inject("can0.tx", "lost", at=0.5)
        rig.run(1.0)
    summary = rig.summary()
    assert summary.faults == 1
    assert [each["detector"] for each in summary.detections] == [each.detector for each in rig.detections]
    assert summary.detections


def test_the_run_folder_tells_the_same_story_as_the_rig(tmp_path: Path) -> None:
    with Rig(law="mras", out=tmp_path / "run") as rig:
        rig.inject("can0.tx", "lost", at=1.0)
        rig.run(3.0)
    events = read_events(tmp_path / "run")
    assert fault_events(events) == rig.fault_events
    assert noticed(events) == rig.noticed
    figures = {name: rig.summary().joints[name] for name in rig.joints}
    joints = recorded_joints(rig.cell, RecordedHistory(rig.cell, tmp_path / "run", figures))
    for name, joint in rig.joints.items():
        for signal in SIGNALS:
            told, known = joints[name].span(signal), joint.span(signal)
            assert told.cycle.tolist() == known.cycle.tolist()
            assert told.time_s == pytest.approx(known.time_s, abs=1e-6)
            assert told.value == pytest.approx(known.value, rel=1e-8, abs=1e-12)
        assert joints[name].peak_current_a == joint.peak_current_a
    kinds = {json.loads(line)["event"] for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()}
    assert {"state", "fault-begins", "detection"} <= kinds


def test_a_truth_that_changes_while_a_fault_acts_keeps_the_fault_and_outlasts_it() -> None:
    with Rig("konkuk1") as rig:
        rig.inject("joint3.link", "payload-change", name="payload", mass=0.1)
        rig.run(seconds=0.1)
        rig.change_truth("joint2.viscous", 0.07)
        assert rig._bench.world.truth.joints[0].viscous_friction_nm_s == 0.07
        assert rig._bench.world.truth.joints[1].payload_kg == 0.1
        rig.clear("payload")
        assert rig._bench.world.truth.joints[0].viscous_friction_nm_s == 0.07
        assert rig._bench.world.truth.joints[1].payload_kg == 0.0
