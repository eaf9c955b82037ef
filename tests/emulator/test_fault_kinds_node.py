"""Faults of nodes, on a bench with a scripted master.

konkuk1: heartbeats every 20 ms both ways, a watch of 100 ms, error values of no current and open bridges; 0x12 drives
the currents, 0x13 the directions, 0x14 measures. A set with at = 0.1 begins with cycle 40.
"""

import struct
from collections.abc import Callable
from typing import Any

import pytest

from canarm_emulator.bench.bench import Record
from canarm_protocol.canopen.frames import Frame, NmtCommand, NmtState, nmt_frame
from canarm_protocol.canopen.sdo import download
from canarm_protocol.clock import Clock

DAC, LATCH, ADC = 0x12, 0x13, 0x14
CYCLE_S, BEGIN, END, CYCLES = 0.0025, 40, 120, 200
DURATION = (END - BEGIN) * CYCLE_S
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = b"\x00", b"\x04", b"\x05", b"\x7f"  # CiA 301, heartbeat
READ_DEVICE_TYPE = Frame(0x614, bytes.fromhex("4000100000000000"))
GENERAL_ERROR = struct.pack("<I", 0x0800_0000)
SHORT, LONG = 17 * 1.5 / 255, 34 * 1.5 / 255  # the master's commands

Drive = Callable[..., Any]
FaultText = Callable[..., str]
FAULTS = (
    *("crash", "hang", "reset", "late-boot", "duplicate-node-id", "wrong-nmt-state", "sync-missed"),
    *("heartbeat-lost", "sdo-abort", "line-broken", "clock-drift"),
)


def data(records: list[Record], cob_id: int) -> list[bytes]:
    return [record.frame.data for record in records if record.frame.can_id == cob_id]


def times_ms(records: list[Record], cob_id: int) -> list[float]:
    return [record.time_ns / 1e6 for record in records if record.frame.can_id == cob_id]


def commands(run: Any) -> list[float]:
    return [round(abs(joints[0].command_a), 9) for joints in run.joints]


def states(run: Any) -> set[NmtState]:
    return {slave.state for slave in run.bench.slaves}


@pytest.mark.parametrize("with_wire", [False, True], ids=["", "wire"])
@pytest.mark.parametrize("clock", [Clock.SYNC, pytest.param(Clock.WALL, marks=pytest.mark.slow)])
@pytest.mark.parametrize("node_id", [DAC, LATCH, ADC])
@pytest.mark.parametrize("fault", FAULTS)
def test_after_its_end_and_nmt_start_every_node_does_its_work_as_ever(
    drive: Drive, fault_text: FaultText, fault: str, node_id: int, clock: Clock, with_wire: bool
) -> None:
    run = drive(fault_text(f"node.0x{node_id:02X}", fault, duration=DURATION), clock, with_wire)
    run.cycles(END + 10)
    run.start()
    run.cycles(30)
    assert states(run) == {NmtState.OPERATIONAL}
    assert run.is_sound
    records = run.cycles(40)
    for card in (DAC, LATCH, ADC):
        assert data(records, 0x700 + card) == [OPERATIONAL] * 5
        assert not data(records, 0x80 + card)
    assert len(data(records, 0x294)) == len(data(records, 0x394)) == 40
    assert set(commands(run)[-40:]) == {round(SHORT, 9), round(LONG, 9)}
    assert run.stamps_never_go_back


@pytest.mark.parametrize("fault", ["heartbeat-lost", "sdo-abort", "duplicate-node-id", "clock-drift"])
def test_faults_that_move_nothing_leave_the_arm_as_it_was(drive: Drive, fault_text: FaultText, fault: str) -> None:
    """At the ADC. A duplicate starts nothing, and NMT start is not sent again."""
    sound, hit = drive(), drive(fault_text("node.0x14", fault, duration=DURATION))
    for run in (sound, hit):
        run.cycles(CYCLES)
    assert hit.joints == sound.joints
    inputs = [[record for record in run.log if record.frame.can_id == 0x294] for run in (sound, hit)]
    assert inputs[0] == inputs[1]


