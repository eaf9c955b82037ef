"""When faults begin and end: triggers, durations, repetitions, order, clearing and refusals, in lockstep.

Cycles last 2.5 ms and the first SYNC comes at 0, so a set at 0.1 s begins in cycle 40.
"""

import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from canarm_emulator.bench_node.fault_objects import event_text
from canarm_emulator.faults import declaration
from canarm_emulator.faults.declaration import Context, JointFault, NodeFault, NodeHandle, SignalFault, TapKind
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.faults.parameters import choice, level, of_tap, parameter
from canarm_emulator.faults.turns import SetState
from canarm_emulator.robot.truth import JointTruth, Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import OutputFrames, card_nodes
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.fault_events import event_details
from canarm_protocol.faults.script import parse_faults

CELL = load_cell("konkuk1")
OUTPUTS = OutputFrames(CELL, card_nodes(CELL))
COUNTER_CLOCKWISE = 0b10
DAC_COB_ID = 0x312  # its PDO maps four channels, of which two are wired
WAITING, ACTIVE, ENDED = SetState.WAITING, SetState.ACTIVE, SetState.ENDED
Happening = tuple[int, str, bool]


class Run:
    """A bench in lockstep whose faults' beginnings and ends are noted: (cycle, set, whether it begins)."""

    def __init__(self, seed: int = 0, is_started: bool = True) -> None:
        self.bench = FaultBench(CELL, Truth.from_settings(CELL), Clock.SYNC, seed)
        self.bench.start()
        self.happened: list[Happening] = []
        self.codes: list[tuple[float, ...]] = []
        """The currents commanded to the joints, cycle by cycle."""
        self.bench.faults.on_event = lambda event: self.happened.append((event.cycle, event.set_name, event.is_begin))
        if is_started:
            self.bench.receive(nmt_frame(NmtCommand.START))

    def inject(self, text: str) -> str:
        return self.bench.inject(parse_faults(text))

    def cycles(self, count: int, codes: tuple[int, int] = (120, 60)) -> None:
        for _ in range(count):
            for cob_id, data in OUTPUTS.pack(codes, (COUNTER_CLOCKWISE, COUNTER_CLOCKWISE)):
                self.bench.receive(Frame(cob_id, data.ljust(8, b"\0") if cob_id == DAC_COB_ID else data))
            self.bench.receive(sync_frame(None))
            self.codes.append(tuple(joint.command_a for joint in self.bench.world.state()))
            self.bench.records.clear()

    def begun(self, name: str = "a") -> list[int]:
        return [cycle for cycle, set_name, is_begin in self.happened if set_name == name and is_begin]

    def ended(self, name: str = "a") -> list[int]:
        return [cycle for cycle, set_name, is_begin in self.happened if set_name == name and not is_begin]

    def states(self) -> dict[str, SetState]:
        return {each.name: each.state for each in self.bench.faults.status()}


def fault_set(name: str, lines: str = "", tap: str = "joint2.latch", fault: str = "dropout") -> str:
    return f'[[set]]\nname = "{name}"\n{lines}\n[[set.fault]]\ntap = "{tap}"\nfault = "{fault}"\n'


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


def test_the_name_of_a_set_that_has_ended_is_free_again() -> None:
    run = Run()
    run.inject(fault_set("a", "duration = 0.005"))
    with pytest.raises(FaultError, match="'a' is there already"):
        run.inject(fault_set("a"))
    run.cycles(5)
    run.inject(fault_set("a", "cycle = 100"))
    assert run.states() == {"a": SetState.WAITING}


def test_a_condition_that_is_false_and_true_again_while_its_set_acts_counts() -> None:
    run = Run()
    run.inject(fault_set("a", 'when = "cycle == 0 or cycle > 2"\nduration = 0.006\nrepeat = 2'))
    run.cycles(8)
    assert run.begun() == [0, 3]


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


# Faults of users


