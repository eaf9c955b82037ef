"""Faults as values and as words: JSON as docs/faults.md describes it in, lines of the panel out."""

import pytest

from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import parse_faults, trigger_text
from canarm_tui import fault_texts
from canarm_tui.event_texts import event_line, marks_of, stopped_by
from canarm_tui.events import happenings
from canarm_tui.fault_catalogue import FaultKind, Parameter, catalogue_of, injection, matching
from canarm_tui.fault_desk import Refusal
from canarm_tui.fault_texts import answer_word
from canarm_tui.faults import ActingFault, Faults, FaultSignal, faults_of
from canarm_tui.outcome import Outcome, with_cause
from canarm_tui.texts import SEPARATOR, Tone

CYCLE_S = 0.0025
DIES = {"set": "dies", "tap": "joint2.tachometer", "fault": "stuck"}
PLAIN = [
    {
        "tap": "joint2.tachometer",
        "about": "tachometer's voltage at the ADC's pin",
        "unit": "V",
        "kind": "voltage of a sensor",
        "faults": [
            {
                "fault": "stuck",
                "family": "signal",
                "about": "The signal stays at one value.",
                "needs_wire": False,
                "parameters": [
                    {"name": "value", "about": "where", "default": None, "unit": "V", "minimum": 0.0, "maximum": 5.0},
                    {"name": "side", "about": "which", "default": "low", "choices": ["low", "high"]},
                ],
            }
        ],
    },
    {
        "tap": "can0.tx",
        "about": "frames that the cards send",
        "unit": "",
        "kind": "messages on the bus",
        "faults": [
            {
                "fault": "lost",
                "family": "bus",
                "about": "The frame never comes.",
                "needs_wire": True,
                "parameters": [
                    {"name": "cob_id", "about": "which", "default": 0, "unit": "", "minimum": 0, "maximum": 0x7FF}
                ],
            }
        ],
    },
]
STUCK = FaultKind("stuck", "stays", False, (Parameter("value", "where", "", "0 to 5 V"), Parameter("n", "", "4", "")))


def event(name, time_s, cycle=-1, **of):
    return {"time_ns": round(time_s * 1e9), "event": f"fault-{name}", **DIES, **of, "cycle": cycle}


def detection(time_s, cycle, reaction="substitute"):
    return {
        "time_ns": round(time_s * 1e9),
        "event": "detection",
        "cycle": cycle,
        "detector": "tachometer-stuck",
        "where": "joint2",
        "detail": "joint2: no change",
        "reaction": reaction,
    }


def status(active=(), sets=()):
    return {"active": list(active), "sets": [set_of(name, state) for name, state in sets]}


def set_of(name, state):
    """As the bench says it; what waits has a trigger."""
    waits_for = {"trigger": "when joint2.angle_deg > 30"} if state == "waiting" else {}
    return {"set": name, "state": state, "activations": 1, **waits_for}


def text_of(lines):
    return [SEPARATOR.join(word.text for word in line) for line in lines]


def panel_lines(signal, faults, refusal, cycle_s):
    return fault_texts.panel_lines(signal, faults, refusal, happenings(faults or Faults()), cycle_s)


# What the bench says


def test_a_fault_acts_since_its_last_beginning():
    events = [event("begins", 1.0, 300), event("ends", 1.5, 500), event("begins", 2.0, 700)]
    (acting,) = faults_of(status([DIES]), events).acting
    assert (acting.began.time_s, acting.began.cycle) == (2.0, 700)


def test_a_fault_whose_beginning_the_bench_has_forgotten_acts_since_nobody_knows_when():
    assert faults_of(status([DIES]), []).acting == (ActingFault("dies", "joint2.tachometer", "stuck"),)


def test_sets_that_wait_are_told_from_those_that_act_and_those_that_are_over():
    faults = faults_of(status([DIES], [("over", "ended"), ("dies", "active"), ("later", "waiting")]), [])
    assert faults.waiting == ("later",)
    assert faults.set_names == ("dies", "later")


