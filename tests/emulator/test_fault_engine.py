"""When faults begin and end: triggers, durations, repetitions, order and repeatability, in lockstep.

Cycles last 2.5 ms and the first SYNC comes at 0, so a set at 0.1 s begins in cycle 40.
"""

import pytest

from canarm_protocol.canopen.frames import NmtCommand, nmt_frame, sync_frame
from tests.emulator.fault_run import ACTIVE, ENDED, WAITING, Run, fault_set

# Triggers


@pytest.mark.parametrize(
    ("trigger", "cycle"),
    [("", -1), ("at = 0", 0), ("at = 0.1", 40), ("at = 0.101", 41), ("cycle = 0", 0), ("cycle = 17", 17)],
)
def test_a_set_begins_at_its_time_or_cycle_or_at_once(trigger: str, cycle: int) -> None:
    run = Run()
    run.inject(fault_set("a", trigger))
    run.cycles(60)
    assert (run.begun(), run.ended()) == ([cycle], [])
    assert run.states() == {"a": ACTIVE}


def test_time_and_cycles_count_from_the_first_sync_after_nmt_start() -> None:
    run = Run(is_started=False)
    run.inject("parallel = true\n" + fault_set("a", "at = 0.05") + fault_set("b", "cycle = 3", tap="joint3.latch"))
    for _ in range(100):
        run.bench.receive(sync_frame(None))
    assert run.happened == []
    run.bench.receive(nmt_frame(NmtCommand.START))
    run.cycles(30)
    assert (run.begun("a"), run.begun("b")) == ([20], [3])


def test_a_set_without_a_trigger_acts_before_nmt_start_too() -> None:
    run = Run(is_started=False)
    run.inject(fault_set("a"))
    assert run.happened == [(-1, "a", True)]


def test_a_condition_over_the_truth_begins_in_the_cycle_in_which_it_is_true() -> None:
    run = Run()
    run.inject(fault_set("a", 'when = "joint2.angle_deg > 21"'))
    angles = []
    run.bench.on_cycle = lambda truth: angles.append(truth.joints[0].angle_rad)
    run.cycles(60)
    first = next(cycle for cycle, angle in enumerate(angles) if angle > 21 * 3.141592653589793 / 180)
    assert first > 0
    assert run.begun() == [first]


@pytest.mark.parametrize(
    ("condition", "cycle"), [("time_s >= 0.05", 20), ("cycle == 7", 7), ("joint2.command_a > 0", 1)]
)
def test_conditions_know_time_cycle_and_currents(condition: str, cycle: int) -> None:
    run = Run()
    run.inject(fault_set("a", f'when = "{condition}"'))
    run.cycles(30)
    assert run.begun() == [cycle]


def test_a_manual_set_waits_for_its_command() -> None:
    run = Run()
    run.inject(fault_set("a", "manual = true"))
    run.cycles(10)
    assert run.states() == {"a": WAITING}
    assert run.inject('trigger = "a"') == "triggered 'a'"
    run.cycles(10)
    assert run.begun() == [10]


def test_a_command_begins_a_set_that_waits_for_something_else() -> None:
    run = Run()
    run.inject(fault_set("a", "at = 100"))
    run.cycles(5)
    run.inject('trigger = "a"')
    run.cycles(5)
    assert run.begun() == [5]


# Duration and repetition


def test_a_set_ends_after_its_duration() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 10\nduration = 0.05"))
    run.cycles(60)
    assert (run.begun(), run.ended(), run.states()) == ([10], [30], {"a": ENDED})


def test_a_repeated_set_begins_once_a_period() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 10\nduration = 0.01\nrepeat = 3\nperiod = 0.05"))
    run.cycles(100)
    assert (run.begun(), run.ended()) == ([10, 30, 50], [14, 34, 54])
    assert run.bench.faults.status()[0].activations == 3


def test_a_condition_that_stays_true_begins_a_repeated_set_once() -> None:
    run = Run()
    run.inject(fault_set("a", 'when = "cycle > 5"\nduration = 0.01\nrepeat = 3'))
    run.cycles(60)
    assert (run.begun(), run.states()) == ([6], {"a": WAITING})


def test_a_condition_that_comes_again_begins_a_repeated_set_again() -> None:
    run = Run()
    run.inject(fault_set("a", 'when = "cycle == 5 or cycle == 20"\nduration = 0.01\nrepeat = 3'))
    run.cycles(60)
    assert (run.begun(), run.ended()) == ([5, 20], [9, 24])