def test_a_crashed_dac_gives_no_current_at_once_and_boots_at_the_end(drive: Drive, fault_text: FaultText) -> None:
    """Without the heartbeat that it was configured to send: 0x1017 is 0 again."""
    run = drive(fault_text("node.0x12", "crash", duration=DURATION))
    records = run.cycles(CYCLES)
    assert commands(run)[BEGIN:] == [0.0] * (CYCLES - BEGIN)
    assert min(commands(run)[1:BEGIN]) > 0.0
    beats = list(zip(times_ms(records, 0x712), data(records, 0x712), strict=True))
    assert [beat for beat in beats if beat[0] > BEGIN * 2.5] == [(END * 2.5, BOOT_UP)]
    assert run.bench.slaves[0].state is NmtState.PRE_OPERATIONAL


def test_a_crashed_latch_opens_the_bridges(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x13", "crash", duration=None))
    run.cycles(CYCLES)
    assert set(commands(run)[BEGIN:]) == {0.0}


def test_a_hung_dac_keeps_its_last_current_past_its_watch(drive: Drive, fault_text: FaultText) -> None:
    """Nobody's heartbeat is missed by a processor that stands still."""
    run = drive(fault_text("node.0x12", "hang", duration=DURATION))
    records = run.cycles(END)
    assert len(set(commands(run)[BEGIN:])) == 1
    assert commands(run)[-1] > 0.0
    assert not [time for time in times_ms(records, 0x712) if time > BEGIN * 2.5]
    more = run.cycles(20)
    assert times_ms(more, 0x712)[0] == END * 2.5
    assert not data(run.log, 0x92)
    assert states(run) == {NmtState.OPERATIONAL}


def test_timers_that_fell_due_in_a_hang_start_anew_at_its_end(drive: Drive, fault_text: FaultText) -> None:
    """An event timer of 10 ms on the second input PDO, which is made event-driven (CiA 301, type 255)."""
    run = drive(is_started=False)
    run.write(ADC, 0x1802, 2, b"\xff")
    run.write(ADC, 0x1802, 5, b"\x0a\x00")
    run.start()
    run.inject(fault_text("node.0x14", "hang", duration=DURATION))
    records = run.cycles(CYCLES)
    times = times_ms(records, 0x394)
    assert times
    assert not [time for time in times if BEGIN * 2.5 < time < END * 2.5 + 10]
    assert min(time for time in times if time > BEGIN * 2.5) == END * 2.5 + 10
    assert run.stamps_never_go_back


def test_a_card_behind_a_broken_line_protects_itself_after_its_watch_and_says_so_when_it_is_back(
    drive: Drive, fault_text: FaultText
) -> None:
    """The last heartbeat that it hears comes after the inputs of cycle 39, at 98.1 ms; 100 ms later is cycle 79."""
    run = drive(fault_text("node.0x12", "line-broken", duration=DURATION))
    records = run.cycles(END)
    lost = commands(run).index(0.0, BEGIN)
    assert lost == BEGIN + 39
    assert len(set(commands(run)[BEGIN:lost])) == 1
    assert not [time for time in times_ms(records, 0x712) if time > BEGIN * 2.5]
    assert not data(records, 0x92)
    more = run.cycles(20)
    assert data(more, 0x92)[:1] == [bytes(8)]  # CiA 301: error reset, once the heartbeat is heard again
    assert data(more, 0x712)[:1] == [PRE_OPERATIONAL]  # 0x1029:1 = 0


@pytest.mark.parametrize("fault", ["line-broken", "hang", "crash"])
def test_nmt_and_sdo_do_not_reach_a_card_that_is_off_the_bus(drive: Drive, fault_text: FaultText, fault: str) -> None:
    run = drive(fault_text("node.0x14", fault, at=0.0, duration=None))
    run.cycles(2)
    assert [record.frame.can_id for record in run.send(READ_DEVICE_TYPE)] == [0x614]
    assert len(run.send(Frame(0x294, b"", is_remote=True))) == 1
    run.send(nmt_frame(NmtCommand.STOP, ADC))
    assert run.bench.slaves[2].state is NmtState.OPERATIONAL


def test_a_reset_card_boots_with_error_values_and_waits_for_nmt_start(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x12", "reset"))
    records = run.cycles(CYCLES)
    assert set(commands(run)[BEGIN:]) == {0.0}
    assert data(records, 0x712)[-1] == BOOT_UP
    assert run.bench.slaves[0].state is NmtState.PRE_OPERATIONAL


def test_a_reset_forgets_a_segmented_transfer(drive: Drive, fault_text: FaultText) -> None:
    """0x1008, the device name, is longer than four bytes; a segment of no transfer is refused (CiA 301, 0504 0001h)."""
    run = drive()
    run.cycles(2)
    (_, start) = run.send(Frame(0x614, bytes.fromhex("4008100000000000")))
    assert start.frame.data[0] == 0x41
    run.inject(fault_text("node.0x14", "reset", at=None))
    run.cycles(1)
    (_, answer) = run.send(Frame(0x614, bytes.fromhex("6000000000000000")))
    assert answer.frame.data[:1] + answer.frame.data[4:] == b"\x80" + struct.pack("<I", 0x0504_0001)


def test_a_card_that_boots_late_on_the_wall_clock_is_not_there_before(drive: Drive, fault_text: FaultText) -> None:
    run = drive("", Clock.WALL, is_started=False)
    run.taken()
    run.inject(fault_text("node.0x14", "late-boot", at=None, duration=None, delay=0.3))
    for step in range(1, 100):
        run.bench.advance(step * 5_000_000 + step)
    records = run.taken()
    first = next(record for record in records if record.frame.can_id == 0x714)
    assert first.frame.data == BOOT_UP
    assert 300 <= first.time_ns / 1e6 <= 310
    assert run.stamps_never_go_back


def test_a_card_that_boots_late_in_lockstep_boots_when_syncs_have_taken_time_on(
    drive: Drive, fault_text: FaultText
) -> None:
    run = drive("", is_started=False)
    run.taken()
    run.inject(fault_text("node.0x14", "late-boot", at=None, duration=None, delay=0.1))
    assert [record.frame.can_id for record in run.send(READ_DEVICE_TYPE)] == [0x614]
    booted = [(record.time_ns / 1e6, record.frame.data) for record in run.cycles(60) if record.frame.can_id == 0x714]
    assert booted == [(100.0, BOOT_UP)]


def test_a_second_card_with_the_same_node_id_boots_and_is_gone_at_the_end(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "duplicate-node-id", duration=DURATION))
    records = run.cycles(END + 1)
    booted = [record.time_ns / 1e6 for record in records if record.frame == Frame(0x714, BOOT_UP)]
    assert booted == [BEGIN * 2.5]
    assert [record.frame.can_id for record in run.send(READ_DEVICE_TYPE)] == [0x614, 0x594]


def test_two_cards_with_one_node_id_send_heartbeats_of_different_states(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "duplicate-node-id", at=0.0, duration=None))
    run.cycles(1)
    run.write(ADC, 0x1017, 0, b"\x14\x00")
    assert set(data(run.cycles(40), 0x714)) == {OPERATIONAL, PRE_OPERATIONAL}