def test_events_are_newest_first():
    faults = faults_of(status(), [event("begins", float(second)) for second in range(30)])
    assert [round(each.time_s) for each in faults.events[:2]] == [29, 28]
    assert len(faults.events) == 30


# What has happened


def test_a_detection_says_how_long_after_the_last_fault_it_came_and_what_was_done():
    events = [event("begins", 1.0, 300), event("ends", 3.0, 1100)]
    faults = faults_of(status(), events, [detection(1.5, 305), detection(3.1, 1140)])
    assert text_of([event_line(each, CYCLE_S) for each in happenings(faults)]) == [
        "2.850 s (cycle 1140) │ ◆ detected: tachometer-stuck at joint2 │ substitute │ "
        "2100.0 ms after joint2.tachometer stuck (dies) │ joint2: no change",
        "2.750 s (cycle 1100) │ ○ fault ends: joint2.tachometer stuck (dies)",
        "0.763 s (cycle 305) │ ◆ detected: tachometer-stuck at joint2 │ substitute │ "
        "12.5 ms after joint2.tachometer stuck (dies) │ joint2: no change",
        "0.750 s (cycle 300) │ ▲ fault begins: joint2.tachometer stuck (dies)",
    ]


def test_times_and_causes_are_those_of_the_present_run():
    # Cycle 0 of this run was 10.6 s after power-on; before it, and over long since in it, faults have ended.
    events = [
        event("begins", 1.0, 300),
        event("ends", 3.0, 1100),
        event("begins", 11.1, 200),
        event("ends", 11.35, 300),
    ]
    seen = [detection(9.0, 3500), detection(10.7, 40), detection(11.4, 310), detection(14.0, 1300)]
    happened = happenings(faults_of({**status(), "time_ns": 15 * 10**9, "begin_ns": 10_600_000_000}, events, seen))
    lines = text_of([event_line(each, CYCLE_S) for each in happened])
    assert lines[0] == "3.250 s (cycle 1300) │ ◆ detected: tachometer-stuck at joint2 │ substitute │ joint2: no change"
    assert "275.0 ms after joint2.tachometer stuck" in lines[1], "310 minus 200 cycles of 2.5 ms"
    assert lines[4].startswith("0.100 s (cycle 40) │ ◆ detected")
    assert " after " not in lines[4]
    assert lines[5].startswith("earlier run (cycle 3500) │ ◆ detected")
    assert [cycle for cycle, _ in marks_of(happened, "joint2", ("joint2",))] == [1300, 310, 300, 200, 40]


def test_before_cycle_0_of_a_new_run_all_that_was_is_an_earlier_ones():
    found = faults_of({**status(), "time_ns": 5 * 10**9, "begin_ns": None}, [event("begins", 1.0, 300)])
    assert [each.is_earlier for each in happenings(found)] == [True]


def test_the_emergency_stop_is_an_event_and_the_cause_of_what_is_detected_after_it():
    stops = [
        {"time_ns": 4_000_000_000, "event": "emergency-stop", "state": "on", "cycle": 1600},
        {"time_ns": 9_000_000_000, "event": "emergency-stop", "state": "off", "cycle": 1640},
    ]
    seen = [detection(4.2, 1610, reaction="safe-stop-off")]
    faults = faults_of({**status(), "stops": stops}, [event("begins", 1.0, 400)], seen)
    happened = happenings(faults)
    lines = text_of([event_line(each, CYCLE_S) for each in happened])
    assert lines[0] == "4.100 s (cycle 1640) │ □ emergency stop off"
    assert "25.0 ms after the emergency stop" in lines[1], "10 cycles of 2.5 ms"
    assert lines[2] == "4.000 s (cycle 1600) │ ■ emergency stop on"
    said = stopped_by(happened, CYCLE_S)
    assert said == "stopped by the emergency stop at 4.000 s"
    ended = Outcome("FAILED after 1612 cycles", False, ("current-mismatch: …",))
    assert with_cause(ended, said).details == (said, "current-mismatch: …")
    assert stopped_by(happenings(faults_of(status(), [event("begins", 1.0, 400)], seen)), CYCLE_S) == ""


