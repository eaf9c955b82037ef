"""The controller's runner: how runs begin, go and end, on both clocks."""

from collections.abc import Callable

import pytest

from canarm.session import make_bench
from canarm_controller.run.state import State
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.clock import Clock
from tests.controller.runner_setup import SYNC, TIME, BenchPort, Setup


@pytest.mark.parametrize("clock", Clock)
def test_a_run_of_so_many_ticks_ends_done(clock: Clock) -> None:
    setup = Setup(clock)
    result = setup.run()
    assert (result.state, result.reason, result.ticks, result.missed) == (State.DONE, None, 400, 0)
    assert setup.states == [State.BRINGING_UP, State.RUNNING, State.STOPPING, State.DONE]
    assert result.note is None
    assert set(result.joints) == {"joint2", "joint3"}


def test_on_the_wall_clock_a_sync_leaves_every_period() -> None:
    setup = Setup(Clock.WALL)
    result = setup.run()
    # Three cards are reset one after the other, and boot in boot_ms = 10 each; 400 cycles and two that stop; the last
    # scan, 100 us for each of six channels.
    assert setup.waited_s == pytest.approx(3 * 0.010 + 402 * 0.0025 + 6 * 100e-6, abs=1e-6)
    assert result.real_time_factor == pytest.approx(1.0, abs=0.01)
    assert result.pacing is not None
    assert (result.late, result.pacing.lateness.max_ns) == (0, 0)


def test_the_assessment_comes_from_the_bench_at_the_end() -> None:
    setup = Setup(Clock.SYNC, ticks=1500)
    joints = setup.run().joints
    scores = setup.bench.assessor.scores
    for figures, score in zip(joints.values(), scores, strict=True):
        assert score.samples == 1500 - 1024
        assert figures.rms_lsb == pytest.approx(score.rms_lsb, rel=1e-6)
        assert figures.max_lsb == pytest.approx(score.max_lsb, rel=1e-6)
        assert figures.peak_current_a == pytest.approx(score.peak_current_a, rel=1e-6)
        assert figures.saturated_cycles == score.saturated_cycles
        assert figures.speed_ripple is None


def test_a_run_that_is_shorter_than_the_settling_time_has_no_error_figures() -> None:
    joints = Setup(Clock.SYNC, ticks=100).run().joints
    assert [figures.rms_lsb for figures in joints.values()] == [None, None]


@pytest.mark.parametrize("clock", Clock)
def test_without_a_bench_bus_there_is_a_note_instead(clock: Clock) -> None:
    setup = Setup(clock, ticks=100)
    setup.bench_port = None
    result = setup.run()
    assert (result.state, result.joints) == (State.DONE, {})
    assert result.note == "no bench bus: the true error is not known here"


@pytest.mark.parametrize("clock", Clock)
def test_a_bench_bus_that_is_lost_never_disturbs_the_run(clock: Clock) -> None:
    setup = Setup(clock)
    sent = setup.bench_port.sent
    setup.bench_port.fails_at = lambda frame: len(sent) > 100
    result = setup.run()
    assert (result.state, result.ticks, result.joints) == (State.DONE, 400, {})
    assert result.note == "bench bus lost: -i fake: lost"


def test_a_bench_node_that_does_not_answer_never_disturbs_the_run() -> None:
    setup = Setup(Clock.SYNC, ticks=100)
    setup.bench_port.drop = lambda frame: True
    result = setup.run()
    assert (result.state, result.joints) == (State.DONE, {})
    assert result.note.startswith("no bench node answers")


@pytest.mark.parametrize("clock", Clock)
def test_nobody_on_the_bus_fails_within_seconds(clock: Clock) -> None:
    setup = Setup(clock, listen_ns=250_000_000)
    setup.robot_port.drop = lambda frame: True
    result = setup.run()
    assert result.state is State.FAILED
    assert result.reason.startswith("card 'dac' (node 0x12) does not answer")
    assert setup.waited_s < 5.0


