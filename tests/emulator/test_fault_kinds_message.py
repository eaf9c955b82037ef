"""Faults on messages, on a bench with a scripted master.

konkuk1: cycle 2.5 ms, six channels of 100 µs, so that the inputs 0x294 and 0x394 leave 600 µs after SYNC; outputs go to
0x312 and 0x213. A set with at = 0.1 begins with cycle 40, one of 50 ms ends with cycle 60.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.faults.messages import Intruder
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame
from canarm_protocol.clock import Clock

CYCLE_NS, SCAN_NS = 2_500_000, 600_000
BEGIN, END, CYCLES = 40, 60, 80
INPUTS, MORE_INPUTS, CURRENTS = 0x294, 0x394, 0x312
BOTH_WAYS = ("can0.rx", "can0.tx")

Drive = Callable[..., Any]
FaultText = Callable[..., str]


def data(records: list[Record], cob_id: int) -> list[bytes]:
    return [record.frame.data for record in records if record.frame.can_id == cob_id]


def times(records: list[Record], cob_id: int) -> list[int]:
    return [record.time_ns for record in records if record.frame.can_id == cob_id]


KINDS = ("lost", "delayed", "repeated", "reordered", "corrupted", "masqueraded", "too-early")


@pytest.mark.parametrize("fault", KINDS)
def test_inputs_that_are_hit_are_as_ever_once_the_fault_has_ended(
    drive: Drive, fault_text: FaultText, fault: str
) -> None:
    """What the cards send moves nothing, so that all but the hit cycles are those of a sound run, byte for byte."""
    sound, hit = drive(), drive(fault_text("can0.tx", fault, cob_id=INPUTS))
    assert hit.cycles(BEGIN) == sound.cycles(BEGIN)
    assert hit.cycles(END - BEGIN) != sound.cycles(END - BEGIN)
    for run in (hit, sound):
        run.cycles(4)  # what was delayed by 5 ms comes
    assert hit.cycles(CYCLES - END) == sound.cycles(CYCLES - END)
    assert hit.is_sound
    assert hit.stamps_never_go_back
    assert hit.joints == sound.joints


@pytest.mark.parametrize("fault", KINDS)
def test_after_a_fault_on_all_that_cards_receive_outputs_act_again(
    drive: Drive, fault_text: FaultText, fault: str
) -> None:
    sound, hit = drive(), drive(fault_text("can0.rx", fault))
    for run in (sound, hit):
        run.cycles(CYCLES)
    assert hit.is_sound
    assert hit.stamps_never_go_back
    commands = [[joint.command_a for joint in joints] for joints in hit.joints]
    expected = [[joint.command_a for joint in joints] for joints in sound.joints]
    assert commands[:BEGIN] == expected[:BEGIN]
    assert commands[END + 4 :] == expected[END + 4 :]


def test_lost_frames_do_not_come_and_others_do(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.tx", "lost", cob_id=INPUTS))
    records = run.cycles(CYCLES)
    assert len(data(records, INPUTS)) == CYCLES - (END - BEGIN)
    assert len(data(records, MORE_INPUTS)) == CYCLES


def test_lost_outputs_leave_the_last_current(drive: Drive, fault_text: FaultText) -> None:
    """The command of cycle n acts at SYNC n; from cycle 40 on 0.2 A and then 0.1 A would be sent by turns."""
    run = drive(fault_text("can0.rx", "lost", cob_id=CURRENTS))
    run.cycles(CYCLES)
    assert len({joints[0].command_a for joints in run.joints[BEGIN + 1 : END]}) == 1
    assert len({joints[0].command_a for joints in run.joints[END + 1 :]}) == 2


def test_delayed_inputs_come_at_their_time_beyond_the_next_sync(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.tx", "delayed", cob_id=INPUTS, delay=3.0))
    late = [time_ns % CYCLE_NS for time_ns in times(run.cycles(CYCLES), INPUTS)]
    assert late[:BEGIN] == [SCAN_NS] * BEGIN
    assert late[BEGIN : END - 1] == [SCAN_NS + 3_000_000 - CYCLE_NS] * (END - BEGIN - 1)
    assert late[END - 1 : END + 1] == [SCAN_NS, SCAN_NS + 3_000_000 - CYCLE_NS]  # the first sound one overtakes
    assert late[END + 1 :] == [SCAN_NS] * (CYCLES - END - 1)
    assert run.stamps_never_go_back


def test_what_was_held_back_comes_after_the_end_of_its_fault_but_not_after_clear(
    drive: Drive, fault_text: FaultText
) -> None:
    """One frame a cycle is held back by 0.1 s, from cycle 40 to 59: 20 of them wait in cycle 60."""
    text = fault_text("can0.tx", "delayed", cob_id=INPUTS, delay=100)
    for clear, late in (("", 20), ('clear = ""', 0), ('clear = "set 1"', 0)):
        run = drive(text)
        run.cycles(END)
        if clear:
            run.inject(clear)
        assert len(data(run.cycles(CYCLES), INPUTS)) == CYCLES + late
        assert run.is_sound


def test_clear_drops_what_an_active_fault_holds_and_leaves_what_others_hold(
    drive: Drive, fault_text: FaultText
) -> None:
    first = fault_text("can0.tx", "delayed", 0.1, None, cob_id=INPUTS, delay=100)
    second = fault_text("can0.tx", "delayed", 0.1, None, cob_id=MORE_INPUTS, delay=100)
    run = drive("parallel = true\n" + first + second)
    run.cycles(END)
    run.inject('clear = "set 1"')
    records = run.cycles(20)
    assert len(data(records, INPUTS)) == 20
    assert not data(records, MORE_INPUTS)
    records = run.cycles(20)
    assert len(data(records, INPUTS)) == 20
    assert len(data(records, MORE_INPUTS)) == 20  # the first of them were sent 40 cycles ago


def test_clear_drops_the_first_of_a_pair(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.rx", "reordered", at=None, duration=None), is_started=False)
    run.bench.receive(Frame(0x123, b"a"), "alice")
    run.inject('clear = ""')
    run.bench.advance(run.bench.time_ns)
    assert not data(run.taken(), 0x123)
    assert run.is_sound


def test_a_set_without_faults_drops_what_others_hold(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.tx", "delayed", 0.1, None, cob_id=INPUTS, delay=100) + "[[set]]\nat = 0.15\n")
    run.cycles(END)
    assert len(data(run.cycles(CYCLES), INPUTS)) == CYCLES
    assert run.is_sound


@pytest.mark.parametrize("clock", [Clock.SYNC, Clock.WALL])
def test_what_was_delayed_comes_while_nobody_sends_sync(drive: Drive, fault_text: FaultText, clock: Clock) -> None:
    run = drive(fault_text("can0.tx", "delayed", at=0.1, duration=None, cob_id=INPUTS, delay=50), clock)
    run.cycles(BEGIN + 1)
    sync_ns = times(run.log, 0x80)[-1]
    if clock is Clock.SYNC:
        run.bench.run_on()
    else:
        run.bench.advance(run.bench.time_ns + 300_000_000)
    (late_ns,) = times(run.taken(), INPUTS)[-1:]
    assert late_ns == sync_ns + SCAN_NS + 50_000_000  # the cards, unheard, stop after 100 ms
    assert run.stamps_never_go_back


def test_a_wall_clock_runner_learns_when_a_delayed_frame_is_due(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.rx", "delayed", at=None, duration=None, delay=7.0), Clock.WALL, is_started=False)
    run.send(Frame(0x614, bytes.fromhex("4000100000000000")))
    assert run.bench.next_due_ns == 7_000_000
    run.bench.advance(7_000_000)
    assert [(r.time_ns, r.frame.can_id) for r in run.taken()] == [(7_000_000, 0x614), (7_000_000, 0x594)]


def test_repeated_frames_come_as_often_as_asked_for(drive: Drive, fault_text: FaultText) -> None:
    records = drive(fault_text("can0.tx", "repeated", cob_id=INPUTS, copies=3)).cycles(CYCLES)
    assert len(data(records, INPUTS)) == CYCLES + 3 * (END - BEGIN)


def test_faults_of_one_direction_act_in_the_order_in_which_they_began(drive: Drive) -> None:
    text = """
    [[set]]
    at = 0.1
    duration = 0.05
    [[set.fault]]
    tap = "can0.tx"
    fault = "repeated"
    cob_id = 0x294
    [[set.fault]]
    tap = "can0.tx"
    fault = "delayed"
    cob_id = 0x294
    delay = 4
    [[set.fault]]
    tap = "can0.tx"
    fault = "corrupted"
    cob_id = 0x294
    mask = 255
    byte = 0
    """
    sound, run = drive().cycles(CYCLES), drive(text)
    records = run.cycles(CYCLES)
    expected = [bytes((each[0] ^ 255,)) + each[1:] for each in data(sound, INPUTS)[BEGIN:END] for _ in "ab"]
    last = BEGIN + len(expected) - 2  # the first sound one overtakes the last pair
    assert data(records, INPUTS)[BEGIN:last] == expected[:-2]
    late = {time_ns % CYCLE_NS for time_ns in times(records, INPUTS)[BEGIN:last]}
    assert late == {SCAN_NS + 4_000_000 - CYCLE_NS}
    assert run.is_sound


def test_of_two_equal_faults_the_one_whose_time_is_over_ends(drive: Drive, fault_text: FaultText) -> None:
    first = fault_text("can0.tx", "repeated", 0.1, 0.05, cob_id=INPUTS)
    second = fault_text("can0.tx", "repeated", 0.1, 0.1, cob_id=INPUTS)
    run = drive("parallel = true\n" + first + second)
    counts = [len(data(run.cycles(1), INPUTS)) for _ in range(100)]
    assert counts == [1] * BEGIN + [4] * (END - BEGIN) + [2] * 20 + [1] * 20


def test_a_fault_that_begins_later_does_not_meet_frames_that_another_holds(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.tx", "delayed", 0.1, 0.0025, cob_id=INPUTS, delay=10.0))
    run.cycles(BEGIN + 1)
    run.inject(fault_text("can0.tx", "lost", at=None, duration=None, cob_id=INPUTS))
    assert len(data(run.cycles(10), INPUTS)) == 1


def test_reordered_frames_change_places_in_pairs(drive: Drive, fault_text: FaultText) -> None:
    sound = data(drive().cycles(CYCLES), INPUTS)[BEGIN:END]
    run = drive(fault_text("can0.tx", "reordered", cob_id=INPUTS))
    expected = [each for pair in zip(sound[1::2], sound[::2], strict=True) for each in pair]
    assert data(run.cycles(CYCLES), INPUTS)[BEGIN:END] == expected


def test_the_first_of_a_pair_comes_when_the_fault_ends_and_is_still_its_senders(
    drive: Drive, fault_text: FaultText
) -> None:
    """One client's frame does not become another's, who would hear it as an echo."""
    run = drive(fault_text("can0.rx", "reordered", at=None, duration=0.02), is_started=False)
    run.bench.receive(Frame(0x123, b"a"), "alice")
    run.bench.receive(Frame(0x124, b"b"), "bob")
    run.bench.receive(Frame(0x125, b"c"), "carol")
    run.bench.advance(run.bench.time_ns + 20_000_000)
    run.bench.advance(run.bench.time_ns)
    assert [record.origin for record in run.taken() if record.origin] == ["bob", "alice", "carol"]
    assert run.is_sound


def test_corrupted_outputs_act_as_what_they_have_become(drive: Drive, fault_text: FaultText) -> None:
    """Bit 5 of the upper byte is bit 6 of the code: 17 becomes 81, of 255 codes for 1.5 A."""
    run = drive(fault_text("can0.rx", "corrupted", cob_id=CURRENTS))
    run.cycles(CYCLES)
    currents = {round(abs(joints[0].command_a) * 255 / 1.5) for joints in run.joints[BEGIN + 1 : END]}
    assert currents == {17 ^ 64, 34 ^ 64}


def test_masqueraded_frames_are_followed_by_the_forged_ones(drive: Drive, fault_text: FaultText) -> None:
    sound = data(drive().cycles(CYCLES), INPUTS)[BEGIN:END]
    found = data(drive(fault_text("can0.tx", "masqueraded", cob_id=INPUTS)).cycles(CYCLES), INPUTS)
    assert found[BEGIN : BEGIN + 2 * (END - BEGIN)] == [each for one in sound for each in (one, b"\x20" * 8)]


def test_frames_too_early_carry_the_data_of_those_before(drive: Drive, fault_text: FaultText) -> None:
    sound = data(drive().cycles(CYCLES), INPUTS)
    found = data(drive(fault_text("can0.tx", "too-early", cob_id=INPUTS)).cycles(CYCLES), INPUTS)
    assert found[BEGIN + 1 : END] == sound[BEGIN : END - 1]


def test_the_same_seed_hits_the_same_frames_and_another_hits_others(drive: Drive, fault_text: FaultText) -> None:
    text = fault_text("can0.tx", "lost", at=0.0, duration=None, probability=0.5, cob_id=INPUTS)
    first, again, other = (times(drive(text, seed=seed).cycles(100), INPUTS) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert 30 <= len(first) <= 70  # of 100 with probability 0.5: four standard deviations either way


def test_all_frames_but_sync_and_time_pass_the_fault(drive: Drive, fault_text: FaultText) -> None:
    run = drive("parallel = true\n" + "".join(fault_text(tap, "lost") for tap in BOTH_WAYS))
    run.cycles(BEGIN + 1)
    assert {record.frame.can_id for record in run.cycles(END - BEGIN - 1)} == {0x080, 0x100}


def test_a_lost_nmt_start_leaves_the_cards_where_they_were(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.rx", "lost", at=None, duration=None), is_started=False)
    run.send(nmt_frame(NmtCommand.START))
    assert not run.bench.is_operational


# Babbling idiot: a frame without data has 47 bits with intermission before stuffing, 47 µs at 1 Mbit/s


def test_a_babbling_idiot_at_low_rate_is_on_the_bus_at_its_rate(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.rx", "babbling-idiot", rate=1000, duration=0.1), with_wire=True)
    records = run.cycles(100)
    assert len(data(records, 1)) == 100
    assert run.is_sound
    assert run.stamps_never_go_back


def test_a_babbling_idiot_at_full_rate_keeps_inputs_from_their_cycle_and_leaves_nothing_behind(
    drive: Drive, fault_text: FaultText
) -> None:
    run = drive(fault_text("can0.rx", "babbling-idiot", rate=100_000), with_wire=True)
    run.cycles(BEGIN)
    nodes = set(run.bench.wire.nodes)
    records = run.cycles(END - BEGIN)
    assert len(data(records, INPUTS)) < 2
    assert 45_000 < (END - BEGIN) * CYCLE_NS / len(data(records, 1)) < 60_000
    run.cycles(20)
    assert len(data(run.cycles(10), INPUTS)) == 10
    assert run.is_sound
    assert set(run.bench.wire.nodes) == nodes
    assert run.stamps_never_go_back


def test_a_babbling_idiot_goes_on_in_long_cycles_and_while_nobody_sends_sync(
    drive: Drive, fault_text: FaultText
) -> None:
    babble = fault_text("can0.rx", "babbling-idiot", at=0.0, duration=None, rate=1000)
    slow = fault_text("bench.clock", "clock-drift", 0.0, None, rate=300)
    run = drive("parallel = true\n" + babble + slow, with_wire=True)
    run.cycles(10)
    run.bench.run_on()
    run.taken()
    heard = times(run.log, 1)
    gaps = {round((after - before) / 1e6) for before, after in pairwise(heard)}
    assert gaps == {1}
    assert heard[-1] - heard[0] > 500_000_000
    assert run.stamps_never_go_back


def test_intruders_reach_clients_and_cards(drive: Drive, fault_text: FaultText) -> None:
    """0x701 without data is no heartbeat; one of a byte is, and keeps the cards' watch quiet."""
    run = drive(fault_text("can0.rx", "babbling-idiot", 0.0, None, cob_id=0x701, length=1, rate=50), with_wire=True)
    run.cycles(1)
    run.cycles(100, is_heard=False)
    assert {type(record.origin) for record in run.log if record.frame == Frame(0x701, b"\0")} == {Intruder}
    assert not data(run.log, 0x92)