def test_a_stop_after_the_end_of_a_run_has_not_ended_it():
    """Nobody sends SYNC any more: the number of the last cycle stands still while the bench's time goes on."""
    stops = [{"time_ns": 10_940_000_000, "event": "emergency-stop", "state": "on", "cycle": 332}]
    faults = faults_of({**status(), "stops": stops}, (), [detection(0.909, 332, reaction="safe-stop-off")])
    assert stopped_by(happenings(faults), CYCLE_S) == ""


def test_a_detection_without_a_fault_answers_none():
    faults = faults_of(status(), [event("begins", 9.0, 3000)], [detection(1.5, 305), detection(9.5, 100)])
    assert [each.answers for each in happenings(faults)] == [None, None, None]


def test_a_detection_that_stops_the_robot_looks_worse_than_one_that_does_not():
    faults = faults_of(status(), (), [detection(1.0, 1), detection(2.0, 2, reaction="safe-stop-off")])
    stopped, went_on = (event_line(each, CYCLE_S) for each in happenings(faults))
    assert (stopped[1].tone, went_on[1].tone) == (Tone.BAD, Tone.GOOD)


def test_a_joints_trace_is_marked_with_what_is_about_it_or_about_no_joint():
    events = [
        event("begins", 1.0, 300),
        event("begins", 2.0, 700, tap="can0.tx"),
        event("begins", 3.0, 900, tap="joint3.dac"),
    ]
    happened = happenings(faults_of(status(), events, [detection(1.5, 305)]))
    marks = [(cycle, sign.text) for cycle, sign in marks_of(happened, "joint2", ("joint2", "joint3"))]
    assert marks == [(700, "▲"), (305, "◆"), (300, "▲")]
    assert [cycle for cycle, _ in marks_of(happened, "joint3", ("joint2", "joint3"))] == [900, 700]


# What the panel says


@pytest.mark.parametrize("signal", [None, FaultSignal(0, False, 0)])
def test_without_any_fault_there_is_no_panel(signal):
    assert panel_lines(signal, Faults(), None, CYCLE_S) == ()


def test_when_all_is_over_the_last_events_are_left():
    faults = faults_of(status(), [event("begins", 1.0, 300), event("ends", 1.5, 500)])
    assert text_of(panel_lines(FaultSignal(0, False, 1), faults, None, CYCLE_S)) == [
        "no fault acts │ begun so far 1",
        "  1.250 s (cycle 500) │ ○ fault ends: joint2.tachometer stuck (dies)",
        "  0.750 s (cycle 300) │ ▲ fault begins: joint2.tachometer stuck (dies)",
    ]


def test_detections_stand_in_the_panel_with_or_without_a_fault():
    lines = panel_lines(FaultSignal(0, False, 0, 1), faults_of(status(), (), [detection(1.5, 305)]), None, CYCLE_S)
    assert text_of(lines) == [
        "no fault acts │ begun so far 0 │ ◆ detected so far 1",
        "  0.763 s (cycle 305) │ ◆ detected: tachometer-stuck at joint2 │ substitute │ joint2: no change",
    ]


def test_faults_that_act_and_sets_that_wait_are_listed_with_the_last_three_events():
    events = [event("begins", 0.5), event("ends", 0.75), event("begins", 1.0, 300), event("ends", 1.25, 400)]
    faults = faults_of(status([DIES], [("dies", "active"), ("later", "waiting")]), [*events, event("begins", 1.5, 500)])
    lines = panel_lines(FaultSignal(1, False, 3), faults, None, CYCLE_S)
    assert text_of(lines) == [
        "▲ 1 fault acts │ ○ 1 set waits │ begun so far 3",
        "  ▲ joint2.tachometer stuck (dies), since 1.250 s (cycle 500), until it is cleared",
        "  ○ waiting: later (when joint2.angle_deg > 30)",
        "  1.250 s (cycle 500) │ ▲ fault begins: joint2.tachometer stuck (dies)",
        "  1.000 s (cycle 400) │ ○ fault ends: joint2.tachometer stuck (dies)",
        "  0.750 s (cycle 300) │ ▲ fault begins: joint2.tachometer stuck (dies)",
    ]
    assert lines[1][0].tone is Tone.WARNING


