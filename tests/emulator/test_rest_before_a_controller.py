"""In lockstep nobody's arm hangs in the air between two controllers: before the next one it has come to rest."""

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol.canopen.frames import Frame, NmtCommand, nmt_frame, sync_frame
from canarm_protocol.cell import load_cell
from canarm_protocol.cell.output_frames import OutputFrames
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
AT_REST_RAD_S = 0.01


def bench_that_has_moved(clock: Clock, last: NmtCommand) -> FaultBench:
    """A bench whose controller has driven joint2 for 0.25 s, and has then ended with an NMT command."""
    bench = FaultBench(CELL, Truth.from_settings(CELL, {}), clock, seed=0)
    bench.start()
    bench.receive(nmt_frame(NmtCommand.START))
    for cycle in range(100):
        if clock is Clock.WALL:
            bench.advance(cycle * CELL.bus.cycle_ns)
        for cob_id, data, *_ in OutputFrames(CELL, card_nodes(CELL)).frames((120, 0), (2, 2)):
            bench.receive(Frame(cob_id, data.ljust(8, b"\0")))
        bench.receive(sync_frame(None))
    bench.receive(nmt_frame(last))
    return bench


def speed_rad_s(bench: FaultBench) -> float:
    return max(abs(joint.speed_rad_s) for joint in bench.world.state())


@pytest.mark.parametrize("last", [NmtCommand.STOP, NmtCommand.PRE_OPERATIONAL])
@pytest.mark.parametrize("first", [NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION])
def test_time_runs_on_until_the_arm_rests_before_a_new_controller_begins(last: NmtCommand, first: NmtCommand) -> None:
    bench = bench_that_has_moved(Clock.SYNC, last)
    assert speed_rad_s(bench) > 0.1
    before_ns, told = bench.time_ns, []
    bench.on_rested = told.append
    bench.receive(nmt_frame(first))
    assert speed_rad_s(bench) < AT_REST_RAD_S
    assert told == [bench.time_ns - before_ns]
    bench.receive(nmt_frame(first))
    assert len(told) == 1, "an arm that rests is waited for"


def test_after_a_power_cycle_there_is_nothing_to_wait_for() -> None:
    bench = bench_that_has_moved(Clock.SYNC, NmtCommand.STOP)
    bench.power_cycle()
    before_ns = bench.time_ns
    bench.receive(nmt_frame(NmtCommand.RESET_NODE))
    assert bench.time_ns == before_ns


def test_on_the_wall_clock_time_passes_by_itself() -> None:
    bench = bench_that_has_moved(Clock.WALL, NmtCommand.STOP)
    before_ns = bench.time_ns
    bench.receive(nmt_frame(NmtCommand.RESET_NODE))
    assert bench.time_ns == before_ns


def test_a_reset_while_the_cards_still_run_stops_no_time() -> None:
    """The master does it to cards that it drives; what it means by that is its own business."""
    bench = bench_that_has_moved(Clock.SYNC, NmtCommand.START)
    before_ns = bench.time_ns
    bench.receive(nmt_frame(NmtCommand.RESET_NODE))
    assert bench.time_ns == before_ns
