"""A clock that is set by hand, a port whose frames are put in by hand, frames laid out as the cell's bench says, and a
real bench to talk to.
"""

import asyncio
import inspect
from collections.abc import Sequence

import pytest

from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.robot.truth import Truth
from canarm_protocol import clock as clocks
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.cell.bench_objects import bench_pdos
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import Cell
from canarm_protocol.errors import BusError
from canarm_protocol.transport.port import BusPort, Discarded

CYCLE_NS = 2_500_000


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine, in an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    arguments = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in arguments}))
    return True


class Clock:
    """Wall time in ns that passes only when a test says so."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


class FakePort(BusPort):
    """Gives the frames of `arriving` once, keeps what is sent; `is_broken` makes every use fail as a lost bus does."""

    def __init__(self) -> None:
        self.description = "-i fake -c bench"
        self.discarded = Discarded()
        self.arriving: list[tuple[int, Frame]] = []
        self.sent: list[Frame] = []
        self.is_broken = False
        self.is_closed = False

    def send(self, frames: Sequence[Frame]) -> None:
        self._check()
        self.sent += frames

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        assert timeout_s == 0.0, "the dashboard must not wait for the bus"
        self._check()
        frames, self.arriving = self.arriving, []
        return frames

    def fileno(self) -> int | None:
        return None

    def close(self) -> None:
        self.is_closed = True

    def _check(self) -> None:
        if self.is_broken:
            raise BusError(f"{self.description}: the server closed the connection")


class Wire:
    """Frames of the bench node and of a controller, by what they say; all joints alike unless told otherwise."""

    def __init__(self, cell: Cell) -> None:
        self.pdos = bench_pdos(cell)
        self.joints = len(cell.joints)

    def telemetry(self, cycle: int, angle_rad: float = 0.0, command_a: float = 0.0) -> list[tuple[int, Frame]]:
        frames = [Frame(self.pdos.status.cob_id, self.pdos.status.pack(cycle))]
        for truth, drive in zip(self.pdos.truth, self.pdos.drive, strict=True):
            frames.append(Frame(truth.cob_id, truth.pack(angle_rad, 0.5)))
            frames.append(Frame(drive.cob_id, drive.pack(0.25, command_a)))
        return [(cycle * CYCLE_NS, frame) for frame in frames]

    def reference(self, tick: int, angle_rad: float = 0.0) -> list[tuple[int, Frame]]:
        return [(tick * CYCLE_NS, Frame(layout.cob_id, layout.pack(tick, angle_rad))) for layout in self.pdos.reference]

    def report(self, tick: int, late: int, state: int) -> list[tuple[int, Frame]]:
        layout = self.pdos.controller
        return [(tick * CYCLE_NS, Frame(layout.cob_id, layout.pack(tick, late, state)))]


@pytest.fixture
def cell() -> Cell:
    return load_cell("konkuk1")


@pytest.fixture
def wire(cell: Cell) -> Wire:
    return Wire(cell)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def port() -> FakePort:
    return FakePort()


class BenchOnABus(BusPort):
    """The bench bus of a real bench, without a socket: what is sent is done at once, the answers are there to read.

    Time stands still (lockstep without SYNC). `is_silent` makes the bench hear nothing, `is_broken` the bus be lost.
    """

    def __init__(self, cell: Cell) -> None:
        self.description = "-i loop -c bench"
        self.discarded = Discarded()
        self.bench = FaultBench(cell, Truth.from_settings(cell, {}), clocks.Clock.SYNC, seed=0)
        self.bench.start()
        self.bench.bench_records.clear()
        self.is_silent = self.is_broken = self.is_closed = False
        self.requests: list[int] = []
        """Objects whose transfers were begun by SDO."""

    def send(self, frames: Sequence[Frame]) -> None:
        self._check()
        for frame in frames:
            if 0x600 < frame.can_id < 0x640 or frame.can_id == 0x670:
                self._note(frame)
            if not self.is_silent:
                self.bench.receive_bench(frame, "dashboard")

    def receive(self, timeout_s: float) -> list[tuple[int, Frame]]:
        self._check()
        records, self.bench.bench_records = self.bench.bench_records, []
        return [(each.time_ns, each.frame) for each in records if each.origin != "dashboard"]

    def telemetry(self) -> None:
        """What a runner has the bench send while somebody listens."""
        self.bench.send_telemetry()

    def fileno(self) -> int | None:
        return None

    def close(self) -> None:
        self.is_closed = True

    def _note(self, frame: Frame) -> None:
        if frame.data[0] in (0x21, 0x40):
            self.requests.append(int.from_bytes(frame.data[1:3], "little"))

    def _check(self) -> None:
        if self.is_broken:
            raise BusError(f"{self.description}: the server closed the connection")


@pytest.fixture
def loop(cell: Cell) -> BenchOnABus:
    return BenchOnABus(cell)
