"""What becomes of a text of faults: cleared, refused, and what its answer says of times. In lockstep."""

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.faults.turns import SetState
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import NmtCommand, nmt_frame, sync_frame
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import parse_faults
from tests.emulator.fault_run import ACTIVE, CELL, Run, fault_set

# Clearing


def test_clearing_all_ends_and_forgets_every_set() -> None:
    run = Run()
    run.inject(fault_set("a"))
    run.inject(fault_set("b", "at = 100"))
    run.cycles(10)
    assert run.inject('clear = ""') == "cleared 2"
    run.cycles(10)
    assert (run.states(), run.bench.faults.active) == ({}, 0)
    assert run.codes[5][0] == 0.0
    assert run.codes[-1][0] == pytest.approx(120 * 1.5 / 255)


def test_clearing_one_set_leaves_the_others() -> None:
    run = Run()
    run.inject(fault_set("a"))
    run.inject(fault_set("b"))
    run.cycles(5)
    assert run.inject('clear = "a"') == "cleared 1"
    run.cycles(5)
    assert run.states() == {"b": ACTIVE}


def test_clearing_one_of_several_sets_of_a_text_leaves_nothing_behind_that_cannot_be_cleared() -> None:
    run = Run()
    run.inject("parallel = true\n" + fault_set("a") + fault_set("b"))
    run.cycles(5)
    run.inject('clear = "a"')
    run.cycles(5)
    assert run.states() == {"b": ACTIVE}
    run.inject('clear = ""')
    run.cycles(5)
    assert run.bench.faults.active == 0
    assert run.codes[-1][0] > 0.0


def test_after_one_set_of_an_order_is_cleared_the_next_has_its_turn() -> None:
    run = Run()
    run.inject(fault_set("a", "duration = 10") + fault_set("b"))
    run.cycles(5)
    run.inject('clear = "a"')
    run.cycles(5)
    assert run.begun("b") == [5]


def test_a_cleared_name_can_be_used_again() -> None:
    run = Run()
    run.inject(fault_set("a"))
    run.inject('clear = "a"')
    assert run.inject(fault_set("a")) == "accepted 'a'"


# Refusals


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            fault_set("a", tap="joint9.tachometer"),
            "set 'a', fault 1: no tap 'joint9.tachometer'; did you mean 'joint3.tachometer'?",
        ),
        (
            fault_set("a", tap="joint2.latch", fault="missing-code"),
            "set 'a', fault 1: fault 'missing-code' is not supported at joint2.latch (direction bits); acts at: "
            "code of a DAC, code of an ADC channel; supported here are",
        ),
        (
            fault_set("a", fault="burnt"),
            "set 'a', fault 1: fault 'burnt' is not supported at joint2.latch (direction bits); known are ",
        ),
        (fault_set("a", fault="drpout"), "at joint2.latch (direction bits); did you mean 'dropout'?"),
        (
            fault_set("a", tap="can0.tx", fault="lost") + "cob_id = 2048",
            "lost at can0.tx: cob_id = 2048: must be a number from 0x0 to 0x7FF",
        ),
        (
            fault_set("a") + "valeu = 1",
            "set 'a', fault 1: dropout at joint2.latch: no parameter 'valeu'; did you mean 'value'?",
        ),
        (
            fault_set("a", tap="joint2.tachometer", fault="stuck") + "value = 5.1",
            "set 'a', fault 1: stuck at joint2.tachometer: value = 5.1: must be a number from 0 to 5 V",
        ),
        (
            fault_set("a", tap="joint2.tachometer", fault="stuck") + "value = true",
            "set 'a', fault 1: stuck at joint2.tachometer: value = True: must be a number from 0 to 5 V",
        ),
        (
            fault_set("a", tap="joint2.tachometer", fault="stuck") + f"value = 1{400 * '0'}",
            "set 'a', fault 1: stuck at joint2.tachometer: value = 1",
        ),
        (
            fault_set("a", tap="adc.channel1", fault="stuck-bit") + "bit = 1.5",
            "set 'a', fault 1: stuck-bit at adc.channel1: bit = 1.5: must be a whole number (the bit, 0 is the lowest)",
        ),
        (fault_set("a", 'when = "joint2.angle > 3"'), "condition 'joint2.angle > 3': no signal 'joint2.angle'"),
        ('clear = "a"', "no set 'a' to clear; there are none"),
        ('trigger = "a"', "no set 'a' to trigger; there are none"),
    ],
)
def test_what_is_not_supported_is_refused_with_a_reason(text: str, message: str) -> None:
    with pytest.raises(FaultError) as caught:
        Run().inject(text)
    assert message in str(caught.value)


