"""The controller's runner where something takes too long: the machine, the law, the bus, or the disk."""

from collections.abc import Callable

import pytest

from canarm_controller.run.state import State
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.clock import Clock
from tests.controller.runner_setup import Setup


def test_a_slow_machine_makes_paced_lockstep_slower_and_nothing_is_missed_or_made_up_for_in_a_rush() -> None:
    setup = Setup(Clock.SYNC, ticks=400)
    setup.slow_law(lambda tick: 2.0 if tick == 100 else 0.0)
    result = setup.run(pace=1.0)
    assert (result.state, result.missed, setup.controller.detections) == (State.DONE, 0, [])
    assert setup.waited_s == pytest.approx(403 * 0.0025 + 2.0, abs=0.12)


def test_a_law_that_needs_three_seconds_once_goes_on_in_lockstep() -> None:
    setup = Setup(Clock.SYNC)
    setup.slow_law(lambda tick: 3.0 if tick == 200 else 0.0)
    result = setup.run()
    assert (result.state, result.reason, result.ticks) == (State.DONE, None, 400)


def test_a_law_slower_than_the_cycle_is_named_as_the_reason_on_the_wall_clock() -> None:
    setup = Setup(Clock.WALL)
    setup.slow_law(lambda tick: 0.010)
    result = setup.run()
    assert result.starved.startswith("the law took up to 10 ms a cycle: ")
    assert {each.where for each in setup.controller.detections} == {None}, "no card is blamed for it"
    assert result.pacing.law.summary()["max_us"] == pytest.approx(10_000, rel=0.01)


def test_what_a_slow_law_has_caused_is_not_blamed_on_a_card() -> None:
    setup = Setup(Clock.WALL)
    setup.slow_law(lambda tick: 3.0 if tick == 200 else 0.0)
    receive = setup.robot_port.receive

    def with_an_emergency(timeout_s: float) -> list[tuple[int, Frame]]:
        missed_heartbeat = [(0, Frame(0x092, bytes.fromhex("3081110000000000")))]
        return receive(timeout_s) + (missed_heartbeat if setup.controller.tick == 201 else [])

    setup.robot_port.receive = with_an_emergency
    result = setup.run()
    assert result.reason.startswith("deadline-missed: the law took up to 3 s a cycle: 1199 cycles")
    assert result.reason.endswith("; card-emergency followed from it")
    assert {each.where for each in setup.controller.detections} == {None}, "a card stands in the list of detections"


def test_a_machine_that_is_too_busy_is_named_and_no_sensor_is_blamed_for_it() -> None:
    setup = Setup(Clock.WALL, ticks=2000)
    receive, calls = setup.robot_port.receive, 0

    def starved(timeout_s: float) -> list[tuple[int, Frame]]:
        nonlocal calls
        calls += 1
        if setup.controller.state is State.RUNNING and calls % 3 == 0:
            setup.clock.now_ns += 9_000_000
        return receive(timeout_s)

    setup.robot_port.receive = starved
    result = setup.run()
    assert result.starved.startswith("this machine kept the controller waiting: ")
    blamed = {each.detector for each in setup.controller.detections if each.where is not None}
    assert blamed <= {"inputs-late", "inputs-repeated"}, "before enough cycles were lost to call it starvation"
    assert result.reason is None or result.reason.startswith(
        "deadline-missed: this machine kept the controller waiting"
    )


def test_a_stall_of_the_machine_is_counted_as_missed_cycles() -> None:
    setup = Setup(Clock.WALL)
    stalls = []

    def stall() -> None:
        if setup.controller.tick == 100 and not stalls:
            stalls.append(setup.clock.now_ns)
            setup.clock.now_ns += 26_000_000

    setup.controller.on_tick = stall
    result = setup.run()
    assert (result.state, result.ticks) == (State.DONE, 400)
    # Inputs are complete 0.6 ms after SYNC; 26.6 ms after it the next deadline is 24.1 ms ago: nine whole periods.
    assert (result.missed, result.late) == (9, 1)
    assert result.pacing.lateness.max_ns == pytest.approx(24_100_000, abs=100_000)


