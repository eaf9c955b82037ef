"""The bench with the wire model: on the wall clock every frame takes its time; in lockstep those of a cycle do, but
not NMT, SDO, SYNC and TIME.
"""

from collections.abc import Callable

import pytest

from canarm_emulator.bench.bench import Record
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Cob, Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell.cell_file import parse_cell, shipped_cells
from canarm_protocol.clock import Clock
from canarm_protocol.transport.bits import frame_bits

CYCLE_NS, SCAN_NS, DELAY_NS, BIT_NS = 2_500_000, 600_000, 500_000, 1000
INTERMISSION_BITS = 3  # ISO 11898-1: between two frames
CURRENTS, DIRECTIONS = Frame(0x312, b"\x80\x7f" + bytes(6)), Frame(0x213, b"\x02")
MASTER = "master"

MakeBench = Callable[..., FaultBench]


@pytest.fixture
def make_bench() -> MakeBench:
    def make(bitrate: int = 1_000_000, clock: Clock = Clock.SYNC) -> FaultBench:
        text = shipped_cells()["konkuk1"].replace("bitrate = 1_000_000", f"bitrate = {bitrate}")
        cell = parse_cell(text, "konkuk1")
        bench = FaultBench(cell, Truth.from_settings(cell), clock, 0, with_wire=True)
        bench.start()
        bench.receive(nmt_frame(NmtCommand.START), MASTER)
        return bench

    return make


def cycle(bench: FaultBench, *frames: Frame) -> list[Record]:
    bench.records.clear()
    for frame in frames:
        bench.receive(frame, MASTER)
    bench.receive(sync_frame(None), MASTER)
    return list(bench.records)


def end_of(records: list[Record], can_id: int) -> int:
    (found,) = [record.time_ns for record in records if record.frame.can_id == can_id]
    return found


def test_questions_before_a_run_are_answered_without_time_passing(make_bench: MakeBench) -> None:
    bench = make_bench()
    bench.records.clear()
    bench.receive(Frame(0x614, bytes.fromhex("4000100000000000")), MASTER)
    assert [record.frame.can_id for record in bench.records] == [0x614, 0x594]
    assert bench.time_ns == 0


def test_inputs_reach_the_bus_one_after_the_other_each_at_its_last_bit(make_bench: MakeBench) -> None:
    """Six channels are wired: the scan takes 600 µs, then come two frames of exactly their bits."""
    records = cycle(make_bench())
    first, second = (record.frame for record in records if record.frame.can_id in (0x294, 0x394))
    first_end = SCAN_NS + frame_bits(first) * BIT_NS
    second_end = first_end + (INTERMISSION_BITS + frame_bits(second)) * BIT_NS
    assert end_of(records, 0x294) == first_end
    assert end_of(records, 0x394) == second_end
    assert records[-1].frame.can_id == Cob.TIME
    assert records[-1].time_ns == second_end


def test_outputs_queue_after_the_time_to_compute_and_the_lower_identifier_goes_first(make_bench: MakeBench) -> None:
    bench = make_bench()
    queued_ns = cycle(bench)[-1].time_ns + DELAY_NS
    records = cycle(bench, CURRENTS, DIRECTIONS)
    # One controller sends its own frames in the order in which it queued them.
    assert end_of(records, 0x312) == queued_ns + frame_bits(CURRENTS) * BIT_NS
    assert end_of(records, 0x213) > end_of(records, 0x312)
    assert end_of(records, Cob.SYNC) == CYCLE_NS
    assert bench.world.state()[0].command_a == pytest.approx(1.5)


def test_outputs_that_a_slow_wire_delivers_after_sync_act_a_cycle_later(make_bench: MakeBench) -> None:
    """At 250 kbit/s the cyclic chain is 3.7 ms long, as `canarm check` says."""
    bench = make_bench(250_000)
    cycle(bench)
    late = cycle(bench, CURRENTS, DIRECTIONS)
    assert 0x213 not in [record.frame.can_id for record in late if record.time_ns <= CYCLE_NS]
    assert bench.world.state()[0].command_a == 0.0
    cycle(bench)
    assert bench.world.state()[0].command_a == pytest.approx(1.5)


def test_a_client_that_leaves_has_what_it_sent_carried_all_the_same(make_bench: MakeBench) -> None:
    bench = make_bench()
    cycle(bench)
    bench.records.clear()
    bench.receive(CURRENTS, MASTER)
    assert CURRENTS not in [record.frame for record in bench.records]
    bench.leave(MASTER)
    assert CURRENTS in [record.frame for record in bench.records]
    assert bench.wire is not None
    assert MASTER not in bench.wire.nodes


def test_load_and_worst_response_are_counted(make_bench: MakeBench) -> None:
    bench = make_bench()
    for _ in range(20):
        cycle(bench, CURRENTS, DIRECTIONS)
    wire = bench.wire
    assert wire is not None
    records = cycle(bench, CURRENTS, DIRECTIONS)
    carried = [record.frame for record in records if record.frame.can_id not in (Cob.SYNC, Cob.TIME)]
    busy_ns = sum(frame_bits(frame) + INTERMISSION_BITS for frame in carried) * BIT_NS
    assert wire.load() == pytest.approx(busy_ns / CYCLE_NS, rel=0.1)
    assert wire.worst_response_ns[0x294, False] == pytest.approx(
        end_of(records, 0x294) - 20 * CYCLE_NS - SCAN_NS, rel=0.2
    )


