"""The bench without a bus: order of events, counting of cycles, both clocks, what never disturbs the robot's bus."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canarm_emulator.bench.bench import CycleTruth, Record
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, heartbeat_frame, nmt_frame, sync_frame, time_frame
from canarm_protocol.canopen.frames import NmtState as State
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.bench_objects import bench_pdos, sdo_channel
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import OutputFrames, card_nodes
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
NODES = card_nodes(CELL)
DAC, LATCH, ADC, MASTER, BENCH = 0x12, 0x13, 0x14, 1, 0x70
US, MS = 1_000, 1_000_000
CYCLE_NS, SCAN_NS = 2_500 * US, 6 * 100 * US  # six channels of the ADC are wired
START = nmt_frame(NmtCommand.START)
NOISELESS = {f"{joint}.noise_lsb": "0" for joint in CELL.joint_names}
CLOCKWISE, COUNTER_CLOCKWISE = 0b01, 0b10


def new_bench(clock: Clock = Clock.SYNC, seed: int = 0, settings: dict[str, str] | None = None) -> FaultBench:
    bench = FaultBench(CELL, Truth.from_settings(CELL, settings or {}), clock, seed)
    bench.start()
    return bench


def take(bench: FaultBench) -> list[tuple[int, Frame]]:
    """What is on the robot's bus since the last look: time and frame."""
    records, bench.records = bench.records, []
    return [(record.time_ns, record.frame) for record in records]


def ids(bench: FaultBench) -> list[tuple[int, int]]:
    return [(time_ns, frame.can_id) for time_ns, frame in take(bench)]


def write(bench: FaultBench, node_id: int, index: int, subindex: int, data: bytes) -> None:
    """One expedited SDO download."""
    bench.receive(Frame(0x600 + node_id, next(download(index, subindex, data))))
    assert bench.records[-1].frame.data[0] == 0x60


def watch(bench: FaultBench, node_id: int, watched: int, timeout_ms: int) -> None:
    write(bench, node_id, 0x1016, 1, struct.pack("<I", watched << 16 | timeout_ms))


def send_outputs(bench: FaultBench, codes: tuple[int, int], directions: tuple[int, int]) -> None:
    for cob_id, data in OutputFrames(CELL, NODES).pack(codes, directions):
        bench.receive(Frame(cob_id, data + bytes(8 - len(data)) if cob_id == 0x312 else data))


def run_cycles(bench: FaultBench, count: int) -> list[Record]:
    """Cycles of a controller that swings both arms."""
    records: list[Record] = []
    for k in range(count):
        swing = COUNTER_CLOCKWISE if k // 40 % 2 else CLOCKWISE
        send_outputs(bench, (60 + k % 16, 30), (swing, swing ^ 0b11))
        bench.receive(sync_frame(None))
        records += bench.records
        bench.records.clear()
    return records


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


# The wall clock


def test_on_the_wall_clock_sync_acts_when_it_comes_and_tpdos_leave_when_the_scan_is_done() -> None:
    bench = new_bench(Clock.WALL)
    bench.receive(START)
    take(bench)
    now_ns = 1_234_567
    bench.advance(now_ns)
    bench.receive(sync_frame(None))
    assert ids(bench) == [(now_ns, 0x080)]
    assert bench.next_due_ns == now_ns + SCAN_NS
    bench.advance(now_ns + SCAN_NS - 1)
    assert take(bench) == []
    bench.advance(now_ns + 10 * MS)
    assert ids(bench) == [(now_ns + SCAN_NS, 0x294), (now_ns + SCAN_NS, 0x394)]
    assert bench.next_due_ns > 10**15


def test_on_the_wall_clock_a_time_gone_by_is_no_error() -> None:
    bench = new_bench(Clock.WALL)
    bench.advance(10 * MS)
    bench.advance(5 * MS)
    assert bench.time_ns == bench.world.time_ns == 10 * MS


def test_on_the_wall_clock_the_world_follows_while_nobody_sends_sync() -> None:
    bench = new_bench(Clock.WALL)
    bench.receive(START)
    send_outputs(bench, (255, 0), (COUNTER_CLOCKWISE, 0))
    bench.receive(sync_frame(None))
    start = bench.world.state()[0].angle_rad
    for now_ns in range(0, 300 * MS, MS):
        bench.advance(now_ns)
    assert bench.world.state()[0].angle_rad > start + 0.1
    assert bench.time_ns - bench.world.time_ns <= 5 * MS


def test_a_sync_that_comes_during_a_scan_is_counted_and_still_brings_the_outputs() -> None:
    bench = new_bench(Clock.WALL)
    bench.receive(START)
    bench.receive(sync_frame(None))
    send_outputs(bench, (255, 0), (COUNTER_CLOCKWISE, 0))
    bench.advance(300 * US)
    take(bench)
    bench.receive(sync_frame(None))
    assert bench.overruns == 1
    assert bench.world.state()[0].command_a == pytest.approx(1.5)
    bench.advance(5 * MS)
    assert ids(bench) == [(300 * US, 0x080), (SCAN_NS, 0x294), (SCAN_NS, 0x394)]
    bench.receive(sync_frame(None))
    assert bench.overruns == 1


