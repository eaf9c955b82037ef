"""The bench without a bus, in lockstep: order of events, counting of cycles, heartbeats, PDOs of several nodes."""

import struct

import numpy as np
import pytest

from canarm_emulator.bench.bench import CycleTruth
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame, NmtCommand, heartbeat_frame, nmt_frame, sync_frame, time_frame
from canarm_protocol.canopen.frames import NmtState as State
from tests.emulator.bare_bench import (
    ADC,
    CLOCKWISE,
    COUNTER_CLOCKWISE,
    CYCLE_NS,
    DAC,
    LATCH,
    MASTER,
    MS,
    NOISELESS,
    SCAN_NS,
    START,
    US,
    ids,
    new_bench,
    run_cycles,
    send_outputs,
    take,
    watch,
    write,
)

# Lockstep


def test_at_power_on_every_card_boots_up_in_the_order_of_the_cell() -> None:
    assert take(new_bench()) == [(0, heartbeat_frame(node_id, State.BOOT_UP)) for node_id in (DAC, LATCH, ADC)]


def test_a_lockstep_cycle_is_sync_then_tpdos_then_time() -> None:
    bench = new_bench()
    bench.receive(START)
    take(bench)
    bench.receive(sync_frame(None))
    assert ids(bench) == [(0, 0x080), (SCAN_NS, 0x294), (SCAN_NS, 0x394), (SCAN_NS, 0x100)]
    bench.receive(sync_frame(None))
    end_ns = CYCLE_NS + SCAN_NS
    assert ids(bench) == [(CYCLE_NS, 0x080), (end_ns, 0x294), (end_ns, 0x394), (end_ns, 0x100)]
    assert bench.time_ns == end_ns


def test_time_ends_every_cycle_with_its_virtual_time() -> None:
    bench = new_bench()
    for _ in range(5):
        bench.receive(sync_frame(None))
    assert take(bench)[-1] == (4 * CYCLE_NS, time_frame(4 * CYCLE_NS))


def test_time_stands_still_without_sync() -> None:
    bench = new_bench()
    bench.receive(START)
    for _ in range(100):
        bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
        send_outputs(bench, (1, 2), (1, 2))
    assert bench.time_ns == bench.world.time_ns == 0


def test_what_falls_due_on_the_way_comes_before_the_sync_stamped_with_its_own_time() -> None:
    bench = new_bench()
    write(bench, DAC, 0x1017, 0, struct.pack("<H", 1))
    write(bench, LATCH, 0x1017, 0, struct.pack("<H", 5))
    bench.receive(sync_frame(None))
    take(bench)
    bench.receive(sync_frame(None))
    assert ids(bench) == [(1 * MS, 0x712), (2 * MS, 0x712), (CYCLE_NS, 0x080), (CYCLE_NS, 0x100)]
    bench.receive(sync_frame(None))  # at 5 ms both heartbeats and SYNC meet: heartbeats first, in the order of the cell
    assert ids(bench) == [
        (3 * MS, 0x712),
        (4 * MS, 0x712),
        (5 * MS, 0x712),
        (5 * MS, 0x713),
        (5 * MS, 0x080),
        (5 * MS, 0x100),
    ]


def test_what_falls_due_during_the_scan_comes_before_its_tpdos() -> None:
    bench = new_bench()
    write(bench, LATCH, 0x1017, 0, struct.pack("<H", 3))
    bench.receive(START)
    bench.receive(sync_frame(None))
    take(bench)
    bench.receive(sync_frame(None))
    end_ns = CYCLE_NS + SCAN_NS
    assert ids(bench) == [(CYCLE_NS, 0x080), (3 * MS, 0x713), (end_ns, 0x294), (end_ns, 0x394), (end_ns, 0x100)]


def test_only_mapped_channels_take_conversion_time() -> None:
    bench = new_bench()
    write(bench, ADC, 0x1802, 1, struct.pack("<I", 0x8000_0394))
    bench.receive(START)
    take(bench)
    bench.receive(sync_frame(None))
    assert ids(bench) == [(0, 0x080), (400 * US, 0x294), (400 * US, 0x100)]


