"""After a lost controller the arm comes to rest; off and on again brings back the state of the beginning."""

import pytest

from canarm.session import make_bench, make_controller
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell import bench_objects as objects
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.faults.script import parse_faults

CELL = load_cell("konkuk1")


def run(bench: FaultBench, ticks: int) -> None:
    """A controller takes the bench so far, and is then lost without a word."""
    controller = make_controller(CELL, "pd", "sine", None, Clock.SYNC)
    controller.begin(0)
    while controller.controlled_ticks < ticks:
        assert not controller.is_finished, controller.reason
        frames, controller.outbox = controller.outbox, []
        for frame in frames:
            bench.receive(frame, controller)
        if not frames and controller.deadline_ns is not None:
            controller.time_out(controller.deadline_ns)
        records, bench.records = bench.records, []
        for record in records:
            if record.origin is None:
                controller.receive(record.frame, record.time_ns)


@pytest.fixture
def bench() -> FaultBench:
    bench = make_bench(CELL, {}, Clock.SYNC, 0)
    bench.start()
    return bench


@pytest.mark.parametrize("ticks", [300, 520, 700])
def test_after_a_lost_controller_time_runs_on_until_the_arm_rests(bench: FaultBench, ticks: int) -> None:
    run(bench, ticks)
    assert max(abs(joint.speed_rad_s) for joint in bench.world.state()) > 0.05
    bench.run_on()
    assert max(abs(joint.speed_rad_s) for joint in bench.world.state()) < 0.01
    run(bench, 400)  # the next controller finds nothing to complain of


def test_an_arm_without_friction_does_not_keep_time_running_for_ever() -> None:
    still = {f"joint{number}.{key}": "0" for number in (2, 3) for key in ("viscous", "coulomb")}
    bench = make_bench(CELL, still, Clock.SYNC, 0)
    bench.start()
    run(bench, 300)
    before_ns = bench.time_ns
    bench.run_on()
    assert 30e9 <= bench.time_ns - before_ns <= 31e9


def test_off_and_on_again_is_the_state_of_the_beginning(bench: FaultBench) -> None:
    parked = [joint.angle_rad for joint in bench.world.state()]
    bench.inject(parse_faults('[[set]]\n[[set.fault]]\ntap = "joint2.tachometer"\nfault = "stuck"\n'))
    run(bench, 300)
    setter = bench.device.setter(objects.POWER_CYCLE, 0)
    assert setter is not None
    setter(1)
    assert [joint.angle_rad for joint in bench.world.state()] == parked
    assert [(joint.speed_rad_s, joint.current_a, joint.command_a) for joint in bench.world.state()] == [(0, 0, 0)] * 2
    assert bench.faults.status() == []
    assert not bench.is_operational
    boots = [record.frame for record in bench.records if record.frame.can_id & 0x780 == 0x700]
    assert boots[-3:] == [Frame(0x700 + node.node_id, b"\0") for node in bench.slaves]
    run(bench, 400)


def test_the_figures_of_a_run_outlast_the_power_cycle_that_ends_it(bench: FaultBench) -> None:
    run(bench, 300)
    reached = [score.peak_current_a for score in bench.assessor.scores]
    bench.power_cycle()
    assert [score.peak_current_a for score in bench.assessor.scores] == reached
    assert min(reached) > 0.1
    run(bench, 1)
    assert [score.peak_current_a for score in bench.assessor.scores] != reached
