"""A bench and a controller joined by lists, with a wire between them that a test can cut, bend and add to."""

from collections.abc import Callable, Iterable, Mapping

import pytest

from canarm.session import make_bench, make_controller
from canarm_controller.run.controller import Controller
from canarm_controller.run.state import State
from canarm_emulator.bench.bench import CycleTruth
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.clock import Clock

Wire = Callable[[Frame], Iterable[Frame]]
"""What arrives in place of a frame."""


def straight(frame: Frame) -> Iterable[Frame]:
    return (frame,)


class Pair:
    """Both sides of one run in virtual time. `to_controller` and `to_bench` are the two directions of the wire."""

    def __init__(
        self,
        cell: Cell | None = None,
        law: str = "pd",
        clock: Clock = Clock.SYNC,
        bench_clock: Clock | None = None,
        ticks: int | None = None,
        listen_ns: int = 0,
        feedforward: str | None = None,
        truth: Mapping[str, str] | None = None,
    ) -> None:
        self.cell = cell or load_cell("konkuk1")
        self.bench: FaultBench = make_bench(self.cell, truth or {}, bench_clock or clock, seed=0)
        self.controller: Controller = make_controller(self.cell, law, "sine", feedforward, clock, ticks, listen_ns)
        self.to_controller: Wire = straight
        self.to_bench: Wire = straight
        self.sent: list[Frame] = []
        """What the controller has sent."""
        self.truths: list[CycleTruth] = []
        self.bench.on_cycle = self.truths.append
        self.bench.start()
        self.deliver()

    def begin(self) -> None:
        self.controller.begin(0)

    def run_until(self, done: Callable[[], bool], rounds: int = 20_000) -> None:
        """Exchange frames until `done`; a run that does not come to its end in time fails."""
        for _ in range(rounds):
            if done():
                return
            self.round()
        raise AssertionError(f"not done after {rounds} rounds: {self.controller.state!r}, {self.controller.reason}")

    def run_to(self, state: State) -> None:
        if self.controller.state is State.IDLE:
            self.begin()
        self.run_until(lambda: self.controller.state is state)

    def run_to_tick(self, tick: int) -> None:
        if self.controller.state is State.IDLE:
            self.begin()
        self.run_until(lambda: self.controller.tick >= tick)

    def run_to_end(self) -> None:
        if self.controller.state is State.IDLE:
            self.begin()
        self.run_until(lambda: self.controller.is_finished)
        self.send()

    def round(self) -> None:
        """What the controller has to say goes to the bench, and the bench's answers come back; else time passes."""
        controller = self.controller
        said = self.send()
        if controller.clock is Clock.WALL and controller.state in (State.RUNNING, State.STOPPING):
            self._cycle_on_the_wall_clock()
        elif not said and controller.deadline_ns is not None:
            if self.bench.clock is Clock.WALL and self.bench.next_due_ns < controller.deadline_ns:
                self.bench.advance(self.bench.next_due_ns)  # cards take their time to boot
            else:
                controller.time_out(controller.deadline_ns)
        self.deliver()

    def send(self) -> bool:
        frames, self.controller.outbox = self.controller.outbox, []
        self.sent += frames
        for frame in frames:
            for arriving in self.to_bench(frame):
                self.bench.receive(arriving, self.controller)
        return bool(frames)

    def deliver(self) -> None:
        records, self.bench.records = self.bench.records, []
        for record in records:
            if record.origin is None:
                for arriving in self.to_controller(record.frame):
                    self.controller.receive(arriving, record.time_ns)

    def _cycle_on_the_wall_clock(self) -> None:
        self.controller.open_cycle(self.bench.time_ns)
        self.send()
        self.bench.advance(self.bench.time_ns + self.cell.bus.cycle_ns)


@pytest.fixture
def pair() -> Pair:
    """A nominal konkuk1 in lockstep under `pd`, before bring-up."""
    return Pair()


@pytest.fixture
def make_pair() -> type[Pair]:
    """For pairs of another kind."""
    return Pair