def test_both_answer_a_request_and_both_send_inputs_after_nmt_start(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "duplicate-node-id", at=None, duration=None))
    run.cycles(1)
    assert [record.frame.can_id for record in run.send(READ_DEVICE_TYPE)] == [0x614, 0x594, 0x594]
    run.send(nmt_frame(NmtCommand.START))
    assert bytes(8) in data(run.cycles(1), 0x294)  # wired to nothing: 0 V at every channel
    assert len(data(run.cycles(10), 0x294)) == 20


def test_on_the_wire_two_senders_of_different_frames_with_one_identifier_destroy_each_others(
    drive: Drive, fault_text: FaultText
) -> None:
    """ISO 11898-1: a bit error for who sends recessive and reads dominant; both send again, at the same time."""
    run = drive(fault_text("node.0x14", "duplicate-node-id", at=None, duration=None), with_wire=True)
    run.cycles(1)
    run.send(nmt_frame(NmtCommand.START))
    run.cycles(10)
    assert run.bench.trouble.error_frames >= 16  # 8 each bring both to 128
    assert max(node.tec for node in run.bench.wire.nodes.values()) > 100


def test_a_duplicate_is_not_touched_by_what_befalls_the_first_card(drive: Drive, fault_text: FaultText) -> None:
    one, two = (fault_text("node.0x14", fault, None, None) for fault in ("duplicate-node-id", "crash"))
    run = drive("parallel = true\n" + one + two)
    run.cycles(1)
    assert [record.frame.can_id for record in run.send(READ_DEVICE_TYPE)] == [0x614, 0x594]


