"""On the wall clock cycles are late, left out or without inputs: no sensor is blamed, and one that fails still is."""

import random
import struct
from collections.abc import Callable
from typing import Any

import pytest

from canarm_controller.run.state import State
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.clock import Clock

INPUTS, SHIFT, JOINT3_SPEED = 0x294, 7, 3
PERIOD_NS = 2_500_000
NOT_THE_SENSORS = {"inputs-missing", "inputs-late", "inputs-repeated", "deadline-missed"}


class BusyMachine:
    """Drives a pair on the wall clock of a machine that is busy: TPDOs and SYNCs fall out, SYNCs are late."""

    def __init__(self, pair: Any, seed: int) -> None:
        self.pair, self._random = pair, random.Random(seed)
        self._silent_cycles = self._since_late = 0
        self.is_busy = True
        self.distort: Callable[[Frame], Frame] = lambda frame: frame
        pair.to_controller = self._wire
        pair.run_to(State.RUNNING)

    def _wire(self, frame: Frame) -> tuple[Frame, ...]:
        if self._silent_cycles > 0 and frame.can_id in (0x294, 0x394):
            return ()
        return (self.distort(frame),)

    def cycle(self) -> None:
        """One period, or what becomes of it: of 100 cycles about 20 have no inputs, in gaps of up to 15."""
        pair, draw = self.pair, self._random
        self._silent_cycles -= 1
        if self.is_busy and self._silent_cycles < -20 and draw.random() < 0.04:
            self._silent_cycles = draw.randint(1, 15)
        late_ns = 0
        self._since_late += 1
        if self.is_busy and self._since_late > 40 and draw.random() < 0.02:  # cards listen for our heartbeat meanwhile
            self._since_late = 0
            late_ns = draw.randrange(2 * PERIOD_NS, 50_000_000)  # SYNCs left out
        elif draw.random() < 0.1:
            late_ns = draw.randrange(PERIOD_NS)
        if late_ns:
            pair.bench.advance(pair.bench.time_ns + late_ns)
            pair.deliver()
        pair.controller.open_cycle(pair.bench.time_ns)
        pair.send()
        pair.bench.advance(pair.bench.time_ns + PERIOD_NS)
        pair.deliver()

    def run(self, seconds: float) -> None:
        """Until the time or the run is over."""
        end_ns = self.pair.bench.time_ns + round(seconds * 1e9)
        while self.pair.bench.time_ns < end_ns and self.pair.controller.state is State.RUNNING:
            self.cycle()

    def stall(self, span_ns: int, is_answered_before: bool) -> None:
        """The whole machine stands still after a SYNC. The robot goes on with the currents that it was told last.

        The emulator has taken the SYNC before it, or takes it afterwards; the controller hears the answer afterwards.
        """
        pair, held = self.pair, []
        pair.controller.open_cycle(pair.bench.time_ns)
        if is_answered_before:
            pair.send()
            pair.bench.advance(pair.bench.time_ns + PERIOD_NS // 2)
            held, pair.bench.records = pair.bench.records, []
        pair.bench.advance(pair.bench.time_ns + span_ns)
        if not is_answered_before:
            pair.send()
            pair.bench.advance(pair.bench.time_ns + PERIOD_NS // 2)
        pair.controller.open_cycle(pair.bench.time_ns)
        pair.send()
        heard_ns = pair.bench.time_ns + PERIOD_NS // 2
        pair.bench.records = [record._replace(time_ns=heard_ns) for record in held] + pair.bench.records
        pair.bench.advance(pair.bench.time_ns + PERIOD_NS)
        pair.deliver()


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("law", ["mras", "pd"])
def test_ten_seconds_of_gaps_never_look_like_a_broken_sensor(make_pair, law: str, seed: int) -> None:
    machine = BusyMachine(make_pair(law=law, clock=Clock.WALL), seed)
    machine.run(10.0)
    controller = machine.pair.controller
    assert controller.reason is None
    assert {str(each) for each in controller.detections if each.detector not in NOT_THE_SENSORS} == set()
    assert "inputs-missing" in {each.detector for each in controller.detections}


@pytest.mark.parametrize("is_answered_before", [False, True])
@pytest.mark.parametrize("span_ms", [20, 45, 65])
def test_a_machine_that_stands_still_for_a_moment_accuses_nobody(make_pair, span_ms: int, is_answered_before) -> None:
    """The arm is at 1 rad/s and more, and turns by several steps of its potentiometers meanwhile."""
    machine = BusyMachine(make_pair(law="mras", clock=Clock.WALL), 0)
    machine.is_busy = False
    machine.run(3.0)
    for _ in range(8):
        machine.stall(span_ms * 1_000_000, is_answered_before)
        machine.run(0.7)
    controller = machine.pair.controller
    assert controller.reason is None
    assert {str(each) for each in controller.detections if each.detector not in NOT_THE_SENSORS} == set()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_stuck_tachometer_is_found_between_the_gaps(make_pair, seed: int) -> None:
    machine = BusyMachine(make_pair(law="mras", clock=Clock.WALL), seed)
    machine.run(4.0)
    held: list[int] = []

    def stuck(frame: Frame) -> Frame:
        if frame.can_id != INPUTS:
            return frame
        codes = list(struct.unpack(f"<{len(frame.data) // 2}h", frame.data))
        held.append(codes[JOINT3_SPEED])
        codes[JOINT3_SPEED] = held[0]
        return frame._replace(data=struct.pack(f"<{len(codes)}h", *codes))

    machine.distort = stuck
    before = machine.pair.controller.tick
    machine.run(1.0)
    found = [each for each in machine.pair.controller.detections if each.detector.startswith("tachometer-")]
    assert found[0].where == "joint3"
    assert found[0].tick - before <= 80