def test_for_how_long_a_fault_acts_yet_and_which_time_of_several_it_is():
    """Begun in cycle 300 for 1 s, which is 400 cycles: in cycle 500 half of it is left."""
    said = {**status([DIES]), "sets": [{**set_of("dies", "active"), "duration_s": 1.0, "repeat": 5, "activations": 2}]}
    faults = faults_of(said, [event("begins", 0.75, 300)])

    def acting_at(cycle):
        lines = fault_texts.panel_lines(FaultSignal(1, False, 1), faults, None, (), CYCLE_S, cycle)
        return text_of(lines)[1].partition("(cycle 300), ")[2]

    assert acting_at(300) == "1.0 s more, 2 of 5"
    assert acting_at(500) == "0.5 s more, 2 of 5"
    assert acting_at(900) == "0.0 s more, 2 of 5"
    assert acting_at(None) == "1 s in all, 2 of 5"


def test_the_panel_stays_small_however_many_faults_act():
    acting = tuple(ActingFault(f"set {number}", "can0.tx", "lost") for number in range(300))
    waiting = tuple(f"later {number}" for number in range(30))
    faults = Faults(acting, waiting, (), faults_of(status(), [event("begins", 1.0)] * 20).events)
    lines = text_of(panel_lines(FaultSignal(255, False, 300), faults, None, CYCLE_S))
    assert lines[0].startswith("▲ 255 or more faults act │ ○ 30 sets wait")
    assert "  ▲ and 297 more" in lines
    assert "  ○ waiting: later 0, later 1, later 2, later 3 and 26 more" in lines
    assert len(lines) == 9


def test_the_count_is_the_telemetrys_while_the_rest_is_not_known_and_why_is_said():
    lines = text_of(panel_lines(FaultSignal(2, False, 2), None, Refusal("no answer"), CYCLE_S))
    assert lines == ["▲ 2 faults act │ begun so far 2 │ ▲ not up to date: no answer"]


def test_a_fault_that_failed_is_not_like_one_that_ended():
    faults = faults_of(status(), [event("ends", 1.0, 5, failure="failed: ZeroDivisionError")])
    *_, (_, word) = panel_lines(FaultSignal(0, False, 1), faults, None, CYCLE_S)
    assert word.text.endswith("failed: ZeroDivisionError")
    assert word.tone is Tone.BAD


def test_what_was_done_and_what_was_refused_differ_in_a_sign():
    assert answer_word("accepted 'x'").text == "✓ accepted 'x'"
    assert answer_word(Refusal("no tap 'y'")).text == "✖ no tap 'y'"


# What can be injected


def test_parameters_come_with_default_bounds_and_unit():
    tachometer, bus = catalogue_of(PLAIN)
    value, side = tachometer.faults[0].parameters
    assert (value.default, value.bounds) == ("", "0 to 5 V")
    assert (side.default, side.bounds) == ("low", "low | high")
    assert bus.faults[0].parameters[0].bounds == "0x0 to 0x7FF"
    assert bus.faults[0].needs_wire


@pytest.mark.parametrize(
    ("typed", "names"),
    [
        ("", ["joint2.tachometer", "can0.tx"]),
        ("TACHO", ["joint2.tachometer"]),
        ("2 tacho", ["joint2.tachometer"]),
        ("joint2 stuck", ["joint2.tachometer"]),
        ("cards", ["can0.tx"]),
        ("xyz", []),
    ],
)
def test_a_tap_is_found_by_words_of_its_name_its_description_and_its_faults(typed, names):
    assert [tap.name for tap in matching(catalogue_of(PLAIN), typed)] == names


