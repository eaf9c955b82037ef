"""Questions to a rig about what was detected, and when."""

import pytest

from canarm import Rig
from canarm.rig.findings import Begun, Noticed, ask_detected
from canarm.usage import UsageError
from canarm_controller.supervision.detection import Detection, Reaction

CYCLE_S = 0.0025


# What was detected


def detection(name: str, where: str | None = None) -> Detection:
    return Detection(name, where, 0, "", Reaction.CONTINUE)


NOTICED = [
    Noticed(0.5, detection("sensor-noise", "joint3")),
    Noticed(1.0125, detection("tachometer-stuck", "joint2")),
    Noticed(1.5, detection("tachometer-stuck", "joint3")),
]
BEGUN = [Begun(0.2, "joint3.latch", "stuck"), Begun(1.0, "joint2.tachometer", "stuck")]


@pytest.mark.parametrize(
    ("name", "joint", "count"),
    [
        (None, None, 3),
        ("tachometer-stuck", None, 2),
        ("tachometer-stuck", "joint3", 1),
        (None, "joint3", 2),
        ("heartbeat-lost", None, 0),
    ],
)
def test_detections_are_found_by_name_and_joint(name: str | None, joint: str | None, count: int) -> None:
    detected = ask_detected(NOTICED, BEGUN, name, joint, None)
    assert (len(detected.found), bool(detected)) == (count, count > 0)


@pytest.mark.parametrize(
    ("name", "where", "message"),
    [
        ("tacho-stuck", None, "detected: no detector 'tacho-stuck'; did you mean 'tachometer-stuck'?"),
        ("tachometer-stuck", "joint7", "detected: no joint, card or node 'joint7'; did you mean 'joint3'?"),
        (None, "0x55", "detected: no joint, card or node '0x55'"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*has never run:canarm.rig.arguments.RigWarning")
def test_a_question_that_could_never_be_true_is_refused(name: str | None, where: str | None, message: str) -> None:
    with Rig(law="pd") as rig:
        with pytest.raises(UsageError) as caught:
            rig.detected(name, where)
        assert str(caught.value).startswith(message)
        assert "joint2" in str(caught.value) or where is None
        assert not rig.detected("tachometer-stuck", "joint2")
        assert not rig.detected("card-state", "adc")
        assert not rig.detected("heartbeat-lost", "0x14")


def test_within_counts_from_the_latest_fault_to_the_first_detection_after_it() -> None:
    detected = ask_detected(NOTICED, BEGUN, "tachometer-stuck", None, None)
    assert detected.within(0.0125)
    assert not detected.within(0.0124)
    assert detected.latency_s == pytest.approx(0.0125)


def test_a_detection_before_the_latest_fault_is_not_taken_for_its_own() -> None:
    detected = ask_detected(NOTICED, BEGUN, "sensor-noise", None, None)
    assert detected
    assert not detected.within(10.0)
    assert ask_detected(NOTICED, BEGUN, "sensor-noise", None, 0.4).within(0.11)


def test_nothing_is_within_anything_where_no_fault_has_begun() -> None:
    assert not ask_detected(NOTICED, [], None, None, None).within(10.0)
    assert ask_detected(NOTICED, [], None, None, 1.0).within(0.0125)


def test_the_answers_say_what_was_detected_and_when() -> None:
    detected = ask_detected(NOTICED, BEGUN, "tachometer-stuck", "joint2", None)
    told = "tachometer-stuck at joint2 at 1.0125 s, 12.5 ms after joint2.tachometer stuck"
    assert repr(detected) == f"<{told}>"
    assert repr(detected.within(0.025)) == f"<{told}>"
    assert repr(detected.within(0.01)) == f"<{told}; must be within 10 ms>"
    missing = ask_detected(NOTICED[:1], BEGUN, "tachometer-stuck", None, None)
    assert repr(missing) == "<tachometer-stuck not detected; detected: sensor-noise at joint3 at 0.5000 s>"


def test_detections_of_a_run_have_the_time_of_their_cycle() -> None:
    with Rig(law="mras") as rig:
        rig.inject("can0.tx", "lost", at=1.0)
        rig.run(2.0)
        first = rig.noticed[0]
        assert first.time_s == pytest.approx(first.detection.tick * CYCLE_S)
        assert rig.detections == rig.controller.detections
        assert [each.event for each in rig.events if each.event.startswith("detected")] == [
            f"detected {each.detector}" for each in rig.detections
        ]


def test_a_clock_may_start_when_the_fault_begins_to_show() -> None:
    detected = ask_detected(NOTICED, BEGUN, "tachometer-stuck", None, None)
    assert detected.within(0.005, of=1.01)
    assert not detected.within(0.002, of=1.01)
    assert detected.within(0.0, of=1.3)
    assert repr(detected.within(0.002, of=1.01)).endswith("at 1.0125 s, 2.5 ms after 1.0100 s; must be within 2 ms>")


def test_a_clock_that_never_starts_is_refused_rather_than_exchanged_for_another() -> None:
    detected = ask_detected(NOTICED, BEGUN, "tachometer-stuck", None, None)
    expected = (
        r"^within: of is None: the truth has not moved on since joint2\.tachometer stuck, so there is nothing to "
    )
    with pytest.raises(UsageError, match=expected):
        detected.within(0.025, of=None)
    assert "no fault has begun" in repr(ask_detected(NOTICED, [], None, None, None).within(0.025, of=None))