def test_nothing_of_a_text_is_accepted_where_something_is_refused() -> None:
    run = Run()
    with pytest.raises(FaultError, match="set 'b', fault 1"):
        run.inject(fault_set("a") + fault_set("b", fault="melted"))
    run.cycles(3)
    assert (run.states(), run.happened) == ({}, [])


def test_a_name_that_is_taken_is_refused() -> None:
    run = Run()
    run.inject(fault_set("a"))
    with pytest.raises(FaultError, match="a set named 'a' is there already"):
        run.inject(fault_set("a"))


def test_only_a_set_that_waits_can_be_triggered() -> None:
    run = Run()
    run.inject(fault_set("a"))
    run.cycles(1)
    with pytest.raises(FaultError, match="set 'a' is active; only one that waits can be triggered"):
        run.inject('trigger = "a"')


def test_the_name_of_a_set_that_has_ended_is_free_again() -> None:
    run = Run()
    run.inject(fault_set("a", "duration = 0.005"))
    with pytest.raises(FaultError, match="'a' is there already"):
        run.inject(fault_set("a"))
    run.cycles(5)
    run.inject(fault_set("a", "cycle = 100"))
    assert run.states() == {"a": SetState.WAITING}


def test_a_set_that_would_end_as_soon_as_it_begins_is_refused() -> None:
    with pytest.raises(FaultError, match="set 'a' would end as soon as it begins"):
        Run().inject(fault_set("a") + fault_set("b"))


def test_times_count_from_cycle_0_where_the_first_set_comes_in_mid_run() -> None:
    bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.SYNC, 0)
    bench.start()
    bench.receive(nmt_frame(NmtCommand.START))
    begun: list[int] = []
    for cycle in range(12):
        if cycle == 5:
            bench.faults.on_event = lambda event: begun.append(event.cycle)
            bench.inject(parse_faults(fault_set("a", "at = 0.02")))
        bench.receive(sync_frame(None))
    assert begun == [8]


# What an accepted text says of its times


def test_a_time_that_is_over_begins_at_once_and_the_answer_says_so() -> None:
    run = Run()
    run.cycles(40)  # the last SYNC came at 97.5 ms, its scan takes 0.8 ms
    answer = run.inject(fault_set("a", "at = 0.05"))
    assert answer.startswith("accepted 'a'; 'a' begins at once: 0.098 s are over")
    assert "begins at once" in run.inject(fault_set("b", "cycle = 39"))
    assert run.inject(fault_set("c", "cycle = 40")) == "accepted 'c'"
    assert run.inject(fault_set("d", "at = 0.1")) == "accepted 'd'"
    run.cycles(1)
    assert [run.begun(name) for name in "abcd"] == [[40]] * 4


@pytest.mark.parametrize(
    ("trigger", "remark"),
    [
        ("at = 1", "; no run is on: at counts from the next NMT start"),
        ("cycle = 3", "; no run is on: cycle counts from the next NMT start"),
        ("manual = true", ""),
        ("", ""),
    ],
)
def test_where_no_run_is_on_the_answer_says_from_when_times_count(trigger: str, remark: str) -> None:
    run = Run(is_started=False)
    assert run.inject(fault_set("a", trigger)) == f"accepted 'a'{remark}"
