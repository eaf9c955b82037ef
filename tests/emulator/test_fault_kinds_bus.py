"""Faults of the wire, on a bench with a scripted master.

Counts by ISO 11898-1:2015, 12.1.4.2: an error of its own adds 8 to the sender's counter (rule c), a frame sent takes 1
off (rule g), a disturbed frame adds 1 to its receivers' (rule a) and a sound one takes 1 off (rule h); 128 is
error-passive, 256 bus-off, and 128 times 11 recessive bits end it. EMCY codes by CiA 301, table 26.
"""

from collections.abc import Callable
from typing import Any

import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.wire.confinement import ErrorState
from canarm_emulator.wire.wire_events import ErrorFrame, StateChange
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError

ADC, INPUTS = 0x14, 0x294
BEGIN, END = 40, 60
EMCY_PASSIVE, EMCY_RECOVERED = "2081", "4081"

Drive = Callable[..., Any]
FaultText = Callable[..., str]


def errors(records: list[Record]) -> list[ErrorFrame]:
    return [record.origin for record in records if isinstance(record.origin, ErrorFrame)]


def changes(records: list[Record]) -> list[tuple[object, ErrorState]]:
    return [(r.origin.node, r.origin.state) for r in records if isinstance(r.origin, StateChange)]


def emergencies(records: list[Record]) -> list[str]:
    return [record.frame.data[:2].hex() for record in records if record.frame.can_id == 0x80 + ADC]


def inputs(records: list[Record]) -> list[tuple[int, bytes]]:
    return [(record.time_ns, record.frame.data) for record in records if record.frame.can_id == INPUTS]


@pytest.mark.parametrize("fault", ["error-frames", "no-ack", "bus-off"])
def test_without_the_wire_model_it_is_refused(drive: Drive, fault_text: FaultText, fault: str) -> None:
    with pytest.raises(FaultError, match="--wire"):
        drive(fault_text("can0.wire", fault))


@pytest.mark.parametrize("fault", ["error-frames", "no-ack", "bus-off"])
@pytest.mark.parametrize("clock", list(Clock))
def test_by_its_defaults_it_hits_something_and_ends(
    drive: Drive, fault_text: FaultText, fault: str, clock: Clock
) -> None:
    run = drive(fault_text("can0.wire", fault), clock, with_wire=True)
    run.cycles(BEGIN)
    assert not errors(run.log)
    run.cycles(END - BEGIN + 1)
    assert len(errors(run.log)) >= END - BEGIN
    run.cycles(10)
    assert not errors(run.cycles(100))
    assert run.is_sound
    assert not run.bench.wire._disturbances
    assert run.stamps_never_go_back


@pytest.mark.parametrize("fault", ["error-frames", "no-ack"])
def test_a_few_hits_cost_time_and_nothing_else(drive: Drive, fault_text: FaultText, fault: str) -> None:
    sound, hit = (drive(text, with_wire=True) for text in ("", fault_text("can0.wire", fault)))
    sound.cycles(END)
    hit.cycles(END)
    assert hit.joints == sound.joints
    late = [a[0] - b[0] for a, b in zip(inputs(hit.log), inputs(sound.log), strict=True)]
    assert set(late[:BEGIN]) == {0}
    assert min(late[BEGIN:]) > 20_000  # from the error to the end of the delimiter, 8 bits at least, and all again
    assert [data for _, data in inputs(hit.log)] == [data for _, data in inputs(sound.log)]


def test_error_frames_move_the_counters_as_the_standard_says(drive: Drive, fault_text: FaultText) -> None:
    """A cycle: one error and, of the ADC, two frames sent (0x294, 0x394): 8 - 2. Its heartbeat is an eighth's more."""
    run = drive(fault_text("can0.wire", "error-frames"), with_wire=True)
    run.cycles(BEGIN)
    beats = len([r for r in run.cycles(10) if r.frame.can_id == 0x700 + ADC and r.time_ns > 101_000_000])
    assert run.bench.wire.nodes[ADC].tec == 10 * (8 - 2) - beats
    assert run.bench.wire.nodes[0x12].rec == 0  # one up, and down again with the next frame


def test_many_hits_make_the_sender_error_passive_and_it_says_so(drive: Drive, fault_text: FaultText) -> None:
    """5 errors and 2 frames a cycle, 38 net: 114 after three, and in the fourth the second error passes 128."""
    run = drive(fault_text("can0.wire", "error-frames", at=None, duration=None, count=5), with_wire=True)
    run.cycles(1)  # the first SYNC after NMT start begins it
    while not changes(run.log):
        run.cycles(1)
    assert changes(run.log) == [(ADC, ErrorState.PASSIVE)]
    assert len(errors(run.log)) in range(16, 21)
    run.cycles(1)
    assert emergencies(run.log) == [EMCY_PASSIVE]