@pytest.mark.parametrize("clock", Clock)
@pytest.mark.parametrize(
    ("phase", "fails_at"),
    [
        ("reset", lambda frame: frame.can_id == 0),
        ("configuration", lambda frame: frame.can_id == 0x612 and frame.data[1:3] == b"\x16\x10"),
        ("start", lambda frame: frame == Frame(0, b"\x01\x13")),
        ("run", lambda frame: frame.can_id == SYNC and frame.data == b"\x64"),
        ("stop", lambda frame: frame == Frame(0, b"\x02\x12")),
    ],
)
def test_a_bus_that_is_lost_fails_the_run_in_every_phase(
    clock: Clock, phase: str, fails_at: Callable[[Frame], bool]
) -> None:
    setup = Setup(clock, ticks=200)
    setup.robot_port.fails_at = fails_at
    result = setup.run()
    assert setup.states[-1] is result.state
    if phase != "stop":
        assert (result.state, result.reason) == (State.FAILED, "bus lost: -i fake: lost")


def test_lockstep_without_time_ends_after_ten_seconds() -> None:
    setup = Setup(Clock.SYNC)
    setup.robot_port.drop = lambda frame: frame.can_id == TIME and setup.controller.tick == 50
    result = setup.run()
    assert (result.state, result.reason) == (State.FAILED, "no TIME from the emulator within 10 s of SYNC 50")
    assert setup.waited_s < 11.0


def test_lockstep_without_time_ends_even_if_others_keep_talking() -> None:
    setup = Setup(Clock.SYNC)
    setup.robot_port.drop = lambda frame: frame.can_id == TIME and setup.controller.tick == 50
    setup.robot_port.noise = Frame(0x123, b"\x01")
    receive = setup.robot_port.receive

    def noisy(timeout_s: float) -> list[tuple[int, Frame]]:
        setup.clock.now_ns += 1_000_000
        return receive(0.0)

    setup.robot_port.receive = noisy
    result = setup.run()
    assert result.reason == "no TIME from the emulator within 10 s of SYNC 50"


@pytest.mark.parametrize("pace", [1.0, 0.1, 4.0])
def test_paced_lockstep_never_runs_ahead_of_the_wall_clock_and_sends_the_same(pace: float) -> None:
    fast, paced = Setup(Clock.SYNC, ticks=100), Setup(Clock.SYNC, ticks=100)
    assert fast.run().state is State.DONE
    result = paced.run(pace=pace)
    assert result.real_time_factor == pytest.approx(pace, rel=0.02)
    assert paced.robot_port.sent == fast.robot_port.sent


@pytest.mark.parametrize("clock", Clock)
def test_a_request_to_stop_is_a_safe_stop(clock: Clock) -> None:
    setup = Setup(clock, ticks=None)
    setup.should_stop = lambda: "SIGTERM" if setup.controller.tick >= 100 else None
    result = setup.run()
    assert (result.state, result.reason) == (State.FAILED, "interrupted: SIGTERM")
    assert [joint.command_a for joint in setup.bench.world.state()] == [0.0, 0.0]
    assert setup.robot_port.sent[-1] == Frame(0, b"\x80\x14")
    assert setup.controller.tick <= 100 + 802


def test_a_request_to_stop_while_cards_are_looked_for_ends_at_once() -> None:
    setup = Setup(Clock.SYNC, listen_ns=250_000_000)
    setup.robot_port.drop = lambda frame: True
    setup.should_stop = lambda: "SIGINT"
    result = setup.run()
    assert (result.state, result.reason) == (State.FAILED, "interrupted: SIGINT")
    assert setup.waited_s <= 0.2


def test_a_start_that_cannot_be_leaves_the_cards_stopped() -> None:
    setup = Setup(Clock.SYNC)
    setup.bench = make_bench(
        setup.cell, {"joint2.initial_deg": "129", "joint2.potentiometer_offset_deg": "5"}, Clock.SYNC, 0
    )
    setup.robot_port = BenchPort(setup.bench, setup.clock)
    setup.bench_port = None
    setup.bench.start()
    setup.bench.records.clear()
    result = setup.run()
    assert result.state is State.FAILED
    assert "outside limits_deg" in result.reason
    assert setup.robot_port.sent[-6:] == [
        Frame(0, bytes((command, node_id))) for command in (0x02, 0x80) for node_id in (0x12, 0x13, 0x14)
    ]