@pytest.fixture
def own_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is declared in a test is forgotten after it."""
    declaration.declared_faults()
    monkeypatch.setattr(declaration, "_DECLARED", dict(declaration._DECLARED))


@pytest.mark.usefixtures("own_faults")
def test_a_fault_declared_in_any_module_can_be_injected() -> None:
    @dataclass
    class Own(SignalFault, name="own", acts_on=[TapKind.LATCH]):
        """Both bits are off."""

        def apply(self, value: float, now_ns: int) -> float:
            return 0.0

    run = Run()
    run.inject(fault_set("a", "cycle = 3", fault="own"))
    run.cycles(6)
    assert [codes[0] != 0.0 for codes in run.codes[1:]] == [True, True, False, False, False]
    assert Own.declared_at.startswith(f"{__file__}:")


@pytest.mark.usefixtures("own_faults")
def test_a_name_that_is_taken_at_a_kind_of_tap_is_refused_with_both_places() -> None:
    line = (sys._getframe().f_lineno) + 3
    with pytest.raises(FaultError) as caught:

        class Stuck(SignalFault, name="stuck", acts_on=[TapKind.SENSOR]):
            pass

    text = str(caught.value)
    assert text.startswith(f"{__file__}:{line}: fault 'stuck': the name is taken at SENSOR (voltage of a sensor) by ")
    assert re.search(r"signal\.py:\d+; choose another name$", text)
    assert declaration.declared_faults()["stuck", TapKind.SENSOR].__module__.endswith("kinds.signal")


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize(
    ("acts_on", "message"),
    [
        ([], "acts_on is empty"),
        (
            [TapKind.NODE],
            "acts_on has NODE; with its base it can act on DAC_CODE, LATCH, OPAMP, CURRENT, SENSOR, ADC_CODE",
        ),
    ],
)
def test_a_fault_that_could_act_nowhere_is_refused(acts_on: list[TapKind], message: str) -> None:
    with pytest.raises(FaultError, match=message):
        type(SignalFault)("Own", (SignalFault,), {"__module__": __name__}, name="own", acts_on=acts_on)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: parameter("how much", 0.5, 0.0, 1.0, 2.0),
            "unit = 0.5: must be text; the call is parameter(about, unit",
        ),
        (lambda: parameter("how much", "V", "0.5", 0.0, 1.0), "default = '0.5': must be a number"),
        (lambda: parameter("how much", "V", 0.5, 1.0, 0.0), "minimum = 1.0 is above maximum = 0.0"),
        (lambda: parameter("how much", "V", 5.0, 0.0, 1.0), "default = 5.0: must be from 0.0 to 1.0"),
        (lambda: of_tap(0.5, "how much", 0.0, 1.0), "about = 0.5: must be text; the call is of_tap(about, default"),
        (lambda: level("where", 1.5), "default = 1.5: must be from 0.0 to 1.0; the call is level(about, default)"),
        (lambda: choice("which", "one"), "choices = 'one': must be words"),
    ],
)
def test_a_wrong_declaration_of_a_parameter_names_file_line_and_class(call: Callable[[], object], message: str) -> None:
    with pytest.raises(FaultError) as caught:

        class Own(SignalFault):
            value = call()

    text = str(caught.value)
    assert text.startswith(f"{__file__}:")
    assert message in text
    with pytest.raises(FaultError, match=rf"{re.escape(__file__)}:\d+: class Bad: about = 1: must be text"):

        class Bad(SignalFault):
            value: float = level(1, 0.5)  # type: ignore[arg-type]


@pytest.mark.usefixtures("own_faults")
def test_a_fault_that_is_no_dataclass_or_cannot_be_made_is_refused_by_name_and_place() -> None:
    class Plain(SignalFault, name="plain", acts_on=[TapKind.LATCH]):
        """No dataclass."""

        def apply(self, value: float, now_ns: int) -> float:
            return value

    @dataclass
    class Unmade(SignalFault, name="unmade", acts_on=[TapKind.LATCH]):
        """Cannot be made."""

        def __post_init__(self) -> None:
            raise KeyError("gain")

        def apply(self, value: float, now_ns: int) -> float:
            return value

    run = Run()
    with pytest.raises(FaultError, match=r"test_fault_engine.py:\d+: class Plain: must be a @dataclass"):
        run.inject(fault_set("a", fault="plain"))
    with pytest.raises(FaultError, match=r"unmade at joint2.latch: cannot be made: KeyError: 'gain' \(.*\.py:\d+\)"):
        run.inject(fault_set("a", fault="unmade"))
    assert run.states() == {}


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize("where", ["begin", "apply", "no number", "nan"])
def test_a_faulty_fault_ends_and_the_bench_goes_on(where: str) -> None:
    @dataclass
    class Faulty(SignalFault, name="faulty", acts_on=[TapKind.LATCH]):
        """Fails in its third cycle, or as it begins."""

        def begin(self, context: Context) -> None:
            self._fails_ns = context.now_ns + 2 * context.cycle_ns
            if where == "begin":
                raise KeyError("gain")

        def apply(self, value: float, now_ns: int) -> float:
            if now_ns < self._fails_ns:
                return 0.0
            return {"no number": None, "nan": math.nan}[where]  # type: ignore[return-value]

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 5\nduration = 0.5\nrepeat = 2", fault="faulty"))
    run.inject(fault_set("b", "cycle = 5", tap="joint3.latch"))
    run.cycles(20)
    assert run.states() == {"a": ENDED, "b": ACTIVE}
    assert run.bench.faults.active == 1
    begin, end = (event for event in events if event.set_name == "a")
    assert (begin.cycle, begin.is_begin, begin.failure) == (5, True, "")
    assert (end.cycle, end.is_begin) == (5 if where == "begin" else 7, False)
    kind = {"begin": "KeyError: 'gain'", "apply": "KeyError: 'apply'", "no number": "TypeError: apply() returned None"}
    assert end.failure.startswith(f"failed: {kind.get(where, 'ValueError: apply() returned nan')}")
    assert re.search(rf"\({re.escape(__file__)}:\d+\)$", end.failure) or where in ("no number", "nan")
    assert [codes[0] != 0.0 for codes in run.codes[9:]] == [True] * 11
    assert event_details(end)["failure"] == end.failure
    assert event_text(end).endswith(end.failure)


@pytest.mark.usefixtures("own_faults")
def test_a_truth_that_cannot_be_ends_its_fault() -> None:
    @dataclass
    class Weightless(JointFault, name="weightless", acts_on=[TapKind.LINK]):
        """What the change returns is no joint."""

        def change(self, joint: JointTruth, now_ns: int) -> JointTruth:
            return None  # type: ignore[return-value]

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 2", tap="joint2.link", fault="weightless"))
    run.cycles(5)
    assert events[-1].failure.startswith("failed: TypeError: change() returned None: must be a JointTruth")
    assert run.bench.world.truth == Truth.from_settings(CELL)


@pytest.mark.usefixtures("own_faults")
@pytest.mark.parametrize(
    ("filter_name", "failure"),
    [("set_sync_filter", "KeyError: 'sync'"), ("set_send_filter", "TypeError: the send filter returned 7")],
)
def test_a_filter_that_fails_ends_its_fault_and_lets_all_pass(filter_name: str, failure: str) -> None:
    def no_sync(now_ns: int) -> bool:
        raise KeyError("sync")

    @dataclass
    class Sieve(NodeFault, name="sieve", acts_on=[TapKind.NODE]):
        """Its filter fails at the first SYNC or frame."""

        def act(self, node: NodeHandle, now_ns: int) -> None:
            getattr(node, filter_name)(no_sync if filter_name == "set_sync_filter" else lambda frame: 7)

        def end(self, node: NodeHandle, now_ns: int) -> None:
            getattr(node, filter_name)(None)

    run, events = Run(), []
    run.bench.faults.on_event = events.append
    run.inject(fault_set("a", "cycle = 5", tap="node.0x14", fault="sieve"))
    run.cycles(10)
    assert run.states() == {"a": ENDED}
    assert events[-1].failure.startswith(f"failed: {failure}")
    run.bench.receive(sync_frame(None))
    assert {0x294, 0x394} <= {record.frame.can_id for record in run.bench.records}


def test_faults_of_other_packages_are_found_by_their_entry_point(tmp_path: Path) -> None:
    (tmp_path / "blind_faults.py").write_text(
        "from dataclasses import dataclass\n"
        "from canarm_emulator.faults.declaration import SignalFault, TapKind\n"
        "@dataclass\n"
        "class Blind(SignalFault, name='blind', acts_on=[TapKind.SENSOR]):\n"
        "    '''Sees nothing.'''\n"
        "    def apply(self, value, now_ns):\n"
        "        return 0.0\n"
    )
    info = tmp_path / "blind_faults-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: blind-faults\nVersion: 1.0\n")

    def declared(module: str) -> str:
        (info / "entry_points.txt").write_text(f"[canarm.faults]\nblind = {module}\n")
        program = (
            "from canarm_emulator.faults.declaration import declared_faults\n"
            "from canarm_protocol.errors import FaultError\n"
            "try:\n    print(sorted(kind.name for name, kind in declared_faults() if name == 'blind'))\n"
            "except FaultError as error:\n    print(error)\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, timeout=120
        ).stdout.strip()

    assert declared("blind_faults") == "['SENSOR']"
    (tmp_path / "leaving.py").write_text("raise SystemExit(0)\n")
    assert declared("leaving") == "faults of entry point 'blind' (leaving): SystemExit: 0"
    complaint = declared("no_such_module")
    assert complaint == (
        "faults of entry point 'blind' (no_such_module): ModuleNotFoundError: No module named 'no_such_module'"
    )