def test_inputs_are_what_the_sensors_show() -> None:
    """20 and 0 degrees on 270 degrees and 5 V about 2.5 V, no speed, no current; a pin that is not wired reads 0."""
    bench = new_bench(settings=NOISELESS)
    bench.receive(START)
    bench.receive(sync_frame(None))
    data = {frame.can_id: frame.data for _, frame in take(bench)}
    codes = [value >> 7 for value in struct.unpack("<8h", data[0x294] + data[0x394])]
    angle = [int((2.5 + degrees / 270 * 5) / 5 * 255 + 0.5) for degrees in (20, 0)]
    assert codes == [*angle, 128, 128, 0, 0, 0, 0]


def test_outputs_act_together_at_the_next_sync() -> None:
    bench = new_bench()
    bench.receive(START)
    bench.receive(sync_frame(None))
    send_outputs(bench, (51, 255), (COUNTER_CLOCKWISE, CLOCKWISE))
    assert [joint.command_a for joint in bench.world.state()] == [0.0, 0.0]
    bench.receive(sync_frame(None))
    assert [joint.command_a for joint in bench.world.state()] == pytest.approx([0.3, -1.5])


def test_outputs_of_channels_that_are_not_wired_go_nowhere() -> None:
    bench = new_bench()
    bench.receive(START)
    bench.receive(Frame(0x312, struct.pack("<4h", 0, 0, 0x7F80, 0x7F80)))
    bench.receive(Frame(0x213, b"\xaa"))
    bench.receive(sync_frame(None))
    assert [joint.command_a for joint in bench.world.state()] == [0.0, 0.0]


def test_cycles_are_counted_from_nmt_start_and_begin_anew_at_the_next() -> None:
    bench, seen = new_bench(), []
    bench.on_cycle = seen.append
    bench.receive(sync_frame(None))
    assert bench.cycle == -1
    bench.receive(nmt_frame(NmtCommand.START, DAC))
    bench.receive(sync_frame(None))
    bench.receive(nmt_frame(NmtCommand.START, ADC))  # the rest of the cards: the run has begun already
    bench.receive(sync_frame(None))
    bench.receive(nmt_frame(NmtCommand.PRE_OPERATIONAL))
    bench.receive(sync_frame(None))
    assert bench.cycle == 1
    bench.receive(START)
    bench.receive(sync_frame(None))
    assert [truth.cycle for truth in seen] == [0, 1, 0]
    assert isinstance(seen[0], CycleTruth)


def test_the_truth_of_a_cycle_is_that_at_its_sync() -> None:
    bench, seen = new_bench(), []
    bench.on_cycle = seen.append
    bench.receive(START)
    run_cycles(bench, 50)
    assert [truth.time_ns for truth in seen] == [k * CYCLE_NS for k in range(50)]
    first, last = seen[0].joints, seen[-1].joints
    assert first[0].angle_rad == pytest.approx(np.radians(20.0))
    assert last[0].angle_rad != first[0].angle_rad


def test_nmt_reaches_the_node_that_it_names() -> None:
    bench = new_bench()
    bench.receive(nmt_frame(NmtCommand.START, LATCH))
    assert [slave.state for slave in bench.slaves] == [State.PRE_OPERATIONAL, State.OPERATIONAL, State.PRE_OPERATIONAL]
    bench.receive(nmt_frame(NmtCommand.STOP, 0x55))
    assert bench.slaves[1].state is State.OPERATIONAL


# Heartbeats, and lockstep without its master


def lost_at(bench: FaultBench) -> dict[int, int]:
    return {frame.can_id: time_ns for time_ns, frame in take(bench) if frame.data[:2] == b"\x30\x81"}


def test_a_lost_master_is_noticed_by_every_card_exactly_at_its_own_time() -> None:
    bench = new_bench()
    for node_id, timeout_ms in ((DAC, 100), (LATCH, 101), (ADC, 100)):
        watch(bench, node_id, MASTER, timeout_ms)
    bench.receive(START)
    bench.receive(sync_frame(None))
    bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
    beat_ns = bench.time_ns
    send_outputs(bench, (255, 255), (COUNTER_CLOCKWISE, COUNTER_CLOCKWISE))
    take(bench)
    for _ in range(60):
        bench.receive(sync_frame(None))
    assert lost_at(bench) == {0x92: beat_ns + 100 * MS, 0x93: beat_ns + 101 * MS, 0x94: beat_ns + 100 * MS}
    assert [joint.command_a for joint in bench.world.state()] == [0.0, 0.0]


