"""The controller's runner on ports that a test holds in its hands, and on a clock that only waiting moves."""

import math
from collections.abc import Callable, Sequence

from canarm.session import make_bench, make_controller
from canarm_controller.laws.base import Cycle
from canarm_controller.run.runner import Runner, RunResult
from canarm_controller.run.state import State
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.clock import Clock
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort, Discarded
from tests.hooked_law import hook_law

SYNC, TIME, HEARTBEAT = 0x080, 0x100, 0x700


class FakeClock:
    """Monotonic ns; waiting for nothing is what makes it go on."""

    def __init__(self) -> None:
        self.now_ns = 5_000_000_000

    def __call__(self) -> int:
        return self.now_ns


class BenchPort(BusPort):
    """One bus of an emulated bench. `fails_at` raises on it, `drop` takes frames out of what it brings."""

    description = "-i fake"

    def __init__(self, bench: FaultBench, clock: FakeClock, is_robot: bool = True) -> None:
        self.discarded = Discarded()
        self._bench, self._clock, self._is_robot = bench, clock, is_robot
        self._start_ns = clock.now_ns
        self.drop: Callable[[Frame], bool] = lambda frame: False
        self.noise: Frame | None = None
        self.fails_at: Callable[[Frame], bool] = lambda frame: False
        self.sent: list[Frame] = []

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.sent.append(frame)
            if self.fails_at(frame):
                raise BusError(f"{self.description}: lost")
            (self._bench.receive if self._is_robot else self._bench.receive_bench)(frame, self)

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        bench, clock = self._bench, self._clock
        found = self._take()
        if not found and timeout_s > 0.0:
            # Wait for the bench's next frame, or in vain.
            limit_ns = clock.now_ns + round(timeout_s * 1e9)
            if bench.clock is Clock.WALL and self._is_robot:
                due_ns = min(max(bench.next_due_ns + self._start_ns, clock.now_ns), limit_ns)
                bench.advance(due_ns - self._start_ns)
                limit_ns = due_ns
            clock.now_ns = limit_ns
            found = self._take()
        if self.noise is not None:
            found.append((0, self.noise))
        return found

    def _take(self) -> list[tuple[int, Frame]]:
        bench = self._bench
        name = "records" if self._is_robot else "bench_records"
        records = getattr(bench, name)
        setattr(bench, name, [])
        return [(r.time_ns, r.frame) for r in records if r.origin is None and not self.drop(r.frame)]

    def fileno(self) -> int | None:
        return None

    def close(self) -> None:
        """Nothing to give back."""


class Setup:
    """A bench, a controller and the runner between them."""

    def __init__(self, clock: Clock, ticks: int | None = 400, law: str = "mras", listen_ns: int = 0) -> None:
        self.cell = load_cell("konkuk1")
        self.clock = FakeClock()
        self.bench = make_bench(self.cell, {}, clock, 0)
        self.controller = make_controller(self.cell, law, "sine", None, clock, ticks, listen_ns)
        self.robot_port = BenchPort(self.bench, self.clock)
        self.bench_port: BenchPort | None = BenchPort(self.bench, self.clock, is_robot=False)
        self.states: list[State] = []
        self.should_stop: Callable[[], str | None] = lambda: None
        self.bench.start()
        self.bench.records.clear()

    def sleep(self, seconds: float) -> None:
        self.clock.now_ns += round(seconds * 1e9)

    def slow_law(self, takes_s: Callable[[int], float]) -> None:
        """Let the law take so long in each cycle."""
        loop = self.controller.loop
        law = loop.law

        def slow(cycle: Cycle) -> Sequence[float]:
            self.sleep(takes_s(cycle.tick))
            return law.update(cycle)

        hook_law(loop, slow)

    def run(self, spin_ns: int = 0, pace: float = math.inf) -> RunResult:
        self.started_ns = self.clock.now_ns
        runner = Runner(
            self.controller,
            self.robot_port,
            self.bench_port,
            self.states.append,
            lambda: self.should_stop(),
            self.clock,
            spin_ns,
            pace,
            sleep=self.sleep,
        )
        return runner.run()

    @property
    def waited_s(self) -> float:
        return (self.clock.now_ns - self.started_ns) * 1e-9