def test_on_the_wall_clock_outputs_by_sdo_act_when_they_come() -> None:
    bench = new_bench(Clock.WALL)
    write(bench, LATCH, 0x6200, 1, bytes((COUNTER_CLOCKWISE,)))
    bench.advance(2 * MS)
    write(bench, DAC, 0x6411, 1, struct.pack("<h", 0x7F80))
    assert bench.world.time_ns == 2 * MS
    assert bench.world.state()[0].command_a == pytest.approx(1.5)


def test_on_the_wall_clock_an_event_driven_rpdo_acts_when_it_comes() -> None:
    bench = new_bench(Clock.WALL)
    write(bench, LATCH, 0x1400, 2, b"\xff")
    bench.receive(START)
    bench.advance(2 * MS)
    bench.receive(Frame(0x213, bytes((COUNTER_CLOCKWISE,))))
    assert bench.world.time_ns == 2 * MS


def test_on_the_wall_clock_error_values_act_when_the_heartbeat_is_lost() -> None:
    bench = new_bench(Clock.WALL)
    watch(bench, DAC, MASTER, 100)
    bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
    bench.advance(99 * MS)
    bench.advance(102 * MS)
    assert bench.world.time_ns == 100 * MS


def test_the_heartbeats_of_a_late_look_still_have_their_times() -> None:
    bench = new_bench(Clock.WALL)
    write(bench, DAC, 0x1017, 0, struct.pack("<H", 10))
    take(bench)
    bench.advance(35 * MS)
    assert ids(bench) == [(k * 10 * MS, 0x712) for k in (1, 2, 3)]


# What is not understood


def test_unknown_extended_and_remote_frames_are_counted_and_recorded_and_do_nothing() -> None:
    bench = new_bench()
    bench.receive(START)
    take(bench)
    strange = [
        Frame(0x123, b"\1"),
        Frame(0x080, b"\1", is_extended=True),
        Frame(0x080, b"", is_remote=True),
        Frame(0x000, b"\x02\x00", is_extended=True),
        Frame(0x312, bytes(8), is_extended=True),
        Frame(0x612, bytes(8), is_remote=True),
        Frame(0x1FFF_FFFF, b"", is_extended=True),
        Frame(0x000, b"\x99\x00"),
        Frame(0x000, b""),
    ]
    for frame in strange:
        bench.receive(frame)
    assert take(bench) == [(0, frame) for frame in strange]
    assert bench.ignored_frames == len(strange)
    assert bench.is_operational


IDS = st.sampled_from(
    [0x000, 0x080, 0x100, 0x213, 0x312, 0x612, 0x613, 0x614, 0x701, 0x670, 0x631, 0x270, 0x240, 0x771]
)
FRAMES = st.builds(Frame, IDS | st.integers(0, 0x7FF), st.binary(max_size=8), st.just(False), st.booleans())
COMMANDS = st.builds(nmt_frame, st.sampled_from(list(NmtCommand)), st.sampled_from([0, DAC, LATCH, ADC]))
WRITES = st.builds(
    lambda node_id, index, subindex, value, size: Frame(0x600 + node_id, next(download(index, subindex, value[:size]))),
    st.sampled_from([DAC, LATCH, ADC, BENCH]),
    st.sampled_from(
        [0x1003, 0x1006, 0x1016, 0x1017, 0x1019, 0x1029, 0x1400, 0x1401, 0x1601, 0x1801, 0x1A01, 0x6200, 0x6411]
    ),
    st.integers(0, 4),
    st.binary(min_size=4, max_size=4),
    st.sampled_from([1, 2, 4]),
)


@given(st.sampled_from(Clock), st.lists(st.tuples(FRAMES | COMMANDS | WRITES, st.booleans()), max_size=30))
@settings(max_examples=40)
def test_no_frame_makes_the_bench_fail(clock: Clock, frames: list[tuple[Frame, bool]]) -> None:
    bench = new_bench(clock)
    for frame, is_robots in frames:
        (bench.receive if is_robots else bench.receive_bench)(frame)
        if clock is Clock.WALL:
            bench.advance(bench.time_ns + MS)
        bench.send_telemetry()
    bench.receive(nmt_frame(NmtCommand.RESET_NODE))
    if clock is Clock.WALL:
        bench.advance(bench.time_ns + CELL.bus.boot_ms * MS)
    bench.receive(START)
    bench.receive(sync_frame(None))
    bench.advance(bench.time_ns + MS)
    assert {0x294, 0x394} <= {frame.can_id for _, frame in take(bench)}


# The bench bus, and the same run again


