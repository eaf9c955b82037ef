"""What the dashboard says: every state has a word or a sign of its own, colour or not."""

import math

import pytest

from canarm_tui import texts
from canarm_tui.snapshot import Counters, JointNow, Rates, Report
from canarm_tui.texts import SEPARATOR, Tone

S = 1_000_000_000


@pytest.mark.parametrize(("age_ns", "text"), [(None, "age –"), (20_000_000, "age 0.02 s"), (1.3 * S, "▲ stale 1.3 s")])
def test_old_data_are_called_stale(age_ns, text):
    assert texts.age_word(age_ns).text == text


def test_half_a_second_is_not_yet_stale():
    assert texts.age_word(S // 2).tone is Tone.PLAIN
    assert texts.age_word(S // 2 + 1).tone is Tone.WARNING


@pytest.mark.parametrize(
    ("state", "text"),
    [
        (0, "idle"),
        (1, "… bringing up"),
        (2, "▶ running"),
        (3, "▼ stopping"),
        (4, "✓ done"),
        (5, "✖ failed"),
        (9, "state 9"),
    ],
)
def test_every_state_of_the_controller_has_a_word(state, text):
    assert texts.state_word(Report(0, 0, state, age_ns=0)).text == text


def test_a_controller_that_has_fallen_silent_is_not_called_running():
    assert texts.state_word(Report(0, 0, 2, 3 * S)).text == "▶ running (stale)"
    assert texts.state_word(Report(0, 0, 1, age_ns=3 * S)).text == "… bringing up (stale)"
    assert texts.state_word(Report(0, 0, 4, age_ns=3 * S)).text == "✓ done"


def test_a_controller_that_falls_silent_while_the_bench_goes_on_is_lost():
    lost = texts.state_word(Report(0, 0, 2, 2 * S, is_lost=True))
    assert (lost.text, lost.tone) == ("✖ controller lost", Tone.BAD)


def test_a_joint_without_a_reference_any_more_is_neither_within_nor_beyond_its_limit():
    """The figures of the run that was stay, and say nothing of an arm that has fallen since."""
    words = texts.trace_words("joint2", JointNow(error_lsb=math.nan, rms_lsb=0.2, max_lsb=0.4))
    assert [word.text for word in words] == ["joint2 error – LSB", "no reference any more", "rms 0.20", "max 0.40"]
    assert {word.tone for word in words[1:]} == {Tone.DIM}
    followed = texts.trace_words("joint2", JointNow(error_lsb=0.3, rms_lsb=0.2, max_lsb=0.4))
    assert followed[1] == texts.Word("✓ within ±1 LSB", Tone.GOOD)


def test_both_rates_are_shown_where_they_differ():
    assert texts.rate_word(Rates(400.0, 4800.0, 12.0)).text == "400 cycles/s (4800 wall)"
    assert texts.rate_word(Rates(400.0, 399.0, 1.0)).text == "399 cycles/s"
    assert texts.rate_word(Rates(math.nan, 399.0, 1.0)).text == "399 cycles/s"


def test_counters_that_are_zero_go_where_room_is_short():
    counters = Counters(received=10, dropped_references=3)
    wide = texts.counter_words(counters, 0, width=100)
    assert SEPARATOR.join(word.text for word in wide) == (
        "frames 10 │ dropped samples 0 │ dropped references 3 │ unknown 0 │ malformed 0 │ discarded 0"
    )
    assert [word.text for word in texts.counter_words(counters, 0, width=78)] == ["frames 10", "dropped references 3"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.004, "0.00"), (-0.004, "0.00"), (1.0, "+1.00"), (-1.0, "−1.00"), (math.nan, "–"), (math.inf, "–")],
)
def test_numbers_are_signed_and_have_no_negative_zero(value, text):
    assert texts.number(value, 2) == text