def test_in_a_running_lockstep_cycle_nmt_and_sdo_are_answered_at_once_and_are_no_load(make_bench: MakeBench) -> None:
    """Time stands still until the next SYNC: nobody could wait for an answer that the wire carries."""
    bench = make_bench()
    cycle(bench)
    assert bench.wire is not None
    now_ns, load = bench.time_ns, bench.wire.load()
    bench.records.clear()
    bench.receive(Frame(0x614, bytes.fromhex("4000100000000000")), MASTER)
    bench.receive(nmt_frame(NmtCommand.RESET_NODE, 0x12), MASTER)
    assert [record.frame.can_id for record in bench.records] == [0x614, 0x594, 0x000, 0x712]
    assert {record.time_ns for record in bench.records} == {now_ns}
    assert bench.wire.load() == load
    cycle(bench)
    assert not {0x000, 0x594, 0x614, 0x712} & {can_id for can_id, _ in bench.wire.worst_response_ns}


def test_cards_frames_that_nobody_takes_are_not_ignored_ones(make_bench: MakeBench) -> None:
    bench = make_bench()
    for _ in range(20):
        cycle(bench, CURRENTS, DIRECTIONS)
    assert bench.ignored_frames == 0
    bench.receive(Frame(0x7EE, b"?"), MASTER)
    cycle(bench)
    assert bench.ignored_frames == 1


def test_on_the_wall_clock_the_wire_carries_everything_from_power_on(make_bench: MakeBench) -> None:
    """Boot-up, NMT, SDO and SYNC: one after the other, each at its last bit."""
    bench = make_bench(clock=Clock.WALL)
    assert bench.records == []
    question = Frame(0x614, bytes.fromhex("4000100000000000"))
    bench.receive(question, MASTER)
    bench.receive(sync_frame(None), MASTER)
    bench.advance(20 * CYCLE_NS)
    found = {record.frame.can_id: record.time_ns for record in bench.records}
    # What the master sends has lower identifiers than the boot-up messages, which wait since power-on.
    end_ns = -INTERMISSION_BITS * BIT_NS
    for frame in (nmt_frame(NmtCommand.START), question, sync_frame(None)):
        end_ns += (INTERMISSION_BITS + frame_bits(frame)) * BIT_NS
        assert found[frame.can_id] == end_ns
    # The card's controller sends in order, so that its answer comes behind its own boot-up message.
    assert end_ns < found[0x712] < found[0x713] < found[0x714] < found[0x594]
    assert found[0x294] > found[Cob.SYNC] + SCAN_NS
    assert bench.wire is not None
    carried = [frame_bits(record.frame) + INTERMISSION_BITS for record in bench.records]
    assert bench.wire.load() == pytest.approx(sum(carried) * BIT_NS / (20 * CYCLE_NS))


def test_what_a_sender_offers_beyond_its_queue_is_lost_and_counted(make_bench: MakeBench) -> None:
    bench = make_bench(clock=Clock.WALL)
    bench.advance(CYCLE_NS)
    for _ in range(1000):
        bench.receive(CURRENTS, MASTER)
    assert bench.wire is not None
    assert len(bench.wire.nodes[MASTER].queue) == 256
    assert bench.trouble.lost_frames == 1000 - 256
    bench.leave(MASTER)
    bench.advance(CYCLE_NS + 1000 * CYCLE_NS)
    assert MASTER not in bench.wire.nodes
    assert bench.trouble.lost_frames == 1000 - 256


def test_a_flood_delays_sync_by_its_share_of_the_wire(make_bench: MakeBench) -> None:
    """A frame that wins every arbitration: SYNC waits until the flood's queue is empty."""
    bench = make_bench(clock=Clock.WALL)
    bench.advance(CYCLE_NS)
    flood = Frame(0x001, bytes(8))
    for _ in range(100):
        bench.receive(flood, "flood")
    bench.receive(sync_frame(None), MASTER)
    bench.records.clear()
    bench.advance(20 * CYCLE_NS)
    flood_ns = 100 * (frame_bits(flood) + INTERMISSION_BITS) * BIT_NS
    assert end_of(bench.records, Cob.SYNC) == CYCLE_NS + flood_ns + frame_bits(sync_frame(None)) * BIT_NS


def test_on_the_wall_clock_frames_arrive_when_the_wire_has_carried_them(make_bench: MakeBench) -> None:
    bench = make_bench(clock=Clock.WALL)
    bench.receive(sync_frame(None), MASTER)
    bench.advance(CYCLE_NS)
    bench.records.clear()
    bench.receive(CURRENTS, MASTER)
    assert bench.records == []
    due_ns = bench.next_due_ns
    bench.advance(due_ns)
    assert [(record.time_ns, record.frame) for record in bench.records] == [(due_ns, CURRENTS)]