def bench_client(bench: FaultBench) -> None:
    """Everything that a dashboard does, and a few things that it does not."""
    request_id, _ = sdo_channel(BENCH, 2)
    pdos = bench_pdos(CELL)
    for frame in (
        Frame(request_id, next(upload(0x2100, 1))),
        Frame(request_id, next(download(0x1017, 0, b"\x03\x00"))),
        Frame(request_id, next(download(0x1016, 1, struct.pack("<I", 0x71 << 16 | 7)))),
        heartbeat_frame(0x71, State.OPERATIONAL),
        Frame(pdos.reference[0].cob_id, pdos.reference[0].pack(3, 0.25)),
        nmt_frame(NmtCommand.RESET_NODE),
        sync_frame(None),
        Frame(0x312, bytes(8)),
        Frame(0x612, next(download(0x6411, 1, b"\x80\x7f"))),
    ):
        bench.receive_bench(frame, "client")
    bench.send_telemetry()


def test_what_happens_on_the_bench_bus_leaves_no_trace_on_the_robots() -> None:
    quiet, busy = new_bench(), new_bench()
    for bench in (quiet, busy):
        watch(bench, DAC, MASTER, 100)
        bench.receive(heartbeat_frame(MASTER, State.OPERATIONAL))
        bench.receive(START)
    alone, disturbed = [], []
    for _ in range(60):
        alone += run_cycles(quiet, 1)
        bench_client(busy)
        disturbed += run_cycles(busy, 1)
        bench_client(busy)
    assert alone == disturbed
    assert len(alone) > 60 * 6
    assert quiet.world.state() == busy.world.state()
    assert len(busy.bench_records) > 60


def test_the_same_seed_gives_the_same_frames_and_another_one_others() -> None:
    runs = []
    for seed in (1, 1, 2):
        bench = new_bench(seed=seed)
        bench.receive(START)
        runs.append(run_cycles(bench, 100))
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_the_bench_node_keeps_its_own_heartbeat_and_watches_its_client() -> None:
    bench = new_bench()
    request_id, _ = sdo_channel(BENCH, 1)
    bench.receive_bench(Frame(request_id, next(download(0x1017, 0, b"\x01\x00"))))
    bench.receive_bench(Frame(request_id, next(download(0x1016, 1, struct.pack("<I", 0x71 << 16 | 4)))))
    bench.receive_bench(heartbeat_frame(0x71, State.OPERATIONAL))
    bench.bench_records.clear()
    for _ in range(3):
        bench.receive(sync_frame(None))
    sent = [(record.time_ns, record.frame) for record in bench.bench_records]
    assert sent == [
        (1 * MS, heartbeat_frame(BENCH, State.OPERATIONAL)),
        (2 * MS, heartbeat_frame(BENCH, State.OPERATIONAL)),
        (3 * MS, heartbeat_frame(BENCH, State.OPERATIONAL)),
        (4 * MS, heartbeat_frame(BENCH, State.OPERATIONAL)),
        (4 * MS, Frame(0xF0, bytes.fromhex("3081110000000000"))),
        (5 * MS, heartbeat_frame(BENCH, State.OPERATIONAL)),
    ]


def test_telemetry_is_the_truth_at_the_last_sync() -> None:
    bench = new_bench()
    bench.receive(START)
    run_cycles(bench, 30)
    truth, pdos = bench.device.truth, bench_pdos(CELL)
    bench.bench_records.clear()
    bench.send_telemetry()
    data = {record.frame.can_id: record.frame.data for record in bench.bench_records}
    assert pdos.status.unpack(data[pdos.status.cob_id]) == (29,)
    for joint, state in enumerate(truth):
        motion = pdos.truth[joint].unpack(data[pdos.truth[joint].cob_id])
        drive = pdos.drive[joint].unpack(data[pdos.drive[joint].cob_id])
        assert motion == pytest.approx((state.angle_rad, state.speed_rad_s), rel=1e-6)
        assert drive == pytest.approx((state.current_a, state.command_a), rel=1e-6)


def test_cards_listen_to_every_node_that_they_watch() -> None:
    """The second entry of 0x1016 names another card, whose heartbeat ends."""
    bench = new_bench()
    watch(bench, DAC, MASTER, 1000)
    write(bench, DAC, 0x1016, 2, struct.pack("<I", ADC << 16 | 20))
    write(bench, ADC, 0x1017, 0, struct.pack("<H", 10))
    bench.receive(START)
    run_cycles(bench, 8)
    assert 0x80 + DAC not in [can_id for _, can_id in ids(bench)]
    write(bench, ADC, 0x1017, 0, struct.pack("<H", 0))
    end_ns = bench.time_ns
    told = [record for record in run_cycles(bench, 20) if record.frame.can_id == 0x80 + DAC]
    assert [record.frame.data[:2] for record in told] == [b"\x30\x81"]
    assert end_ns < told[0].time_ns <= end_ns + 20 * MS
