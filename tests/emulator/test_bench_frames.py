"""Frames that the bench does not understand, and its own bus, which never disturbs the robot's."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame, NmtCommand, heartbeat_frame, nmt_frame, sync_frame
from canarm_protocol.canopen.frames import NmtState as State
from canarm_protocol.canopen.sdo import download, upload
from canarm_protocol.cell.bench_objects import bench_pdos, sdo_channel
from canarm_protocol.clock import Clock
from tests.emulator.bare_bench import (
    ADC,
    BENCH,
    CELL,
    DAC,
    LATCH,
    MASTER,
    MS,
    START,
    ids,
    new_bench,
    run_cycles,
    take,
    watch,
    write,
)

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