def test_what_a_name_holds_comes_before_what_a_description_holds():
    adc, tachometer = (
        FaultKind("adc.channel3", "code of the tachometer", False, ()),
        FaultKind("tachometer", "", False, ()),
    )
    assert matching([adc, tachometer], "tacho") == (tachometer, adc)


def test_only_what_differs_from_the_default_is_said_and_names_are_free():
    typed = {"value": " 2.5 ", "n": "4"}
    text = injection("joint2.tachometer", STUCK, typed, {"duration": "0.5"}, {"joint2.tachometer stuck"})
    (declared,) = parse_faults(text).sets
    assert (declared.name, declared.duration_s) == ("joint2.tachometer stuck #2", 0.5)
    (spec,) = declared.faults
    assert (spec.tap, spec.fault, spec.parameters) == ("joint2.tachometer", "stuck", {"value": 2.5})


@pytest.mark.parametrize(
    ("typed", "value"), [("0x294", 0x294), ("7", 7), ("-1e-3", -0.001), ("high", "high"), ('a"\\b', 'a"\\b')]
)
def test_numbers_are_numbers_and_words_are_words(typed, value):
    (declared,) = parse_faults(injection("t", STUCK, {"value": typed, "n": ""}, {}, ())).sets
    assert dict(declared.faults[0].parameters) == {"value": value}
    assert declared.duration_s is None


@pytest.mark.parametrize(
    ("schedule", "expected"),
    [
        ({"at": "2"}, "at 2 s"),
        ({"after": "0.5"}, "at 10.5 s"),
        ({"cycle": "400"}, "in cycle 400"),
        ({"when": "abs(joint2.speed_rad_s) > 1 and time_s > 2"}, "when abs(joint2.speed_rad_s) > 1 and time_s > 2"),
        ({"manual": "yes"}, "by hand"),
        ({"manual": "no"}, ""),
    ],
)
def test_what_was_typed_of_the_beginning_is_the_trigger_of_the_set(schedule, expected):
    text = injection("t", STUCK, {"value": "", "n": ""}, schedule, (), now_s=10.0)
    (declared,) = parse_faults(text).sets
    assert trigger_text(declared.trigger) == expected


def test_a_fault_may_come_several_times():
    schedule = {"duration": "0.01", "repeat": "5", "period": "0.1", "at": "", "when": "  "}
    (declared,) = parse_faults(injection("t", STUCK, {"value": "", "n": ""}, schedule, ())).sets
    assert (declared.duration_s, declared.repeat, declared.period_s) == (0.01, 5, 0.1)


@pytest.mark.parametrize(
    ("schedule", "reason"),
    [
        ({"at": "1", "when": "time_s > 1"}, "has at and when; must have one trigger"),
        ({"at": "1", "after": "1"}, "has at and after; must have one of them"),
        ({"after": "1"}, "no run goes on"),
        ({"after": "soon"}, "must be a number of seconds"),
        ({"manual": "perhaps"}, "must be yes or no"),
        ({"repeat": "3"}, "needs a duration"),
        ({"cycle": "1.5"}, "must be a whole number"),
    ],
)
def test_a_schedule_that_cannot_be_is_refused_in_one_line(schedule, reason):
    now_s = 3.0 if schedule != {"after": "1"} else None
    with pytest.raises(FaultError, match=reason) as raised:
        injection("t", STUCK, {"value": "", "n": ""}, schedule, (), now_s)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("duration", ["soon", "0", "-1", "nan"])
def test_a_duration_that_is_none_is_refused_in_one_line(duration):
    with pytest.raises(FaultError, match=r"^duration = .*must be a number of seconds, greater than 0") as raised:
        injection("t", STUCK, {"value": "", "n": "4"}, {"duration": duration}, ())
    assert "\n" not in str(raised.value)