def suspend(setup: Setup, at_tick: int, span_ns: int, with_emulator: bool) -> None:
    """The clock jumps in the middle of a cycle; the emulator leaves the jump out of its time, or lives through it."""
    done = []

    def jump() -> None:
        if setup.controller.tick == at_tick and not done:
            done.append(True)
            setup.clock.now_ns += span_ns
            if with_emulator:
                setup.robot_port._start_ns += span_ns

    setup.controller.on_tick = jump


def test_a_machine_that_slept_for_minutes_goes_on_where_it_was() -> None:
    setup = Setup(Clock.WALL)
    suspend(setup, at_tick=100, span_ns=180_000_000_000, with_emulator=True)
    result = setup.run()
    assert (result.state, result.reason, result.ticks) == (State.DONE, None, 400)
    # 180 s are 72000 periods. Inputs are complete 0.6 ms after SYNC, so that the deadline after it passed 1.9 ms later.
    assert (result.pacing.stalls, result.pacing.late, result.pacing.missed) == (1, 1, 71_999)
    assert setup.controller.missed == 0
    assert setup.controller.tick == 402  # ticks are cycles, not time: the trajectory goes on where it was


@pytest.mark.slow
def test_a_controller_alone_that_slept_for_minutes_finds_its_cards_safe_and_stops() -> None:
    setup = Setup(Clock.WALL, ticks=None)
    suspend(setup, at_tick=100, span_ns=180_000_000_000, with_emulator=False)
    result = setup.run()
    assert result.state is State.FAILED
    assert result.reason.startswith("deadline-missed: this machine kept the controller waiting: 71999 cycles")
    assert result.reason.endswith("; card-emergency followed from it")
    assert {each.where for each in setup.controller.detections} == {None}, "a card stands in the list of detections"
    assert result.pacing.stalls == 1
    assert [joint.command_a for joint in setup.bench.world.state()] == [0.0, 0.0]
    assert setup.waited_s < 180.0 + 4.0


class SlowWay:
    """Delivers what a port brings so much later, while `is_slow`."""

    def __init__(self, setup: Setup, delay_ns: int, is_slow: Callable[[], bool]) -> None:
        self._clock, self._receive = setup.clock, setup.robot_port.receive
        self._delay_ns, self._is_slow = delay_ns, is_slow
        self._held: list[tuple[int, tuple[int, Frame]]] = []
        setup.robot_port.receive = self.receive

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        end_ns = self._clock.now_ns + round(timeout_s * 1e9)
        while True:
            now_ns = self._clock.now_ns
            wake_ns = min([end_ns, *(due_ns for due_ns, _ in self._held)])
            found = self._receive(max(wake_ns - now_ns, 0) * 1e-9)
            now_ns = self._clock.now_ns
            delay_ns = self._delay_ns if self._is_slow() else 0
            self._held += [(now_ns + delay_ns, stamped) for stamped in found]
            ready = [stamped for due_ns, stamped in self._held if due_ns <= now_ns]
            self._held = [(due_ns, stamped) for due_ns, stamped in self._held if due_ns > now_ns]
            if ready or now_ns >= end_ns:
                return ready


def test_inputs_that_come_after_the_next_sync_are_missed_once_and_then_stand_for_its_own() -> None:
    """TPDOs carry no number: from the second cycle on, those of the cycle before are taken for this one's."""
    setup = Setup(Clock.WALL)
    SlowWay(setup, 2_200_000, lambda: 100 <= setup.controller.tick < 200)
    result = setup.run()
    assert (result.state, result.reason, result.ticks) == (State.DONE, None, 400)
    assert setup.controller.missed == 1
    assert (result.late, result.pacing.missed) == (0, 0)
    # 0.6 ms of scan and 2.2 ms of delay are 0.3 ms more than a period.
    assert result.pacing.answer.percentile_us(10.0) == pytest.approx(300.0, rel=1 / 32)
    assert result.pacing.answer.percentile_us(50.0) == pytest.approx(600.0, rel=1 / 32)


