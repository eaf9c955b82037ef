"""The bench without a bus on the wall clock: when SYNC, outputs and heartbeats act."""

import struct

import pytest

from canarm_protocol.canopen.frames import Frame, heartbeat_frame, sync_frame
from canarm_protocol.canopen.frames import NmtState as State
from canarm_protocol.clock import Clock
from tests.emulator.bare_bench import (
    COUNTER_CLOCKWISE,
    DAC,
    LATCH,
    MASTER,
    MS,
    SCAN_NS,
    START,
    US,
    ids,
    new_bench,
    send_outputs,
    take,
    watch,
    write,
)

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