def test_the_world_runs_on_until_the_cards_have_protected_themselves_and_then_stands_still() -> None:
    bench = new_bench()
    for node_id in (DAC, LATCH, ADC):
        watch(bench, node_id, MASTER, 100)
    bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
    bench.receive(START)
    run_cycles(bench, 4)
    assert bench.is_operational
    left_ns = bench.time_ns
    bench.run_on()
    assert lost_at(bench) == {0x80 + node_id: 100 * MS for node_id in (DAC, LATCH, ADC)}
    assert not bench.is_operational
    assert [joint.command_a for joint in bench.world.state()] == [0.0, 0.0]
    end_ns = bench.time_ns
    assert end_ns == bench.world.time_ns >= left_ns + 600 * MS  # heartbeat time + 0.5 s, and until the arm hangs still
    assert all(abs(joint.speed_rad_s) < 0.01 for joint in bench.world.state())
    bench.receive(sync_frame(None))
    assert bench.time_ns == end_ns
    bench.receive(sync_frame(None))
    assert bench.time_ns == end_ns + CYCLE_NS


def test_running_on_waits_for_a_heartbeat_time_that_is_longer_than_the_cells() -> None:
    bench = new_bench()
    watch(bench, DAC, MASTER, 5_000)
    bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
    take(bench)
    bench.run_on()
    assert lost_at(bench) == {0x92: 5_000 * MS}


def test_a_heartbeat_is_one_byte() -> None:
    bench = new_bench()
    watch(bench, DAC, MASTER, 100)
    for data in (b"", b"\x05\x05"):
        bench.receive(Frame(0x701, data))
    assert bench.next_due_ns > 10**15
    bench.receive(Frame(0x701, b"\x05"))
    assert bench.next_due_ns == 100 * MS


def test_cards_hear_each_others_heartbeats() -> None:
    bench = new_bench()
    watch(bench, DAC, LATCH, 100)
    write(bench, LATCH, 0x1017, 0, struct.pack("<H", 50))
    bench.advance(60 * MS)
    assert bench.next_due_ns == 100 * MS
    write(bench, LATCH, 0x1017, 0, bytes(2))
    take(bench)
    bench.advance(200 * MS)
    assert lost_at(bench) == {0x92: 150 * MS}


def test_a_card_does_not_hear_itself() -> None:
    bench = new_bench()
    watch(bench, DAC, DAC, 100)
    write(bench, DAC, 0x1017, 0, struct.pack("<H", 50))
    bench.advance(60 * MS)
    write(bench, DAC, 0x1017, 0, bytes(2))
    bench.advance(1_000 * MS)
    assert lost_at(bench) == {}


# PDOs of several nodes


def test_one_frame_can_serve_the_rpdos_of_two_cards() -> None:
    bench = new_bench()
    for value in (0x8000_0213, 0x312):
        write(bench, LATCH, 0x1400, 1, struct.pack("<I", value))
    bench.receive(START)
    bench.receive(Frame(0x312, struct.pack("<4h", 0x7FAA, 0, 0, 0)))
    bench.receive(sync_frame(None))
    assert [joint.command_a for joint in bench.world.state()] == pytest.approx([1.5, 0.0])


def test_a_tpdo_of_one_card_can_be_the_rpdo_of_another() -> None:
    """PDO linking: joint 2's potentiometer, at 20 degrees, on the first two DAC channels; type 255 acts at once."""
    bench = new_bench(settings=NOISELESS)
    for index, subindex, data in (
        (0x1401, 1, struct.pack("<I", 0x8000_0312)),
        (0x1401, 2, b"\xff"),
        (0x1401, 1, struct.pack("<I", 0x294)),
    ):
        write(bench, DAC, index, subindex, data)
    bench.receive(START)
    bench.receive(Frame(0x213, bytes((COUNTER_CLOCKWISE,))))
    bench.receive(sync_frame(None))
    assert bench.world.state()[0].command_a == pytest.approx(1.5 * 146 / 255)