@pytest.mark.parametrize(("state", "beat"), [("pre-operational", PRE_OPERATIONAL), ("stopped", STOPPED)])
def test_a_card_in_the_wrong_nmt_state_says_so_in_its_heartbeat(
    drive: Drive, fault_text: FaultText, state: str, beat: bytes
) -> None:
    run = drive(fault_text("node.0x14", "wrong-nmt-state", state=state))
    run.cycles(BEGIN)
    records = run.cycles(20)
    assert set(data(records, 0x714)[1:]) == {beat}
    assert not data(records, 0x294)


def test_every_second_sync_is_missed(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "sync-missed", duration=DURATION, every=2))
    assert len(data(run.cycles(CYCLES), 0x294)) == CYCLES - (END - BEGIN) // 2


def test_a_lost_heartbeat_is_all_that_is_lost(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "heartbeat-lost", duration=DURATION))
    records = run.cycles(CYCLES)
    assert not [time for time in times_ms(records, 0x714) if BEGIN * 2.5 < time < END * 2.5]
    assert len(data(records, 0x294)) == CYCLES


def test_a_card_that_aborts_sdo_names_the_object_and_writes_nothing(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("node.0x14", "sdo-abort", at=None, duration=DURATION), is_started=False)
    run.taken()
    (_, refusal) = run.send(Frame(0x614, next(download(0x1017, 0, b"\x05\x00"))))
    assert refusal.frame.data == bytes.fromhex("80171000") + GENERAL_ERROR
    run.inject('clear = ""')
    (_, answer) = run.send(Frame(0x614, bytes.fromhex("4017100000000000")))
    assert answer.frame.data == bytes.fromhex("4b17100000000000")  # none, as by default


def test_a_slow_clock_stretches_the_heartbeat_also_when_it_is_configured_anew(
    drive: Drive, fault_text: FaultText
) -> None:
    run = drive(fault_text("node.0x14", "clock-drift", None, None, rate=100), is_started=False)
    run.start()
    assert times_ms(run.cycles(100), 0x714) == [40.0, 80.0, 120.0, 160.0, 200.0, 240.0]


def test_one_faults_end_leaves_what_another_does_to_the_same_card(drive: Drive, fault_text: FaultText) -> None:
    both = [fault_text("node.0x14", "line-broken", 0.1, 0.2), fault_text("node.0x14", "crash", 0.15, 0.05)]
    both += [fault_text("node.0x14", "heartbeat-lost", 0.1, 0.3), fault_text("node.0x14", "sync-missed", 0.1, 0.1)]
    run = drive("parallel = true\n" + "".join(both))
    run.cycles(BEGIN)
    run.cycles(79)
    assert not [record for record in run.log if record.frame.can_id in (0x714, 0x94) and record.time_ns > 100_000_000]
    run.cycles(39)
    run.start()  # it has crashed, and lost its configuration
    assert not [time for time in times_ms(run.log, 0x714) if 100 < time < 400]
    run.cycles(30)
    assert set(data(run.log, 0x714)[-2:]) == {OPERATIONAL}
    assert run.is_sound


def test_a_fault_that_is_ended_before_it_could_act_does_nothing(drive: Drive, fault_text: FaultText) -> None:
    """A set without duration ends when the next one's trigger holds, here at the same instant."""
    hang, other = fault_text("node.0x12", "hang", 0.1, None), fault_text("can0.rx", "lost", 0.1, 0.0025, cob_id=7)
    sound, run = drive(), drive(hang + other)
    sound.cycles(60)
    run.cycles(60)
    assert run.joints == sound.joints
    assert states(run) == {NmtState.OPERATIONAL}