def test_hits_do_not_add_up_while_the_identifier_is_not_sent(drive: Drive, fault_text: FaultText) -> None:
    """A heartbeat every 20 ms is hit once each, not eight times for the eight cycles."""
    run = drive(fault_text("can0.wire", "error-frames", 0.0, None, cob_id=0x714), with_wire=True)
    records = run.cycles(81)
    assert len(errors(records)) == len([record for record in records if record.frame.can_id == 0x714])


def test_what_has_not_been_hit_when_the_fault_ends_is_not(drive: Drive, fault_text: FaultText) -> None:
    run = drive(fault_text("can0.wire", "bus-off", cob_id=0x77), with_wire=True)
    run.cycles(BEGIN + 1)
    assert run.bench.wire._disturbances
    run.cycles(END - BEGIN)
    assert not run.bench.wire._disturbances


@pytest.mark.parametrize("earlier_errors", [0, 3])
def test_bus_off_takes_the_sender_off_once_and_it_recovers_and_says_so(
    drive: Drive, fault_text: FaultText, earlier_errors: int
) -> None:
    """From a counter above 0 fewer than 32 errors are enough, and none of the 32 is left for later."""
    run = drive("", with_wire=True)
    if earlier_errors:
        run.cycles(1)
        run.bench.wire.corrupt(INPUTS, times=earlier_errors, bit=8)
        run.cycles(1)
    run.inject(fault_text("can0.wire", "bus-off", at=None, duration=None))
    tec = run.bench.wire.nodes[ADC].tec
    records = run.cycles(20)
    assert changes(records) == [(ADC, state) for state in (ErrorState.PASSIVE, ErrorState.BUS_OFF, ErrorState.ACTIVE)]
    assert len(errors(records)) == 32 - tec // 8
    passive, off, active = [r.origin.time_ns for r in records if isinstance(r.origin, StateChange)]
    assert passive < off
    assert active - off >= 128 * 11 * 1000
    assert emergencies(records)[-1] == "0000"
    assert EMCY_RECOVERED in emergencies(records)
    assert not run.bench.wire._disturbances
    run.start()
    assert len(inputs(run.cycles(10))) == 10


def test_without_acknowledgement_the_sender_is_error_passive_and_never_off_the_bus(
    drive: Drive, fault_text: FaultText
) -> None:
    """Rule c, exception 1: an error-passive sender does not count ACK errors any further. Its receivers, which see no
    flag then, do not count them either.
    """
    run = drive(fault_text("can0.wire", "no-ack", at=None, duration=None, count=10), with_wire=True)
    highest = []
    for _ in range(100):
        run.cycles(1)
        highest.append(run.bench.wire.nodes[ADC].tec)
    assert max(highest) <= 127 + 8  # the last that counts is that of an error-active sender
    assert changes(run.log)[0] == (ADC, ErrorState.PASSIVE)
    assert not run.bench.trouble.off
    assert run.bench.wire.nodes[0x12].rec < 16
    assert len(inputs(run.log)) == 100


def test_a_master_alone_with_dead_cards_gets_no_acknowledgement_and_stays_at_128(
    drive: Drive, fault_text: FaultText
) -> None:
    dead = "".join(fault_text(f"node.0x{node_id}", "line-broken", 0.1, 0.05) for node_id in (12, 13, 14))
    run = drive("parallel = true\n" + dead, with_wire=True)
    run.cycles(BEGIN + 10)
    assert run.bench.wire.nodes[run.MASTER].tec == 128
    assert {each.kind.name for each in errors(run.log)} == {"ACK"}
    run.cycles(END - BEGIN)
    assert len(inputs(run.cycles(10))) == 10
    assert run.bench.wire.nodes[run.MASTER].state is ErrorState.ACTIVE
    assert run.stamps_never_go_back


def test_a_card_that_lost_its_line_acknowledges_nothing_and_another_does(drive: Drive, fault_text: FaultText) -> None:
    two = "".join(fault_text(f"node.0x{node_id}", "line-broken", 0.1, None) for node_id in (12, 13))
    run = drive("parallel = true\n" + two, with_wire=True)
    run.cycles(END)
    assert not errors(run.log)
    assert len(inputs(run.log)) == END