@pytest.mark.parametrize(("cycles", "state"), [(15, State.DONE), (16, State.FAILED)])
def test_inputs_that_stay_away_are_counted_and_fatal_at_the_limit_of_the_cell(cycles: int, state: State) -> None:
    setup = Setup(Clock.WALL)
    assert setup.cell.supervision.missing_cycles == 16
    setup.robot_port.drop = lambda frame: frame.can_id in (0x294, 0x394) and 100 <= setup.controller.tick < 100 + cycles
    result = setup.run()
    assert (result.state, setup.controller.missed) == (state, cycles)
    if state is State.FAILED:
        assert result.reason == (
            "inputs-missing: no TPDO 0x294 of node 0x14 and TPDO 0x394 of node 0x14 for 16 cycles: a busy machine, "
            "or a broken line? In lockstep (--clock sync) a busy machine does no harm"
        )


def test_on_the_wall_clock_outputs_leave_before_the_cycle_is_recorded_and_reported() -> None:
    setup = Setup(Clock.WALL, ticks=50)
    sent = setup.robot_port.sent
    last = []
    setup.controller.on_tick = lambda: last.append(sent[-1].can_id)
    setup.run()
    assert set(last) <= {0x213, 0x312}  # RPDOs of latch and DAC card


def test_in_lockstep_the_next_sync_leaves_before_the_cycle_is_recorded_and_reported() -> None:
    """The emulator computes while the controller writes; every tick is told once, with its own reference."""
    setup = Setup(Clock.SYNC, ticks=50)
    sent, told = setup.robot_port.sent, []
    setup.controller.on_tick = lambda: told.append(
        (setup.controller.loop.cycle.tick, sum(frame.can_id == 0x080 for frame in sent), sent[-1].can_id)
    )
    setup.run()
    assert told == [(tick, tick + 2, 0x080) for tick in range(50)]


def test_in_lockstep_a_full_disk_stops_the_robot_though_the_next_sync_has_left() -> None:
    setup = Setup(Clock.SYNC, ticks=50)

    def record() -> None:
        if setup.controller.loop.cycle.tick == 20:
            raise OSError("no space left on device")

    setup.controller.on_tick = record
    result = setup.run()
    assert (result.state, result.reason) == (State.FAILED, "recording-failed: no space left on device")
    assert result.ticks == 21


def test_a_recording_that_takes_its_time_is_no_computing_time() -> None:
    setup = Setup(Clock.WALL, ticks=50)

    def record() -> None:
        setup.clock.now_ns += 900_000

    setup.controller.on_tick = record
    result = setup.run()
    assert result.missed == 0
    assert (result.pacing.computing.count, result.pacing.computing.max_ns) == (50, 0)


def test_the_last_microseconds_before_a_deadline_are_polled_where_that_is_wanted() -> None:
    setup = Setup(Clock.WALL, ticks=50)
    receive, waits = setup.robot_port.receive, []

    def polled(timeout_s: float) -> list[tuple[int, Frame]]:
        setup.clock.now_ns += 10_000  # a poll takes its time, or spinning would never end here
        waits.append(timeout_s)
        return receive(timeout_s)

    setup.robot_port.receive = polled
    result = setup.run(spin_ns=200_000)
    assert (result.state, result.missed, result.late) == (State.DONE, 0, 0)
    assert max(wait for wait in waits if wait < 0.0025) <= 0.0023
    # 200 us are 20 polls of 10 us.
    assert waits.count(0.0) == pytest.approx(20 * 53, rel=0.15)


def test_a_machine_that_is_always_late_still_reads_its_inputs() -> None:
    """Every cycle takes longer than its period, and yet nothing is lost that was received."""
    setup = Setup(Clock.WALL)
    setup.bench_port = None

    def slow() -> None:
        setup.clock.now_ns += 3_000_000
        setup.bench.advance(setup.clock.now_ns - setup.robot_port._start_ns)

    setup.controller.on_tick = slow
    result = setup.run()
    assert (result.state, result.reason) == (State.DONE, None)
    assert setup.controller.missed < 8
    # 3 ms of work a cycle: 400 cycles take the time of 480 periods.
    assert result.missed == pytest.approx(80, abs=2)
    assert result.late >= 390
