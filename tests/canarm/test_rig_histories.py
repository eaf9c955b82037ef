"""Questions to a rig about the histories of its joints."""

import numpy as np
import pytest

from canarm import Rig
from canarm.rig.rig_joint import SIGNALS, TRUE_SIGNALS
from canarm.usage import UsageError

CYCLE_S = 0.0025


# Histories


def test_a_limit_that_was_violated_before_the_first_cycle_that_is_kept_does_not_pass() -> None:
    with Rig(law="pd", history_s=1.0) as rig:
        rig.run(1.0)
        joint = rig.joints["joint2"]
        early = float(np.abs(joint.true_angle_rad).max())
        assert not joint.stays_below("true_angle_rad", 0.99 * early)
        rig.run(0.5)
        lost = r"^joint2\.{}: cycles before 0\.5000 s are no longer kept; .* since=, .* longer history_s$"
        for signal in (*SIGNALS, "error_lsb"):
            for span in ({}, {"since": 0.4975}, {"until": 0.3}):
                with pytest.raises(UsageError, match=lost.format(signal)):
                    joint.stays_below(signal, 1e9, **span)
            with pytest.raises(UsageError, match=lost.format(signal)):
                joint.departure(signal, 0.0, since=0.4)
            assert joint.stays_below(signal, 1e9, since=0.5)
        assert joint.departure("true_angle_rad", 1e-9, since=0.5) is not None


def test_what_a_cycle_that_is_kept_violates_is_false_however_much_is_kept() -> None:
    with Rig(law="pd", history_s=1.0) as rig:
        rig.run(1.5)
        joint = rig.joints["joint2"]
        finding = joint.stays_below("true_angle_rad", 0.0)
        assert not finding
        assert "and beyond in 400 of 400 cycles that are kept; must stay below 0" in repr(finding)
        assert "kept" not in repr(joint.stays_below("true_angle_rad", 0.0, since=0.5))


def test_a_departure_is_when_a_signal_has_left_its_value() -> None:
    with Rig(law="pd") as rig:
        rig.run(2.0)
        joint = rig.joints["joint2"]
        speed = joint.true_speed_rad_s
        expected = 400 + int(np.argmax(np.abs(speed[400:] - speed[400]) > 0.1))
        assert joint.departure("true_speed_rad_s", 0.1, since=1.0) == pytest.approx(expected * CYCLE_S)
        assert joint.departure("true_speed_rad_s", 100.0, since=1.0) is None
        assert joint.departure("true_speed_rad_s", 0.0, since=5.0) is None


def test_a_history_that_passes_its_limit_is_named_with_value_cycle_and_time() -> None:
    with Rig(law="pd") as rig:
        rig.run(2.0)
        joint = rig.joints["joint2"]
        current = np.abs(joint.current_a)
        limit = float(current.max()) * 0.9
        first = int(np.argmax(current > limit))
        finding = joint.stays_below("current_a", limit)
        assert not finding
        assert f"joint2.current_a is {joint.current_a[first]:.4g} at {first * CYCLE_S:.4f} s (cycle {first})" in repr(
            finding
        )
        assert f"in {int((current > limit).sum())} of 800 cycles; must stay below {limit:g}" in repr(finding)
        assert joint.stays_below("current_a", float(current.max()))
        assert joint.stays_within("current_a", float(joint.current_a.min()), float(joint.current_a.max()))
        assert not joint.stays_within("current_a", float(joint.current_a.min()) + 1e-9, 10.0)


def test_only_the_time_asked_for_is_looked_at() -> None:
    with Rig(law="pd") as rig:
        rig.run(1.0)
        joint = rig.joints["joint2"]
        late = float(np.abs(joint.true_angle_rad[200:]).max())
        early = float(np.abs(joint.true_angle_rad[:200]).max())
        assert joint.stays_below("true_angle_rad", late, since=0.5)
        assert joint.stays_below("true_angle_rad", early, until=0.5 - CYCLE_S)
        assert bool(joint.stays_below("true_angle_rad", min(early, late))) is False


def test_a_true_history_goes_on_through_the_stop_cycle_by_cycle() -> None:
    with Rig(law="pd") as rig:
        rig.run(1.0)
        rig.controller.interrupt("test")
        rig.run(1.0)
        for signal in SIGNALS[:TRUE_SIGNALS]:
            span = rig.joints["joint2"].span(signal)
            assert span.cycle.tolist() == list(range(len(span.cycle)))
            assert span.time_s == pytest.approx(span.cycle * CYCLE_S)
            assert len(span.value) > len(rig.joints["joint2"].true_angle_rad) == 400
        assert len(rig.joints["joint2"].span("reference_rad").value) == 400


def test_a_value_that_is_no_number_stays_nowhere() -> None:
    with Rig(law="pd") as rig:
        rig.run(0.1)
        rig._history.rows[7, 1:] = np.nan
        assert "is nan at 0.0175 s (cycle 7)" in repr(rig.joints["joint2"].stays_below("current_a", 10.0))


def test_questions_that_have_no_answer_are_refused() -> None:
    with Rig(law="pd") as rig:
        with pytest.raises(UsageError, match=r"joint2.current_a: no cycle from 0 s to inf s; run\(\) first"):
            rig.joints["joint2"].stays_below("current_a", 1.0)
        rig.run(0.1)
        with pytest.raises(UsageError, match=r"no cycle from 5 s to inf s; there are those to 0\.0975 s$"):
            rig.joints["joint2"].stays_below("current_a", 1.0, since=5.0)
        with pytest.raises(UsageError, match="no history 'curent_a'; did you mean 'current_a'"):
            rig.joints["joint2"].stays_below("curent_a", 1.0)