def test_a_manual_set_that_is_repeated_waits_for_a_command_each_time() -> None:
    run = Run()
    run.inject(fault_set("a", "manual = true\nduration = 0.01\nrepeat = 2"))
    for _ in range(3):
        run.cycles(10)
        if run.states() == {"a": WAITING}:
            run.inject('trigger = "a"')
    assert (run.begun(), run.ended()) == ([10, 20], [14, 24])


# Order


def test_sets_come_one_after_the_other() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 5\nduration = 0.025") + fault_set("b", "duration = 0.0125"))
    run.cycles(40)
    assert run.happened == [(5, "a", True), (15, "a", False), (15, "b", True), (20, "b", False)]


def test_a_later_trigger_is_not_looked_at_before_its_turn() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 20\nduration = 0.025") + fault_set("b", "cycle = 5\nduration = 0.025"))
    run.cycles(60)
    assert (run.begun("a"), run.begun("b")) == ([20], [30])


def test_a_set_without_a_duration_lasts_until_the_next_one_begins() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 5") + fault_set("b", "cycle = 25"))
    run.cycles(40)
    assert run.happened == [(5, "a", True), (25, "a", False), (25, "b", True)]


def test_an_empty_set_clears() -> None:
    run = Run()
    run.inject(fault_set("other"))
    run.inject(fault_set("a", "cycle = 5") + '[[set]]\nname = "nothing"\ncycle = 25\n')
    run.cycles(40)
    assert (run.ended("a"), run.ended("other")) == ([25], [25])
    assert run.bench.faults.active == 0


def test_parallel_sets_do_not_wait_for_each_other() -> None:
    run = Run()
    sets = fault_set("a", "cycle = 20\nduration = 0.025") + fault_set("b", "cycle = 5\nduration = 0.1")
    run.inject("parallel = true\n" + sets)
    run.cycles(60)
    assert run.happened == [(5, "b", True), (20, "a", True), (30, "a", False), (45, "b", False)]


def test_texts_run_side_by_side() -> None:
    run = Run()
    run.inject(fault_set("a", "cycle = 5"))
    run.inject(fault_set("b", "cycle = 5"))
    run.cycles(10)
    assert run.states() == {"a": ACTIVE, "b": ACTIVE}


def test_faults_at_one_tap_act_in_the_order_in_which_they_began() -> None:
    offset = fault_set("offset", tap="joint2.amplifier.current", fault="offset").rstrip() + "\nvalue = 0.3\n"
    gain = fault_set("gain", tap="joint2.amplifier.current", fault="gain").rstrip() + "\nfactor = 2\n"
    currents = []
    for texts in ((offset, gain), (gain, offset)):
        run = Run()
        for text in texts:
            run.inject(text)
        run.cycles(5, codes=(51, 0))
        currents.append(run.codes[-1][0])
    assert currents == pytest.approx([2 * (0.3 + 0.3), 2 * 0.3 + 0.3])  # code 51 asks for 0.3 A


def test_of_two_equal_faults_each_ends_by_itself() -> None:
    run = Run()
    for name, cycle in (("a", 0), ("b", 20)):
        lines = f"cycle = {cycle}\nduration = 0.1"
        run.inject(fault_set(name, lines, "joint2.amplifier.current", "drift") + "rate = 1\n")
    run.cycles(70, codes=(51, 0))
    # In cycle 30 they are 30 and 10 cycles old; in cycle 50 the first, of 40 cycles, is over.
    assert run.codes[30][0] == pytest.approx(0.3 + (30 + 10) * 0.0025)
    assert run.codes[50][0] == pytest.approx(0.3 + 30 * 0.0025)
    assert run.codes[65][0] == pytest.approx(0.3)


# Repeatability


def test_the_same_seed_and_text_make_the_same_noise_and_another_seed_another() -> None:
    text = fault_set("a", tap="joint2.amplifier.current", fault="noise")
    runs = []
    for seed in (3, 3, 4):
        run = Run(seed)
        run.inject(text)
        run.cycles(40)
        runs.append(run.codes)
    assert runs[0] == runs[1] != runs[2]


def test_every_activation_has_randomness_of_its_own() -> None:
    run = Run()
    text = fault_set("a", "cycle = 5\nduration = 0.025\nrepeat = 2\nperiod = 0.05", "joint2.amplifier.current", "noise")
    run.inject(text)
    run.cycles(60)
    assert run.codes[5:15] != run.codes[25:35]
    assert run.codes[16:20] == run.codes[36:40]


def test_a_condition_that_is_false_and_true_again_while_its_set_acts_counts() -> None:
    run = Run()
    run.inject(fault_set("a", 'when = "cycle == 0 or cycle > 2"\nduration = 0.006\nrepeat = 2'))
    run.cycles(8)
    assert run.begun() == [0, 3]
